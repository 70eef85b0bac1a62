"""Motors that get each command some time after its interval has begun, and a number that is read there:
effects with an instant."""

from dataclasses import dataclass

import redundant_envs as rde
from redundant_envs.algebra import physics, where
from redundant_envs.effects import Actuation, Effect, Force, Instant, Link, State


@physics
def moment(seconds):
    return seconds


@physics
def renewed(command):
    return command


@physics
def present(command, waiting, passed):
    return where(passed > 0.0, command, waiting)


@dataclass(frozen=True)
class LateCommand(Effect):
    """The command of an interval acts from ``seconds`` after its start on; the one before acts until then.

    Parameters
    ----------
    seconds : float
        s; in an interval that is not longer the command before acts all the time.
    """

    seconds: float

    def hooks(self, arm):
        links = (self.link(k, "N" if slides else "N m") for k, slides in enumerate(arm.prismatic))
        return (Instant(moment, {"seconds": ".seconds"}), *links)

    def link(self, k, unit):
        kept = State(f"waiting[{k}]", unit, update=renewed, bind={"command": f"command{k + 1}"})
        bind = {"command": f"command{k + 1}", "waiting": f".waiting[{k}]"}
        return Actuation(k, present, bind, Link.DELAY, states=(kept,))


@physics
def half(control_dt, share):
    return share * control_dt


@physics
def read(rate):
    return rate


@physics
def brake(sampled, strength):
    return -strength * sampled


@dataclass(frozen=True)
class SampledBrake(Effect):
    """A brake on joint 1 that knows the rate of the joint as it was read last, once in each interval.

    Parameters
    ----------
    strength : float
        N m s/rad, or N s/m.
    share : float
        Share of the interval after which the rate is read.
    """

    strength: float
    share: float = 0.5

    def hooks(self, arm):
        sampled = State("sampled", "rad/s", update=read, bind={"rate": "phid1"}, when="instant")
        own = {"sampled": ".sampled", "strength": ".strength"}
        return (Instant(half, {"share": ".share"}), Force(0, brake, own, states=(sampled,)))


rde.register_effect(LateCommand)
rde.register_effect(SampledBrake)
