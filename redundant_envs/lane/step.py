"""One step of a lane: its state after ``h``, its error estimate and the bounds of its sliders' motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from redundant_envs.algebra import arguments_of, maximum, sqrt, where
from redundant_envs.events.boundary import Boundary
from redundant_envs.lane import coordinates
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.kinks import kink_values, levels_of
from redundant_envs.lane.memory import Lane
from redundant_envs.numerics import estimates
from redundant_envs.numerics.methods import Step, explicit_step
from redundant_envs.quantities import Quantities
from redundant_envs.tracing.passes.stages import Subroutine

MOST_INLINED = 4
"""Stages of a step up to which each has its own copy of the right-hand side."""


def known_numbers(dynamics: Dynamics, lane: Lane, held: bool) -> dict[str, Any]:
    """Inputs of the equations beside the state: efforts, parameters, and the stops at which sliders rest."""
    stops = [b.active for b in dynamics.holding] if held else []
    sides = [b.side for b in dynamics.laws]
    names = [*dynamics.commands, *dynamics.numbers, *dynamics.effect_states.updated, *stops, *sides]
    return dict(zip(names, lane.get(names), strict=True))


def contact_quantities(dynamics: Dynamics, states: Sequence[Any], numbers: dict[str, Any]) -> Quantities:
    """Quantities while sliders rest at their stops, accelerations among them."""
    x = dynamics.quantities(states, numbers, held=bool(dynamics.holding))
    x.update({f"held{k + 1}": 0.0 for k in dynamics.arm.sliders()})
    for b in dynamics.holding:
        x[held_of(b)] = abs(numbers[b.active])
    return x


def held_of(b: Boundary) -> str:
    """The quantity that is 1 while a slider rests at its stop."""
    assert b.joint is not None
    return f"held{b.joint + 1}"


def pull(x: Quantities, b: Boundary, side: Any) -> Any:
    """Force with which its stop has to pull a resting slider; 0 for a free one."""
    assert b.joint is not None
    return where(x[held_of(b)] > 0.0, side * x[f"hold{b.joint + 1}"], 0.0)


def watched_acceleration(dynamics: Dynamics, b: Boundary, x: Quantities) -> Any:
    """Acceleration of the coordinate of a boundary; for a slider that rests, the pull of its stop."""
    if b.joint is None:
        return coordinates.acceleration(dynamics, b, x)
    joint = b.joint
    if b.bounces:
        return where(x[held_of(b)] > 0.0, pull(x, b, x[b.active]), x[f"qdd{joint + 1}"])
    parts = [
        x[f"qdd{k + 1}"] if share == 1.0 else share * x[f"qdd{k + 1}"]
        for k, share in enumerate(dynamics.arm.motor_map[:, joint].tolist())
        if share != 0.0
    ]
    return sum(parts[1:], parts[0])


def pose_tells_distances(dynamics: Dynamics) -> bool:
    """Whether the distances of the tip from the joints follow from the pose."""
    arm = dynamics.arm
    return not set(arguments_of(arm.column_norms)) <= {*arm.parameter_values()}


def watched_sliders(dynamics: Dynamics) -> tuple[int, ...]:
    """Sliders that may carry the tip past a joint and back within a step, if estimates decide on steps."""
    if dynamics.scene.tolerance is None or not dynamics.located or not pose_tells_distances(dynamics):
        return ()
    return tuple(dynamics.arm.sliders())


SMALLEST_STATE = 1e-300
"""Smallest number by which an error is divided."""


def lane_step(dynamics: Dynamics, lane: Lane, h: Any) -> Step:
    """A step of length ``h``.

    It watches, in this order: the coordinates of boundaries, values that change their signs at kinks, and
    speeds of :func:`watched_sliders`.
    """
    held = bool(dynamics.holding)
    numbers = known_numbers(dynamics, lane, held)
    count, width = dynamics.count, len(dynamics.states)

    def derivatives(*values: Any) -> list[Any]:
        given = dict(zip(numbers, values[width:], strict=True))
        if held:
            x = contact_quantities(dynamics, values[:width], given)
        else:
            x = dynamics.quantities(values[:width], given)
        results = dynamics.accelerations(x)
        results += [watched_acceleration(dynamics, b, x) for b in dynamics.boundaries]
        results += kink_values(dynamics.scene.attached, dynamics.kinks, x)
        return [*results, *(values[count + k] for k in sliders)]

    kinks, sliders = levels_of(dynamics.kinks), watched_sliders(dynamics)
    more = len(dynamics.boundaries) + len(kinks) + len(sliders)
    right_hand_side: Any = derivatives
    if dynamics.method.stages > MOST_INLINED:
        right_hand_side = Subroutine(
            derivatives, count, width - count + more, (*dynamics.states, *numbers),
            [k - count for k, name in enumerate(dynamics.states) if name == "work"],
        )  # fmt: skip
    inputs = list(numbers.values())
    states = lane.get(dynamics.states)
    return explicit_step(
        dynamics.method,
        lambda q, v, z: right_hand_side(*q, *v, *z, *inputs),
        states[:count], states[count : 2 * count], states[2 * count :], h,
    )  # fmt: skip


def step_error(dynamics: Dynamics, lane: Lane, step: Step) -> Any:
    """The error of a step: in metres at the tip, or for dop853 in units of its tolerance."""
    names = tuple(name for name in dynamics.states if name != "work")
    if dynamics.scene.integrator == "dop853":
        after = [*step.positions, *step.velocities, *step.others]
        strikes = bool(dynamics.stops)
        states = zip(lane.get(names), after, strict=False)
        scales = [estimates.rounding_scale(a, b, strikes) for a, b in states]

        def size(errors: Sequence[Any], h: Any) -> Any:
            squares = [(e * s) ** 2 for e, s in zip(errors, scales, strict=False)]
            return h * sqrt(sum(squares[1:], squares[0]) * (1.0 / len(names)))

        return estimates.blended_error(size(step.error5, step.h5), size(step.error3, step.h3))
    weights = tip_weights(dynamics, lane)

    def tip_size(errors: Sequence[Any], h: Any) -> Any:
        n = dynamics.count
        terms = [
            w * (abs(q) + lane.interval * abs(v))
            for w, q, v in zip(weights, errors[:n], errors[n : 2 * n], strict=True)
        ]
        return h * sum(terms[1:], terms[0])

    return estimates.tip_error(
        tip_size(step.error6, step.h6), tip_size(step.error5, step.h5), tip_size(step.error3, step.h3)
    )


def others_error(dynamics: Dynamics, lane: Lane, step: Step, h: Any) -> Any:
    """Estimated tip error from errors of effects' states, m. No other estimate contains an error that does
    not act yet. Each error is related to the size of its state, now or at the end of the interval at the pace
    of the step; the same share of the tip's motion by the step's change of velocity is the estimate."""
    n = dynamics.count
    gained = [
        norm * abs(after - before)
        for norm, after, before in zip(
            tip_norms(dynamics, lane), step.velocities, lane.get(dynamics.arm.rates), strict=True
        )
    ]
    shares = []
    for k, name in enumerate(dynamics.effect_states.integrated):
        before, after = lane[name], step.others[k]
        errors = (step.error6, step.h6), (step.error5, step.h5), (step.error3, step.h3)
        sizes = [abs(error[2 * n + k]) * factor for error, factor in errors]
        pace = abs(after - before) * (lane.interval / h)
        size = maximum(maximum(abs(before), pace), SMALLEST_STATE)
        shares.append(estimates.tip_error(*sizes) / size)
    return lane.interval * sum(gained[1:], gained[0]) * sum(shares[1:], shares[0])


def joint_quantities(dynamics: Dynamics, lane: Lane, form: str) -> Quantities:
    """Positions and rates of joints from the fields of a form."""
    states = lane.get(dynamics.states, of=form)
    known = dict(zip(dynamics.states, states, strict=True))
    return Quantities(known, tuple(dynamics.arm.functions), dynamics.arm.sincos, lane)


def tip_norms(dynamics: Dynamics, lane: Lane, form: str = "{}") -> list[Any]:
    """Metres at the tip per unit of each coordinate, from the fields of a form."""
    arm = dynamics.arm
    x = Quantities(
        dict(zip(dynamics.states, lane.get(dynamics.states, of=form), strict=True)),
        (*arm.functions, arm.column_norms), arm.sincos, lane,
    )  # fmt: skip
    return x.each(f"n{k + 1}" for k in range(dynamics.count))


def tip_weights(dynamics: Dynamics, lane: Lane) -> list[Any]:
    """Metres at the tip per unit of the error of each coordinate."""
    norms, arm = tip_norms(dynamics, lane), dynamics.arm
    if dynamics.scene.tolerance is None:
        return norms
    lengths = lane.get(f"l{k + 1}" for k in range(arm.num_lengths))
    reach = sum(lengths[1:], lengths[0]) if lengths else 0.0  # an arm of sliders alone has none
    return [
        n if slides else estimates.tip_weight(n, reach, lane.tip_tolerance)
        for n, slides in zip(norms, arm.prismatic, strict=True)
    ]
