"""Stand-ins for FoundationPose and Segment-and-Track-Anything with the signatures of these programs."""

FOUNDATION_POSE = {
    "nvdiffrast/__init__.py": "",
    "nvdiffrast/torch.py": "class RasterizeCudaContext:\n    pass\n",
    "estimater.py": '''
import numpy as np, open3d as o3d, torch

class ScorePredictor: pass
class PoseRefinePredictor: pass

class FoundationPose:
    """As the original: it works with the mesh moved to its middle, in metres, and takes depth in metres."""

    def __init__(self, model_pts, model_normals, symmetry_tfs=None, mesh=None, scorer=None, refiner=None, glctx=None,
                 debug=0, debug_dir=""):
        assert isinstance(scorer, ScorePredictor) and isinstance(refiner, PoseRefinePredictor) and glctx is not None
        assert symmetry_tfs.shape[1:] == (4, 4) and np.allclose(symmetry_tfs[0], np.eye(4))
        assert 0.01 < np.ptp(model_pts, axis=0).max() < 2, "a mesh in metres"
        self.center = (model_pts.min(axis=0) + model_pts.max(axis=0)) / 2
        moved = mesh.copy()
        moved.vertices = mesh.vertices - self.center
        self.cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(moved.sample(3000, seed=0)))
        self.pose_last = None

    def get_tf_to_centered_mesh(self):
        found = torch.eye(4)
        found[:3, 3] = -torch.as_tensor(self.center, dtype=torch.float)
        return found

    def register(self, K, rgb, depth, ob_mask, ob_id=None, glctx=None, iteration=5):
        print("registered")
        assert ob_mask.shape == depth.shape and ob_mask.dtype == bool
        middle = np.median(points(K, depth, ob_mask & (depth > 0)), axis=0)
        pose = self.pose_last.numpy().astype(float)
        pose[:3, 3] = middle + 0.02 * middle / np.linalg.norm(middle)
        self.pose_last = torch.as_tensor(pose, dtype=torch.float)
        return self.track_one(rgb, depth, K, iteration)

    def track_one(self, rgb, depth, K, iteration, extra={}):
        assert rgb.dtype == np.uint8 and depth.dtype == np.float32 and 0.1 < np.median(depth[depth > 0]) < 5
        start = self.pose_last.numpy().astype(float)
        seen = points(K, depth, depth > 0)
        seen = seen[np.linalg.norm(seen - start[:3, 3], axis=1) < 0.15]
        if len(seen) < 100:
            return (self.pose_last @ self.get_tf_to_centered_mesh()).numpy().reshape(4, 4)
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(seen)).voxel_down_sample(0.004)
        cloud.estimate_normals()
        kind = o3d.pipelines.registration.TransformationEstimationPointToPlane()
        found = o3d.pipelines.registration.registration_icp(self.cloud, cloud, 0.02, start, kind).transformation
        self.pose_last = torch.as_tensor(np.array(found), dtype=torch.float)
        return (self.pose_last @ self.get_tf_to_centered_mesh()).numpy().reshape(4, 4)

def points(K, depth, where):
    row, column = np.nonzero(where)
    z = depth[row, column].astype(float)
    return np.stack([(column - K[0, 2]) / K[0, 0] * z, (row - K[1, 2]) / K[1, 1] * z, z], axis=1)
''',
}
DEAOT = {
    "model_args.py": "aot_args = {'long_term_mem_gap': 9999}\nsam_args = {}\nsegtracker_args = {'sam_gap': 10}\n",
    "SegTracker.py": '''
import numpy as np

class SegTracker:
    """Follows each label as the pixels that are nearest to its mean colour in the first frame."""

    def __init__(self, segtracker_args, sam_args, aot_args):
        assert aot_args["long_term_mem_gap"] == 5 and "sam_gap" in segtracker_args
        self.colours = None

    def restart_tracker(self):
        self.colours = {}

    def add_reference(self, frame, mask, frame_step=0):
        assert mask.dtype == np.uint8 and frame.dtype == np.uint8
        self.colours = {int(k): frame[mask == k].mean(axis=0) for k in np.unique(mask)}

    def track(self, frame, update_memory=False):
        assert update_memory
        apart = [np.linalg.norm(frame - colour, axis=-1) for colour in self.colours.values()]
        return np.array(list(self.colours), np.uint8)[np.argmin(apart, axis=0)]
''',
}
