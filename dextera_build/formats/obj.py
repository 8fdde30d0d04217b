"""`Mesh` as Wavefront OBJ."""

from __future__ import annotations

from pathlib import Path

from dextera_build.artifacts.cameras.image import png
from dextera_build.artifacts.shapes.mesh import Mesh


def write(mesh: Mesh, path: Path) -> list[Path]:
    """Write OBJ with a material and a texture, if there is one, beside it."""
    material, picture = path.with_suffix(".mtl"), path.with_suffix(".png")
    path.write_text(text(mesh, material.name))
    red, green, blue = mesh.colour
    lines = ["newmtl surface", f"Kd {red:.4f} {green:.4f} {blue:.4f}"]
    if mesh.texture is not None:
        picture.write_bytes(png(mesh.texture.pixels))
        lines += ["Kd 1 1 1", f"map_Kd {picture.name}"]
    material.write_text("\n".join(lines) + "\n")
    return [path, *([picture] if mesh.texture is not None else []), material]


def text(mesh: Mesh, material_file: str | None = None) -> str:
    """Wavefront OBJ text of `mesh`; nine significant digits keep float32 exactly."""
    lines = [f"mtllib {material_file}", "usemtl surface"] if material_file else []
    lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in mesh.vertices.tolist()]
    if mesh.uv is None:
        lines += [f"f {a} {b} {c}" for a, b, c in (mesh.faces + 1).tolist()]
        return "\n".join(lines) + "\n"
    lines += [f"vt {u:.6f} {v:.6f}" for u, v in mesh.uv.reshape(-1, 2).tolist()]
    lines += [
        f"f {a}/{3 * i + 1} {b}/{3 * i + 2} {c}/{3 * i + 3}" for i, (a, b, c) in enumerate((mesh.faces + 1).tolist())
    ]
    return "\n".join(lines) + "\n"
