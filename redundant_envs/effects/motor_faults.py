"""What faults of one motor have in common: when and where they happen, and that the motor gives no effort."""

import functools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from redundant_envs.effects import shapes
from redundant_envs.effects.disturbances import later, step
from redundant_envs.effects.hooks import Actuation, Arm, Effect, Link, State
from redundant_envs.effects.numbers import checked, not_negative, number, one, text
from redundant_envs.language.algebra import physics, where


@physics
def happened_at_start(at, control_dt):
    return step(0.0, at, control_dt, 1.0)


@physics
def happened(time, at, control_dt):
    """1 if the next control interval begins at the time of the fault or later, else 0."""
    return step(time + control_dt, at, control_dt, 1.0)


@functools.cache
def cut_at(k: int) -> Callable[..., Any]:
    """The effort at joint k, counted from 0, behind a motor that gives none once its fault has happened."""

    @physics
    def cut(command, joint, active):
        return where(joint == float(k), where(active > 0.0, 0.0, command), command)

    return cut  # type: ignore[no-any-return]


def index(field: str, value: Any) -> float:
    """A whole number from 0 on, or a ValueError that names the field."""
    x = number(field, value)
    if x < 0.0 or x != int(x):
        raise ValueError(f"{field} is {x:g}; give a joint, counted from 0: a whole number")
    return x


@dataclass(frozen=True)
class MotorFault(Effect):
    """Base of faults of one motor, which begin with a control interval and last.

    Parameters
    ----------
    joint : float
        The joint, counted from 0: a whole number, which may be drawn ("motor_loss.joint").
    at : float
        s, not negative: the fault is there from the first control interval on that begins then or later,
        counted from the start of the motion or the episode.
    name : str, default ""
        Tells several of a scene apart: "left" makes "motor_loss_left.at".
    """

    joint: float = field(metadata=one(index, "1"))
    at: float = field(metadata=one(not_negative, "s"))
    name: str = field(default="", kw_only=True, metadata=checked(text))

    static = ("name",)

    def fitted(self, arm: Arm) -> Effect:
        if not self.joint < (count := len(arm.joints)):
            joints = ", ".join(arm.joints)
            kind = type(self).__name__
            raise ValueError(f"{kind}.joint is {self.joint:g}; give 0 to {count - 1} ({joints})")
        return super().fitted(arm)

    def shapes(self, pose: shapes.Pose) -> tuple[shapes.Shape, ...]:
        """A ring around the joint, once the fault has happened."""
        shown = pose.shows_joints and pose.states["active"] > 0.0
        return (shapes.Load(pose.ends[int(self.joint)], 0.0, held=False),) if shown else ()

    def cuts(self, arm: Arm) -> tuple[Actuation, ...]:
        """The last links of all motors: the joint is a number, which each environment may have its own of."""
        time = State("time", "s", update=later, bind={"elapsed": ".time"})
        states = time, State("active", "1", update=happened, initial=happened_at_start)
        every = range(len(arm.joints))
        return tuple(Actuation(k, cut_at(k), link=Link.JOINT, states=() if k else states) for k in every)
