"""Number of steps that springs, dampers and states of effects require, independent of error estimates."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from redundant_envs.effects.hooks import Actuation, Effect, Force, Point
from redundant_envs.numerics import estimates
from redundant_envs.quantities import Quantities

if TYPE_CHECKING:
    from redundant_envs.lane.dynamics import Dynamics
    from redundant_envs.lane.memory import Lane


def rates_of_parameters(dynamics: Dynamics, x: Quantities) -> list[Any]:
    """Steps per second that follow from the parameters alone."""
    rates = []
    for effect, hook in dynamics.hooks:
        for state in hook.states if isinstance(hook, Force | Actuation) else ():
            if state.rate is not None:
                rates.append(estimates.steps_of_state(dynamics.apply(effect, state, state.rate, x)))
        if not isinstance(hook, Force):
            continue
        damping = None if depends_on_motion(dynamics, effect, hook) else hook.damping
        for function, rule in (
            (hook.stiffness, estimates.steps_of_spring),
            (damping, estimates.steps_of_damper),
        ):
            if function is not None:
                mobility = most_mobility(dynamics, effect, hook, x)
                rates.append(rule(dynamics.apply(effect, hook, function, x), mobility))
    return rates


def depends_on_motion(dynamics: Dynamics, effect: Effect, hook: Force) -> bool:
    """Whether the damping of a force depends on the position or the rate of its joint."""
    if hook.damping is None or isinstance(hook.joint, Point):
        return False
    return not {*motion_of(hook)}.isdisjoint(dynamics.bound(effect, hook, hook.damping))


def motion_of(hook: Force) -> tuple[str, str]:
    """Names of the position and the rate of the joint of a force."""
    assert isinstance(hook.joint, int)
    return f"phi{hook.joint + 1}", f"phid{hook.joint + 1}"


def dampers(dynamics: Dynamics) -> list[tuple[Effect, Force]]:
    """Forces whose damping depends on their joint's motion, under a tolerance. Estimates of dop853, which
    are held near rounding, see such dampers."""
    if dynamics.scene.tolerance is None:
        return []
    return [(e, h) for e, h in dynamics.hooks if isinstance(h, Force) and depends_on_motion(dynamics, e, h)]


def mobilities(dynamics: Dynamics, x: Quantities) -> dict[str, Any]:
    """Largest mobilities of the joints of :func:`dampers`, by their fields."""
    return {field_of(h): most_mobility(dynamics, e, h, x) for e, h in dampers(dynamics)}


def field_of(hook: Force) -> str:
    """The field of the largest mobility of a joint."""
    assert isinstance(hook.joint, int)
    return f"most_mobility{hook.joint + 1}"


def rates_of_motion(dynamics: Dynamics, lane: Lane, x: Quantities) -> list[Any]:
    """Steps per second that dampers require now, if their damping depends on positions and rates ``x``."""
    rates = []
    for effect, hook in dampers(dynamics):
        assert hook.damping is not None
        position, rate = motion_of(hook)
        ahead = Quantities(
            {position: x[position] + lane.interval * x[rate], rate: x[rate]},
            tuple(dynamics.arm.functions), dynamics.arm.sincos, lane,
        )  # fmt: skip
        here, there = (dynamics.apply(effect, hook, hook.damping, known) for known in (x, ahead))
        mobility = lane[field_of(hook)]
        rates.append(estimates.steps_towards_damper(here, there, mobility, lane.interval))
    return rates


def most_mobility(dynamics: Dynamics, effect: Effect, hook: Force, x: Quantities) -> Any:
    """Largest acceleration by a unit force at its own joint or point, in any pose."""
    if isinstance(hook.joint, Point):  # no more than if the point mass were free
        return 1.0 / x[f"m{hook.joint.number + 1}"]
    if dynamics.arm.mobility_bounds is None:
        raise ValueError(
            f"{dynamics.arm.kind} has no mobility_bounds, from which error control knows what "
            f"{type(effect).__name__} asks of its steps; give the arm these bounds, or the scene an "
            "integrator and substeps"
        )
    return x[f"W{hook.joint + 1}"]
