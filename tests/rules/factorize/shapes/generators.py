"""Stand-ins for the modules of generators, with the signatures that their repositories publish."""

from __future__ import annotations

import sys
import venv
from pathlib import Path

MESH = '''
import numpy as np, trimesh

def standing():
    """A closed body, y up as in GLB, in the generator's unit."""
    body = trimesh.creation.cylinder(radius=0.3, height=0.9, sections=24)
    body.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
    return body
'''
TRELLIS = {
    "stand_in.py": MESH,
    "trellis2/__init__.py": "",
    "trellis2/pipelines/__init__.py": """
import os

class Voxels:
    attrs = coords = layout = None
    voxel_size = 1 / 512

    def __init__(self, image, seed):
        from stand_in import standing
        made = standing()
        self.vertices, self.faces, self.seed, self.image = made.vertices, made.faces, seed, image

    def simplify(self, target):
        assert target == 16777216

class Trellis2ImageTo3DPipeline:
    @classmethod
    def from_pretrained(cls, path):
        assert os.path.isfile(os.path.join(path, "pipeline.json"))
        print("weights loaded")
        return cls()

    def cuda(self):
        pass

    def run(self, image, num_samples=1, seed=42, preprocess_image=True, pipeline_type=None, max_num_tokens=49152):
        assert image.mode == "RGBA" and image.getextrema()[3] == (0, 255)
        assert pipeline_type in ("512", "1024", "1024_cascade", "1536_cascade")
        return [Voxels(image, seed)]
""",
    "o_voxel/__init__.py": "from . import postprocess\n",
    "o_voxel/postprocess.py": """
import trimesh

class Made:
    def __init__(self, vertices, faces):
        self.mesh = trimesh.Trimesh(vertices, faces)

    def export(self, path, extension_webp=False):
        self.mesh.export(path)

def to_glb(vertices, faces, attr_volume, coords, attr_layout, aabb, voxel_size=None, decimation_target=1000000,
           texture_size=2048, remesh=False, remesh_band=1, remesh_project=0.9, verbose=False):
    return Made(vertices, faces)
""",
}
HUNYUAN = {
    "stand_in.py": MESH,
    "torch.py": """
class Generator:
    def __init__(self, device):
        assert device == "cuda"

    def manual_seed(self, seed):
        return self
""",
    "huggingface_hub.py": "def snapshot_download(repo_id, allow_patterns=None):\n    raise OSError('offline')\n",
    "hy3dshape/__init__.py": "",
    "hy3dshape/pipelines.py": """
import os

class Hunyuan3DDiTFlowMatchingPipeline:
    @classmethod
    def from_pretrained(cls, model_path, device="cuda", subfolder="hunyuan3d-dit-v2-1", **more):
        assert os.path.isfile(os.path.join(model_path, subfolder, "config.yaml"))
        print("weights loaded")
        return cls()

    def __call__(self, image=None, num_inference_steps=50, generator=None, **more):
        from stand_in import standing
        assert image.mode == "RGBA" and generator is not None
        return [standing()]
""",
    "textureGenPipeline.py": """
import os, huggingface_hub, trimesh

class Hunyuan3DPaintConfig:
    def __init__(self, max_num_view, resolution, device=None):
        self.multiview_pretrained_path = "tencent/Hunyuan3D-2.1"

class Hunyuan3DPaintPipeline:
    def __init__(self, config):
        path = huggingface_hub.snapshot_download(repo_id=config.multiview_pretrained_path, allow_patterns=["*"])
        assert os.path.isdir(os.path.join(path, "hunyuan3d-paintpbr-v2-1"))
        assert os.path.isfile(os.path.join(config.dino_ckpt_path, "config.json"))

    def __call__(self, mesh_path=None, image_path=None, output_mesh_path=None, use_remesh=True, save_glb=True):
        open(os.path.join(os.path.dirname(mesh_path), "white_mesh_remesh.obj"), "w").close()
        trimesh.load(mesh_path, force="mesh").export(output_mesh_path)
        return output_mesh_path
""",
}
SAM3D = {
    "stand_in.py": MESH,
    "huggingface_hub.py": "def hf_hub_download(repo_id, filename):\n    raise OSError('offline')\n",
    "torch.py": """
class hub:
    def download_url_to_file(url, dst):
        raise OSError("a test asked the net")

    def load(repo_or_dir, model, source="github"):
        import os
        if os.environ.get("DXB_TEST_NO_DINO"):
            hub.download_url_to_file("https://example.org/dinov2.zip", "/nowhere")
""",
    "inference.py": """
import os
os.environ["CUDA_HOME"] = os.environ["CONDA_PREFIX"]
import numpy as np, torch
from huggingface_hub import hf_hub_download

class Inference:
    def __init__(self, config_file, compile=False):
        assert os.path.isfile(config_file) and not compile
        torch.hub.load("facebookresearch/dinov2", "dinov2_vitl14_reg")
        assert os.path.isfile(hf_hub_download(repo_id="Ruicheng/moge-vitl", filename="model.pt"))
        print("weights loaded")

    def __call__(self, image, mask, seed=None, pointmap=None):
        from stand_in import standing
        assert image.shape == (*mask.shape, 3) and image.dtype == np.uint8 and mask.dtype == bool and mask.any()
        made = standing().subdivide().subdivide().subdivide().subdivide()
        made.visual.vertex_colors = np.where(made.vertices[:, 1:2] > 0, (220, 30, 30, 255), (30, 30, 220, 255))
        return {"glb": made, "gs": None, "scale": None, "rotation": None, "translation": None}
""",
}


def environment(project: Path, name: str, modules: dict[str, str]) -> None:
    """A virtual environment with these modules, beside its lock file."""
    folder = project / ".envs" / name
    venv.create(folder, with_pip=False)
    packages = next((folder / "lib").glob("python*/site-packages"))
    own = next(path for path in sys.path if path.endswith("site-packages") and (Path(path) / "trimesh").is_dir())
    (packages / "beside.pth").write_text(own)
    for file, text in modules.items():
        path = packages / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    (project / "envs").mkdir(exist_ok=True)
    (project / "envs" / f"{name}.lock").write_text("stand-ins\n")
