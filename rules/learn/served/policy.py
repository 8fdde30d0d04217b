"""Runs policies of learn.served: sends observations to where the policy runs, and receives joint targets [rad]."""

from __future__ import annotations

from dextera_build.policy.wire.asked import predict as predict
