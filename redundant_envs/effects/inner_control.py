"""What the modes of actions have in common: a controller in front of the motors, which knows the arm's model.

A mode says which rates of the joints its commands want; :class:`InnerControl` turns these into efforts.
"""

import functools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Self, cast

from redundant_envs.effects.hooks import Actuation, Arm, Effect, Hook, Link, effort_unit, snake_case
from redundant_envs.effects.numbers import Numbers, each_joint, not_negative, one, positive
from redundant_envs.effects.viscous_friction import ViscousFriction
from redundant_envs.language.algebra import entries, numbered, physics, sqrt, total
from redundant_envs.language.dual import is_zero
from redundant_envs.robots.derived import coordinate_rates
from redundant_envs.support.values import shown

GAIN = 25.0
"""1/s, of a mode that ``action=`` adds: a rate follows in 40 ms, two of the usual control intervals; with
more the efforts reach their limits more often, and with less the wanted rates are hardly reached."""
FIRST_SPEED, SPEED, SLIDER_SPEED = 3.0, 4.0, 0.8
"""rad/s of the first revolute joint and of the others, and m/s of sliders, in units of which such a mode
takes actions: the motors of the reach scenes reach them in 0.1 s."""


@physics
def bend(wanted, limits):
    """A smooth, increasing map onto less than the limits, x / sqrt(1 + 4 x^6 / (1 + 2 x^2)^2) of their
    shares: 0.2 % less than what is wanted at a third of a limit, 1.4 % at half of it, 17 % at the limit."""
    square = wanted * wanted
    flat = limits * (limits * limits + 2.0 * square)
    return wanted * flat / sqrt(flat * flat + 4.0 * square * square * square)


def usual_speeds(arm: Arm) -> tuple[float, ...]:
    """Speeds of the joints in a mode that ``action=`` adds."""
    first = arm.prismatic.index(False) if False in arm.prismatic else None
    return tuple(
        SLIDER_SPEED if slides else FIRST_SPEED if k == first else SPEED
        for k, slides in enumerate(arm.prismatic)
    )


class Wanted(NamedTuple):
    """Rates of the joints that a mode wants."""

    rates: Callable[..., Sequence[Any]]
    takes: tuple[str, ...]  # names of what it takes
    bind: tuple[tuple[str, str], ...] = ()  # those of them that are numbers of the mode, as in a hook


@functools.lru_cache(maxsize=256)
def effort_at(arm: Any, joint: int, wanted: Wanted, converts: bool) -> Callable[..., Any]:
    """The function that gives the effort of a joint of an arm's class: with qd = T u of the rates u of the
    joints, T^T (M T a + h + G) + friction wanted bent into the limits, where a = gain (wanted - u)."""
    n, T = len(arm.joints), coordinate_rates(arm)
    own = ("gain", "limits", "friction", *(["per_effort"] * converts))
    motion = (*numbered("phid{}", n), *entries("M", n, n), *numbered("h{}", n), *numbered("G{}", n))

    @physics(takes=(*own, *motion, *wanted.takes))
    def effort(gain, limits, friction, *values):
        factor, values = (values[0], values[1:]) if converts else (None, values)
        M, forces, taken = values[n : n + n * n], values[n + n * n : 3 * n + n * n], values[3 * n + n * n :]
        rates = wanted.rates(*taken)
        a = [gain * (rate - present) for rate, present in zip(rates, values, strict=False)]
        qdd = [sum_of(zip(row, a, strict=True)) for row in T.tolist()]
        inertial = [sum_of(zip(M[n * i : n * i + n], qdd, strict=True)) for i in range(n)]
        Q = [inertial[i] + (forces[i] + forces[n + i]) for i in range(n)]
        effort = sum_of(zip(T[:, joint].tolist(), Q, strict=True)) + friction * rates[joint]
        return bend(effort if factor is None else factor * effort, limits)

    return effort  # type: ignore[no-any-return]


def of_joints(name: str, count: int) -> tuple[tuple[str, str], ...]:
    """Arguments for the numbers of a mode at each joint, speeds1 for ".speeds[0]"."""
    return tuple((f"{name}{k + 1}", f".{name}[{k}]") for k in range(count))


def sum_of(pairs: Iterable[tuple[Any, Any]]) -> Any:
    """The sum of products, without those with the constant 0."""
    products = [y if isinstance(x, float) and x == 1.0 else x * y for x, y in pairs if not is_zero(x)]
    return total(products)


