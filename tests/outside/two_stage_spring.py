"""A spring that becomes harder beyond a knee on either side: a force that changes its law."""

from dataclasses import dataclass

import redundant_envs as rde
from redundant_envs.algebra import physics, where
from redundant_envs.effects import Effect, Force


@physics
def beyond_knee(position, lower, upper, side):
    return position - where(side > 0.0, upper, where(side < 0.0, lower, position))


@physics
def pull_back(position, lower, upper, side, soft, harder):
    return -soft * position - harder * beyond_knee(position, lower, upper, side)


@physics
def energy(position, lower, upper, side, soft, harder):
    return 0.5 * soft * position**2 + 0.5 * harder * beyond_knee(position, lower, upper, side) ** 2


@physics
def hardest(soft, harder):
    return soft + harder


@dataclass(frozen=True)
class TwoStageSpring(Effect):
    """Pulls a joint back to 0: with ``soft`` [N/m or N m/rad] between its knees, ``harder`` more beyond."""

    joint: int
    lower: float
    upper: float
    soft: float
    harder: float

    static = ("joint",)

    def hooks(self, arm):
        own = {n: f".{n}" for n in ("lower", "upper", "soft", "harder")}
        bind = {"position": f"phi{self.joint + 1}", **own}
        switch = (".lower", ".upper")
        return (Force(self.joint, pull_back, bind, potential=energy, stiffness=hardest, switch=switch),)


rde.register_effect(TwoStageSpring)
