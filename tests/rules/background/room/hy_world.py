"""Stand-ins for the modules of HY-World 2.0, with the signatures and file forms that its repository publishes."""

PANO = '''
import os
import numpy as np
from PIL import Image

class HunyuanPanoPipeline:
    @classmethod
    def from_pretrained(cls, pretrained_model_name_or_path="Qwen/Qwen-Image-Edit-2509", *,
                        lora_path="tencent/HY-World-2.0", lora_subfolder="HY-Pano-2.0", torch_dtype="bfloat16"):
        assert os.path.isfile(os.path.join(pretrained_model_name_or_path, "model_index.json"))
        assert os.path.isfile(os.path.join(lora_path, lora_subfolder, "pytorch_lora_weights.safetensors"))
        print("weights loaded")
        return cls()

    def __call__(self, image, **kwargs):
        return self.forward(image, **kwargs)

    def forward(self, image, *, prompt="", negative_prompt="", seed=42, height=960, width=1952, num_inference_steps=40,
                guidance_scale=1.0, true_cfg_scale=7.5, blend_width=32, crop_border=0.0):
        """The picture of a camera with the intrinsics of the test, looking `DXB_TEST_PITCH` [deg] down; else noise."""
        picture = np.asarray(Image.open(str(image)).convert("RGB"))
        width -= blend_width
        made = np.random.default_rng(seed).integers(0, 256, (15, 30, 3), dtype=np.uint8)
        made = np.array(Image.fromarray(made).resize((width, height), Image.Resampling.BICUBIC))
        if "DXB_TEST_PITCH" not in os.environ:
            return Image.fromarray(made)
        angle = np.deg2rad(float(os.environ["DXB_TEST_PITCH"]))
        v, u = np.indices((height, width))
        across, up = (u + 0.5) / width * 2 * np.pi - np.pi, np.pi / 2 - (v + 0.5) / height * np.pi
        x, y, z = np.cos(up) * np.sin(across), -np.sin(up), np.cos(up) * np.cos(across)
        y, z = np.cos(angle) * y - np.sin(angle) * z, np.sin(angle) * y + np.cos(angle) * z
        rows, columns = picture.shape[:2]
        ahead = np.maximum(z, 1e-9)
        column = np.round(0.95 * columns * x / ahead + 0.49 * columns)
        row = np.round(0.95 * columns * y / ahead + 0.52 * rows)
        there = (z > 0) & (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        made[there] = picture[row[there].astype(int), column[there].astype(int)]
        return Image.fromarray(made)
'''
MIRROR = '''
import json, os
from pathlib import Path
import numpy as np
from PIL import Image

SCALE = 0.27

def vertices(path, columns):
    table = np.empty(len(next(iter(columns.values()))), [(name, "<f4") for name in columns])
    for name, column in columns.items():
        table[name] = column
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(table)}"]
    lines += [f"property float {name}" for name in columns] + ["end_header", ""]
    Path(path).write_bytes("\\n".join(lines).encode() + table.tobytes())

class WorldMirrorPipeline:
    @classmethod
    def from_pretrained(cls, pretrained_model_name_or_path="tencent/HY-World-2.0", *, subfolder="HY-WorldMirror-2.0",
                        config_path=None, ckpt_path=None, use_fsdp=False, enable_bf16=False, fsdp_cpu_offload=False,
                        disable_heads=None):
        assert os.path.isfile(os.path.join(pretrained_model_name_or_path, subfolder, "model.safetensors"))
        print("weights loaded")
        return cls()

    def __call__(self, input_path, output_path="inference_output", *, target_size=952, fps=1, video_strategy="new",
                 video_min_frames=1, video_max_frames=32, save_depth=True, save_normal=True, save_gs=True,
                 save_camera=True, save_points=True, save_colmap=False, save_conf=False, apply_sky_mask=True,
                 apply_edge_mask=True, apply_confidence_mask=False, save_sky_mask=False, sky_mask_source="auto",
                 model_sky_threshold=0.45, confidence_percentile=10.0, edge_normal_threshold=1.0,
                 edge_depth_threshold=0.03, compress_pts=True, compress_pts_max_points=2_000_000,
                 compress_pts_voxel_size=0.002, max_resolution=1920, compress_gs_max_points=5_000_000,
                 prior_cam_path=None, prior_depth_path=None, save_rendered=False, render_interp_per_pair=15,
                 render_depth=False, log_time=True, strict_output_path=None):
        """One Gaussian and one point 1 m ahead of each camera, in the frame of the first and a unit of its own."""
        mode = os.environ.get("DXB_TEST_MIRROR", "")
        if mode == "skip":
            print("[Pipeline] Skipping: too few pictures")
            return None
        assert not apply_sky_mask or sky_mask_source == "model", "a test would ask the net"
        pictures = sorted(Path(input_path).glob("*.png"))
        given = json.loads(Path(prior_cam_path).read_text())
        assert given["num_cameras"] == len(pictures)
        by_name = {each["camera_id"]: np.array(each["matrix"]) for each in given["extrinsics"]}
        poses = np.array([by_name[path.stem] for path in pictures])
        k = {each["camera_id"]: np.array(each["matrix"]) for each in given["intrinsics"]}[pictures[0].stem]
        poses = np.linalg.inv(poses[0]) @ poses
        poses[:, :3, 3] *= SCALE
        if mode == "lost":
            poses[:, :3, 3] += 0.5 * SCALE * np.random.default_rng(0).uniform(size=(len(poses), 3))
        out = Path(strict_output_path)
        (out / "depth").mkdir(parents=True)
        wide, high = Image.open(pictures[0]).size
        longest = min(max(wide, high), target_size) // 14 * 14
        size = (round(high * longest / wide / 14) * 14, longest)
        assert abs(k[0, 0] / wide - 0.95) < 1e-6
        for number in range(len(poses)):
            np.save(out / "depth" / f"depth_{number:04d}.npy", np.full(size, SCALE, np.float32))
            Image.fromarray(np.zeros(size, np.uint8)).save(out / "depth" / f"depth_{number:04d}.png")
        ahead = poses[:, :3, 3] + SCALE * poses[:, :3, 2]
        opacity = np.linspace(0.1, 0.9, len(poses))
        opacity = np.log(opacity / (1 - opacity)) if mode == "logits" else opacity
        place = dict(zip("xyz", ahead.T))
        more = dict.fromkeys(["nx", "ny", "nz", "rot_1", "rot_2", "rot_3"], 0.0) | {"rot_0": 1.0}
        more |= {f"f_dc_{n}": 0.2 * n for n in range(3)} | {f"scale_{n}": np.log(0.01 * SCALE) for n in range(3)}
        filled = {name: np.full(len(poses), value) for name, value in more.items()}
        vertices(out / "gaussians.ply", place | filled | {"opacity": opacity})
        vertices(out / "points.ply", place)
        rows = lambda matrices: [{"camera_id": n, "matrix": each.tolist()} for n, each in enumerate(matrices)]
        (out / "camera_params.json").write_text(json.dumps({"num_cameras": len(poses), "extrinsics": rows(poses),
                                                            "intrinsics": rows(np.tile(k, (len(poses), 1, 1)))}))
        return str(out)
'''
MODULES = {
    "hy_pano": {"pipeline_with_qwen_image.py": PANO},
    "worldmirror": {
        "hyworld2/__init__.py": "",
        "hyworld2/worldrecon/__init__.py": "",
        "hyworld2/worldrecon/pipeline.py": MIRROR,
    },
}
WEIGHTS = {
    "hy_pano": {
        "qwen_image_edit": ["model_index.json"],
        "hy_pano_2": ["HY-Pano-2.0/pytorch_lora_weights.safetensors"],
    },
    "worldmirror": {"worldmirror_2": ["HY-WorldMirror-2.0/model.safetensors", "HY-WorldMirror-2.0/config.yaml"]},
}
