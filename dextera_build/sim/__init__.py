"""The runtime that scenes, tasks and policies share.

Importing it chooses EGL for off-screen rendering unless `MUJOCO_GL` is set; MuJoCo reads that when it is imported.
"""

import os

os.environ.setdefault("MUJOCO_GL", "egl")
