"""What every test needs before anything is imported."""

from __future__ import annotations

import os

# MuJoCo reads it once, when it is imported; a test may do that before `dextera_build.sim` does.
os.environ.setdefault("MUJOCO_GL", "egl")
