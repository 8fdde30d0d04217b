"""What every test needs before anything is imported."""

from __future__ import annotations

import os

from hypothesis import HealthCheck, settings

# MuJoCo reads it once, when it is imported; a test may do that before `dextera_build.sim` does.
os.environ.setdefault("MUJOCO_GL", "egl")

# How fast the machine is, and what else it has to do, says nothing of the code.
settings.register_profile("dxb", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("dxb")
