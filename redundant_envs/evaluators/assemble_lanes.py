"""The interval of a scene whose lanes take steps of their own, as text."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from redundant_envs.effects.hooks import Force
from redundant_envs.evaluators.quantities import Call, calls
from redundant_envs.integrators import error_control
from redundant_envs.integrators.tableaus import METHODS

if TYPE_CHECKING:
    from redundant_envs.evaluators.assemble import Assembly

MARK = "# ---- copied from here"


def steady_steps(a: Assembly) -> list[Call]:
    """Statements for ``steady``: steps per second that springs and dampers need at least."""
    arm, order, rates = a.scene.robot, [], []
    for i, (effect, hook) in enumerate(a.hooks):
        if not isinstance(hook, Force):
            continue
        rules = (
            (hook.stiffness, error_control.steps_of_spring, f"stiffness{i}", f"spring_steps{i}"),
            (hook.damping, error_control.steps_of_damper, f"damping{i}", f"damper_steps{i}"),
        )
        for function, rule, amount, rate in rules:
            if function is not None:
                order.append(Call((amount,), function, tuple(a.bound(effect, hook, function))))
                order.append(Call((rate,), rule, (amount, f"W{hook.joint + 1}")))
                rates.append(rate)
    if not rates:
        return []
    order = calls(["W1"], a.parameters, (arm.mobility_bounds,), {}) + order
    name = rates[0]
    for i, rate in enumerate(rates[1:]):
        order.append(Call((f"steady{i}",), error_control.more, (name, rate)))
        name = f"steady{i}"
    return [*order, Call(("steady",), error_control.more, (name, name))]


def controlled_interval(a: Assembly, used: list[Callable[..., Any]]) -> str:
    """Text of ``cross_interval``: one step for every lane, and more for those that need them."""
    from redundant_envs.evaluators.assemble import LANES, PLAN, RESULTS, TOLERANCE_NOT_REACHED, prefixed

    arm = a.scene.robot
    used.append(error_control.least_steps)
    turning = [v for v, slides in zip(arm.rates, arm.prismatic, strict=True) if not slides]
    fastest = f"abs({turning[0]}_before)"
    for v in turning[1:]:
        fastest = f"maximum({fastest}, abs({v}_before))"
    steady = "steady" if "steady" in a.rows else "0.0"
    numbers = (*(f"{s}_before" for s in a.states[:8]), *(f"command{k}" for k in range(1, 5)))
    stages = METHODS[a.scene.integrator].stages
    start = a.lane_function(
        "start", "Before an interval.", [],
        {**{f"{s}_before": s for s in a.states}, "error_sum": "0.0", "h": "interval"},
    )  # fmt: skip
    judge = a.lane_function(
        "judge",
        "After a single step: keep it, or mark the lane and put it back.",
        [
            f"steps = {prefixed(error_control.least_steps)}({fastest}, {steady}, interval)",
            # More steps do not help a lane whose state or effort is not finite.
            f"defect = {' + '.join(f'({n} - {n})' for n in numbers)}",
            "good = where(steps <= 1.0, where(error_sum <= tip_tolerance, 1.0, 0.0), 0.0)",
            "again = where(defect == 0.0, 1.0 - good, 0.0)",
        ],
        {
            **{s: f"where(again > 0.0, {s}_before, {s})" for s in a.states},
            "floor": "steps",
            "marked": "again",
            "evaluations": f"{stages}.0",
            "trouble": "0.0",
        },
    )
    places = {
        "H": "h", "INTERVAL": "interval", "ERROR_SUM": "error_sum", "TIP_TOLERANCE": "tip_tolerance",
        "BEFORE": f"{a.states[0]}_before", **{n.upper(): n for n in (*PLAN, *RESULTS)},
    }  # fmt: skip
    constants = [
        f"STATES = {len(a.states)}",
        f"STAGES = {stages}.0",
        f"MOST_STEPS = {error_control.MOST_STEPS}.0",
        f"TOLERANCE_NOT_REACHED = {TOLERANCE_NOT_REACHED}",
        f"RESULTS = {max(a.rows[n] for n in (*a.states, 'error_sum', *RESULTS)) + 1}",
        f"LIVE = {max(a.rows[n] for n in PLAN) + 1}",
        *(f"{name} = {a.rows[row] * LANES}" for name, row in places.items()),
    ]
    lanes = (Path(__file__).parent / "lanes.py").read_text(encoding="utf-8")
    body = '''@njit(inline="always", **OPTIONS)
def cross_interval(W, begin_block, end_block, count):
    """Advance some blocks by their interval; ``count`` is the number of lanes up to their end."""
    wide_vectors()
    marked = 0
    for b in range(begin_block, end_block):
        o = b * STRIDE
        start(W, o)
        step(W, o)
        judge(W, o)
        marked |= any_marked(W, o)
    if marked:
        redo(W, begin_block * LANES, count)'''
    return "\n\n\n".join(
        [
            start,
            judge,
            "\n".join(constants),
            f"any_marked = any_set({a.rows['marked']})",
            lanes.split(MARK, 1)[1].split("\n", 1)[1].strip(),
            body,
        ]
    )
