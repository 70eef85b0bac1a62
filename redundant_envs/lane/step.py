"""One step of a lane: its state after ``h``, its error estimate and the bounds of its sliders' motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from redundant_envs.algebra import maximum, sqrt, where
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
    stops, sides = dynamics.active if held else (), (b.side for b in dynamics.laws)
    names = (*dynamics.commands, *dynamics.numbers, *dynamics.effect_states.updated, *stops, *sides)
    return dict(zip(names, lane.get(names), strict=True))


def contact_quantities(dynamics: Dynamics, states: Sequence[Any], numbers: dict[str, Any]) -> Quantities:
    """Quantities while sliders rest at their stops, accelerations among them."""
    x = dynamics.quantities(states, numbers, held=bool(dynamics.holding))
    x.update({f"held{k + 1}": 0.0 for k in dynamics.arm.sliders()})
    x.update({held_of(b): abs(numbers[b.active]) for b in dynamics.holding})
    return x


def held_of(b: Boundary) -> str:
    """The quantity that is 1 while a slider rests at its stop."""
    return f"held{b.number}"


def pull(x: Quantities, b: Boundary, side: Any) -> Any:
    """Force with which its stop has to pull a resting slider; 0 for a free one."""
    return where(x[held_of(b)] > 0.0, side * x[f"hold{b.number}"], 0.0)


def watched_acceleration(dynamics: Dynamics, b: Boundary, x: Quantities) -> Any:
    """Acceleration of the coordinate of a boundary; for a slider that rests, the pull of its stop."""
    if b.joint is None:
        return coordinates.acceleration(dynamics, b, x)
    if b.bounces:
        return where(x[held_of(b)] > 0.0, pull(x, b, x[b.active]), x[f"qdd{b.number}"])
    shares = enumerate(dynamics.arm.motor_map[:, b.joint].tolist(), start=1)
    parts = [x[f"qdd{k}"] if share == 1.0 else share * x[f"qdd{k}"] for k, share in shares if share != 0.0]
    return sum(parts[1:], parts[0])


SMALLEST_STATE = 1e-300
"""Smallest number by which an error is divided."""


def lane_step(dynamics: Dynamics, lane: Lane, h: Any) -> Step:
    """A step of length ``h``.

    It watches, in this order: the coordinates of boundaries, values that change their signs at kinks, and
    speeds of :attr:`Dynamics.watched_sliders`.
    """
    held = bool(dynamics.holding)
    numbers = known_numbers(dynamics, lane, held)
    count, width = dynamics.count, len(dynamics.states)

    def derivatives(*values: Any) -> list[Any]:
        quantities = contact_quantities if held else Dynamics.quantities
        x = quantities(dynamics, values[:width], dict(zip(numbers, values[width:], strict=True)))
        results = dynamics.accelerations(x)
        results += [watched_acceleration(dynamics, b, x) for b in dynamics.boundaries]
        results += kink_values(dynamics.scene.attached, dynamics.kinks, x)
        return [*results, *(values[count + k] for k in sliders)]

    kinks, sliders = levels_of(dynamics.kinks), dynamics.watched_sliders
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
    if dynamics.scene.integrator == "dop853":
        names = tuple(name for name in dynamics.states if name != "work")
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
    rates = zip(tip_norms(dynamics, lane), step.velocities, lane.get(dynamics.arm.rates), strict=True)
    gained = [norm * abs(after - before) for norm, after, before in rates]
    shares = []
    for k, name in enumerate(dynamics.effect_states.integrated):
        before, after = lane[name], step.others[k]
        errors = (step.error6, step.h6), (step.error5, step.h5), (step.error3, step.h3)
        sizes = [abs(error[2 * dynamics.count + k]) * factor for error, factor in errors]
        pace = abs(after - before) * (lane.interval / h)
        size = maximum(maximum(abs(before), pace), SMALLEST_STATE)
        shares.append(estimates.tip_error(*sizes) / size)
    return lane.interval * sum(gained[1:], gained[0]) * sum(shares[1:], shares[0])


def tip_norms(dynamics: Dynamics, lane: Lane, form: str = "{}") -> list[Any]:
    """Metres at the tip per unit of each coordinate, from the fields of a form."""
    x = coordinates.quantities_of_arm(dynamics, lane, form, dynamics.arm.column_norms)
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
