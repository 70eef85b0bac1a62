"""Motors that get each command some time after its interval has begun, and a number that is read there:
effects with an instant."""

from dataclasses import dataclass

import redundant_envs as rde
from redundant_envs.algebra import physics, where
from redundant_envs.effects import Actuation, Effect, Force, Instant, Link, State

moment = physics(lambda seconds: seconds)
renewed = physics(lambda command: command)
present = physics(lambda command, waiting, passed: where(passed > 0.0, command, waiting))


@dataclass(frozen=True)
class LateCommand(Effect):
    """The command of an interval acts from ``seconds`` [s] after its start on, and the one before until then:
    all the time in an interval that is not longer."""

    seconds: float

    def hooks(self, arm):
        links = (self.link(k, "N" if slides else "N m") for k, slides in enumerate(arm.prismatic))
        return (Instant(moment, {"seconds": ".seconds"}), *links)

    def link(self, k, unit):
        kept = State(f"waiting[{k}]", unit, update=renewed, bind={"command": f"command{k + 1}"})
        bind = {"command": f"command{k + 1}", "waiting": f".waiting[{k}]"}
        return Actuation(k, present, bind, Link.DELAY, states=(kept,))


part_of_interval = physics(lambda control_dt, share: share * control_dt)
read = physics(lambda rate: rate)
brake = physics(lambda sampled, strength: -strength * sampled)


@dataclass(frozen=True)
class SampledBrake(Effect):
    """A brake of a ``strength`` [N m s/rad or N s/m] on joint 1, which knows the rate of the joint as it was
    read last, once in each interval, after a ``share`` of it."""

    strength: float
    share: float = 0.5

    def hooks(self, arm):
        sampled = State("sampled", "rad/s", update=read, bind={"rate": "phid1"}, when="instant")
        own = {"sampled": ".sampled", "strength": ".strength"}
        return (Instant(part_of_interval, {"share": ".share"}), Force(0, brake, own, states=(sampled,)))


rde.register_effect(LateCommand)
rde.register_effect(SampledBrake)
