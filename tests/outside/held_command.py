"""Motors that get each command one control interval late: an effect whose states are updated at its end."""

from dataclasses import dataclass

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.effects import Actuation, Effect, Link, State


@physics
def renewed(command):
    return command


@physics
def effort_of(waiting):
    return waiting


@dataclass(frozen=True)
class HeldCommand(Effect):
    """The command of the previous interval acts; at the start it is 0."""

    def hooks(self, arm):
        return tuple(self.link(k) for k in range(len(arm.joints)))

    def link(self, k):
        kept = State(f"waiting[{k}]", "N m or N", update=renewed, bind={"command": f"command{k + 1}"})
        return Actuation(k, effort_of, {"waiting": f".waiting[{k}]"}, Link.DELAY, states=(kept,))


rde.register_effect(HeldCommand)
