"""The common runtime of scenes, tasks and policies.

Importing it selects EGL for off-screen rendering on Linux unless `MUJOCO_GL` is set.
"""

import os
import sys

if sys.platform == "linux":
    os.environ.setdefault("MUJOCO_GL", "egl")