@dataclass(frozen=True)
class InnerControl(Effect):
    """Base of the modes of actions: a controller of the rates of the joints, by computed torque.

    The efforts are those of the equations of motion for joint accelerations of ``gain`` times what the rates
    lack, and those that the wanted rates need against ``friction``, bent smoothly into the limits: continuous
    in time, without memory, so nothing winds up at a stop. It knows the true masses of the environment, with
    what effects add to the arm, the field and the motion; it knows no other friction, no spring and no
    contact, and counts a joint at its stop as free.

    Parameters
    ----------
    gain : float
        1/s, positive: the rates decay to what is wanted with the time constant 1/gain.
    limits : float or sequence of one for each joint
        Most that it asks of each motor, N m or N, or what the motor takes; positive.
    friction : float or sequence of one for each joint, default 0
        Viscous friction of the joints that it knows, N m s/rad (revolute) or N s/m (prismatic), not negative.
    per_effort : float or sequence of one for each joint, default 1
        What a motor that takes no effort needs for one, such as V per N m; positive.
    gives : str, default ""
        Unit of what the motors take, such as "V", if it is not that of efforts.
    """

    gain: float = field(metadata=one(positive, "1/s"))
    limits: float | Numbers = field(metadata=each_joint(positive))
    friction: float | Numbers = field(
        default=0.0, kw_only=True, metadata=each_joint(not_negative, "N m s/rad", "N s/m")
    )
    per_effort: float | Numbers = field(default=1.0, kw_only=True, metadata=each_joint(positive))
    gives: str = field(default="", kw_only=True)

    static = ("gives",)

    def __post_init__(self) -> None:
        super().__post_init__()
        of_joints = self.per_effort if isinstance(self.per_effort, tuple) else (self.per_effort,)
        if not self.gives and {*of_joints} != {1.0}:
            raise ValueError(
                f"{type(self).__name__}.per_effort is {shown(self.per_effort)} without gives; name the unit "
                "that the motors take, such as gives='V', or leave per_effort out"
            )

    @classmethod
    def for_scene(cls, scene: Any) -> Self:
        """The mode that ``action=`` adds to a scene: its limits are those of the motors; ValueError if they
        take something else than efforts, and no effect says how much of it for one."""
        arm, values, units = scene.robot, scene.parameters(), scene.command_units()
        friction = (e.coefficients for e in scene.effects if isinstance(e, ViscousFriction))
        limits = tuple(values[name] for name in scene.action_units())
        numbers: dict[str, Any] = {"gain": GAIN, "limits": limits, "friction": next(friction, 0.0)}
        if units != tuple(effort_unit(arm, k) for k in range(len(units))):
            found = (effect.taken_per_effort(arm) for effect in scene.effects)
            numbers |= {"per_effort": next((x for x in found if x), ()), "gives": units[0]}
            if not numbers["per_effort"] or len({*units}) > 1:
                raise ValueError(
                    f"action is {snake_case(cls.__name__)!r}, and the motors of the scene take {units}; put "
                    f"a {cls.__name__} with per_effort and gives into its effects"
                )
        return cls(**numbers, **cls.defaults(scene))

    @classmethod
    def defaults(cls, scene: Any) -> dict[str, Any]:
        """The other numbers of the mode for a scene."""
        raise NotImplementedError(f"{cls.__name__} has no usual numbers; write defaults(cls, scene)")

    def wanted(self, arm: Arm) -> Wanted:
        """The rates of the joints that the commands want."""
        raise NotImplementedError(
            f"{type(self).__name__} does not say which rates its commands want; write wanted(self, arm)"
        )

    def takes(self, arm: Arm, joint: int) -> str:
        """Unit of what the link of a joint takes."""
        raise NotImplementedError(
            f"{type(self).__name__} does not say what a command is; write takes(self, arm, joint)"
        )

    def shared_commands(self, arm: Arm) -> tuple[str, ...]:
        return tuple(
            self.takes(arm, k) for k in range(len(arm.joints))
        )  # each effort follows from all of them

    def links(self, arm: Arm) -> tuple[Hook, ...]:
        wanted, gives, kind = self.wanted(arm), self.gives, cast(Any, type(arm))
        return tuple(
            Actuation(
                k, effort_at(kind, k, wanted, bool(gives)), dict(wanted.bind), Link.CONTROL,
                takes=self.takes(arm, k), gives=gives,
            )
            for k in range(len(arm.joints))
        )  # fmt: skip

    def effort_units(self, arm: Arm) -> tuple[str, ...]:
        return tuple(f"limits[{k}]" for k in range(len(arm.joints)))

    def units(self, arm: Arm) -> dict[str, str]:
        n = range(len(arm.joints))
        units = {f"limits[{k}]": self.gives or effort_unit(arm, k) for k in n}
        if self.gives:
            units |= {f"per_effort[{k}]": f"{self.gives}/({effort_unit(arm, k)})" for k in n}
        return {**super().units(arm), **units}
