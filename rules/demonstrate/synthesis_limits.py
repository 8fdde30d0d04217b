"""When a synthesised episode is discarded, and how fast arms may be in it: options of all rules that synthesise."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pydantic import NonNegativeFloat, PositiveFloat

from dextera_build.rule import Options

if TYPE_CHECKING:
    from dextera_build.sim.experts.filters import Filters

SETTLE_RAD_S = 0.08
"""Speed at which redundant joints return to their home; a faster return would exceed the limits of acceleration
[rad/s]."""


class SynthesisLimits(Options):
    """Filters of episodes that are synthesised from demonstrations."""

    lag_m: PositiveFloat = 0.02
    """Episodes in which joint limits keep the palm farther than this from its command are discarded [m]."""
    press_n: NonNegativeFloat = 2.0
    """Episodes with an unintended contact above this force are discarded [N]."""
    depth_m: PositiveFloat = 0.002
    """Episodes in which the robot or an object penetrates anything by more than this are discarded [m]."""
    grip_m: PositiveFloat = 0.006
    """The same where a hand should touch the object, because the pads of fingers are soft [m]."""
    speed: PositiveFloat = 1.1
    """Episodes in which a joint moves faster than this multiple of its limit are discarded."""
    acceleration_rad_s2: PositiveFloat = 8.5
    """Paths are retimed so that no joint of an arm is accelerated more than this, and episodes in which one is all the
    same are discarded [rad/s^2]. Makers of arms state speeds and torques, but seldom accelerations; the least
    accelerated joint of an LBR iiwa was measured at 8.57 rad/s^2 (Drake's model of it)."""
    hold_s: NonNegativeFloat = 0.5
    """Episodes whose success does not last for this time are discarded, if the task demands less [s]."""

    def filters(self) -> Filters:
        """As the simulation takes them."""
        from dextera_build.sim.experts.filters import Filters

        return Filters(
            lag_m=self.lag_m,
            press_n=self.press_n,
            depth_m=self.depth_m,
            grip_m=self.grip_m,
            speed=self.speed,
            acceleration_rad_s2=self.acceleration_rad_s2,
            hold_s=self.hold_s,
        )
