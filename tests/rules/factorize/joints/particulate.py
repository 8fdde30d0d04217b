"""A stand-in for infer.py of Particulate: its command line, its unit of length, and the form of its URDF.

Parts are told apart by height in quarters of the mesh: base, door, drawer, and a knob fixed to the drawer.
"""

INFER = """
import argparse, os
import numpy as np, trimesh

parser = argparse.ArgumentParser()
parser.add_argument("--input_mesh", required=True)
parser.add_argument("--output_dir", default="inference_outputs")
parser.add_argument("--model_config", default="configs/particulate-B.yaml")
parser.add_argument("--ckpt_path")
parser.add_argument("--up_dir", default="-Z", choices=["X", "Y", "Z", "-X", "-Y", "-Z"])
parser.add_argument("--num_points", type=int, default=102400)
parser.add_argument("--min_part_confidence", type=float, default=0.0)
parser.add_argument("--no_strict", action="store_true")
parser.add_argument("--export_urdf", action="store_true")
args = parser.parse_args()
assert args.up_dir == "Z" and args.export_urdf and args.no_strict
assert os.path.isfile(args.ckpt_path) and os.path.isfile(args.model_config)
assert os.path.isfile(os.path.join(os.path.dirname(os.path.abspath(__file__)), "PartField/model/model_objaverse.ckpt"))
print("Models loaded successfully.")
if args.min_part_confidence == 1.0:
    print("Error processing: out of memory")
    raise SystemExit(0)

mesh = trimesh.load(args.input_mesh, process=False)
mesh = trimesh.util.concatenate(list(mesh.geometry.values()))
low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
mesh.vertices = (mesh.vertices - (low + high) / 2) / (high - low).max()
heights = mesh.triangles_center[:, 2]
low, high = heights.min(), heights.max()
quarter = np.clip(4 * (heights - low) / (high - low), 0, 3.999).astype(int)
# Each part is open where it was cut: the first face is missing.
parts = [mesh.submesh([np.flatnonzero(quarter == n)[1:]], append=True) for n in range(4)]
if args.min_part_confidence > 0.0:
    parts = [mesh]
origins = [part.bounds[0] if n == 1 else part.vertices.mean(axis=0) for n, part in enumerate(parts)]
origins[0] = np.zeros(3)
joints = {
    1: ("revolute", 0, "0 0 1", (0.1, 1.4)),
    2: ("prismatic", 0, "0 -1 0", (0.0, 0.25)),
    3: ("fixed", 2, None, None),
}
folder = os.path.join(args.output_dir, "urdf_20260101_000000")
os.makedirs(os.path.join(folder, "meshes"))
lines = ['<?xml version="1.0"?>', '<robot name="model">']
for n, part in enumerate(parts):
    part = part.copy()
    part.vertices -= origins[n]
    part.export(os.path.join(folder, "meshes", f"part_{n}.obj"))
    lines.append(f'<link name="link_{n}"><visual><origin xyz="0 0 0" rpy="0 0 0"/><geometry>'
                 f'<mesh filename="./meshes/part_{n}.obj"/></geometry></visual>'
                 f'<inertial><mass value="1.0"/></inertial></link>')
for n, (kind, parent, axis, limits) in joints.items():
    if n >= len(parts):
        continue
    x, y, z = origins[n] - origins[parent]
    lines.append(f'<joint name="joint_{parent}_{n}" type="{kind}"><parent link="link_{parent}"/>'
                 f'<child link="link_{n}"/><origin xyz="{x:.6f} {y:.6f} {z:.6f}" rpy="0 0 0"/>')
    if axis:
        lines.append(f'<axis xyz="{axis}"/>')
        lines.append(f'<limit lower="{limits[0]}" upper="{limits[1]}" effort="1000" velocity="100"/>')
    lines.append("</joint>")
lines.append("</robot>")
open(os.path.join(folder, "model.urdf"), "w").write("\\n".join(lines))
"""
MODULES = {"clone.pth": "clone\n", "clone/infer.py": INFER, "clone/configs/particulate-B.yaml": "model_size: B\n"}
