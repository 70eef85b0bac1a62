"""The loops of an environment around the step: actions, task, reset and observation, as text."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from typing import Any

from redundant_envs.algebra import gives_of
from redundant_envs.evaluators.assemble import (
    BAD_ACTION,
    BLOCKS,
    EVENT_BUDGET,
    LANES,
    NON_FINITE,
    PLACES,
    SPEED_BOUND,
    Assembly,
)
from redundant_envs.evaluators.quantities import Call, calls
from redundant_envs.evaluators.text import block, indent
from redundant_envs.scene import identifier
from redundant_envs.tasks.limits import depth_beyond, hard_stops, narrowed, spring_limits
from redundant_envs.tasks.reach import ReachTask, goal_error

STEP, RESET, OBSERVE, CHECKED_STEP = 0, 1, 2, 3
"""What a call of the kernel does."""
DISABLED, NEXT_STEP, SAME_STEP = 0, 1, 2
"""Autoreset modes of the kernel."""

SIGNATURES = {
    "environment": (
        "void(float64[::1], float32[::1], float32[::1], float64[:, ::1], uint32[:, ::1], int64, int64, int64)"
    ),
    "goal_reward": "void(float64[:, ::1], float64[:, ::1], float64, float64, float64[::1], float64[::1])",
}
PAIR = 7 * LANES
"""Numbers of the memory that goal_reward needs: a row for each of its six arguments, and its result."""
ENDS = ("reward", "terminated", "truncated")  # the first outputs


def task_kernels(assembly: Assembly) -> tuple[list[str], list[Callable[..., Any]]]:
    """Text of the environment's kernels, and the dialect functions they call."""
    task = assembly.task
    assert task is not None
    used: list[Callable[..., Any]] = []
    blocks = [
        _command(assembly),
        _settle(assembly, task, used),
        _begin(assembly, task, used),
        _observe(assembly, task, used),
        _store(assembly),
        _environment(assembly),
        _goal_reward(assembly, task, used),
        f"SIGNATURES = {SIGNATURES!r}",
    ]
    return blocks, used


def _statements(
    a: Assembly, task: ReachTask, wanted: Iterable[str], known: Iterable[str], used: list[Any],
    functions: Iterable[Callable[..., Any]] | None = None,
) -> list[str]:  # fmt: skip
    """Lines that compute quantities of the arm and the task."""
    if functions is None:
        functions = (*a.scene.robot.functions, *task.functions(a.scene))
    angles = {**a.scene.robot.sincos, **task.angles}
    lines: list[str] = []
    for call in calls(wanted, known, tuple(functions), angles, a.aliases):
        a.names.emit(call, lines, used)
    return lines


def _command(a: Assembly) -> str:
    """Actions to efforts: saturate and count; a bad one is noted and commands nothing."""
    lines = ["count = 0.0", "defect = 0.0"]
    writes = {f"{s}_before": s for s in a.states}
    for k in range(1, 5):
        lines += [
            f"clipped{k} = minimum(maximum(action{k}, -1.0), 1.0)",
            f"count = count + where(clipped{k} != action{k}, 1.0, 0.0)",
            f"defect = defect + (action{k} - action{k})",
            f"action{k}_used = where(action{k} - action{k} == 0.0, clipped{k}, 0.0)",
        ]
        writes[f"action{k}"] = f"action{k}_used"
        writes[f"command{k}"] = f"action{k}_used * effort_limits_limits_{k - 1}"
    writes["numerics"] = f"where(defect == 0.0, 0.0, {BAD_ACTION})"
    writes["saturated"] = "saturated + where(defect == 0.0, count, 0.0)"
    return a.lane_function("command", "Efforts from actions.", lines, writes)


def _settle(a: Assembly, task: ReachTask, used: list[Any]) -> str:
    """After the step: trouble, task memory, reward and the ends of episodes."""
    first, second, third, fourth = (f"abs({v})" for v in a.scene.robot.rates)
    fastest = f"maximum(maximum({first}, {second}), maximum({third}, {fourth}))"
    undo = a.lanes.undo if a.lanes else {s: f"{s}_before" for s in a.states}
    lines = [
        f"defect = {' + '.join(f'({s} - {s})' for s in a.states)}",
        f"code = numerics + where(defect == 0.0, 0.0, {NON_FINITE})",
        *([f"code = code + where(trouble >= {EVENT_BUDGET}, trouble, 0.0)"] if a.lanes else []),
        f"fast = where(code > 0.0, 0.0, where({fastest} > speed_bound, {SPEED_BOUND}, 0.0))",
        *(["code = code + fast"] if task.speed_bound_ends else []),
        # A lane in trouble goes back to its last good state; its neighbours do not notice.
        *(f"{s} = where(code > 0.0, {undo[s]}, {s})" for s in a.states),
    ]
    terms = task.reward_terms()
    earned = [t for t in terms if t != "end_term"]
    known = {*a.states, *a.numbers, *task.memory, *a.actions}
    lines += _statements(a, task, [*earned, *task.renewed.values(), *task.measures], known, used)
    if len(earned) < len(terms):
        lines += ["ended = code", f"paid = {' + '.join(f'({t}_sum + {t})' for t in earned)}"]
        lines += _statements(a, task, ["end_term"], {"ended", "paid"}, used)
    told = "code" if task.speed_bound_ends else "code + fast"
    writes = {
        **{s: s for s in a.states},
        **{m: f"where(code > 0.0, {undo[m]}, {m})" for m in (a.lanes.modes if a.lanes else ())},
        **task.renewed,
        **{f"{t}_sum": f"{t}_sum + {t}" for t in terms},
        "numerics": f"{told} + where(trouble < {EVENT_BUDGET}, trouble, 0.0)" if a.lanes else told,
        "steps": "steps + 1.0",
        "reward": " + ".join(terms),
        "terminated": "where(code > 0.0, 1.0, 0.0)",
        "truncated": "where(steps + 1.0 >= limit, 1.0, 0.0)",
        "is_success": "is_success",
        "touched_new": "touched_new",
    }
    rules = {
        "evaluations_sum": "evaluations_sum + evaluations",
        "events_sum": "events_sum + events",
        "error_most": "maximum(error_most, error_sum)",
    }
    writes |= {name: rules[name] for name in a.spent}
    return a.lane_function("settle", "Reward, success and trouble.", lines, writes)


def _begin(a: Assembly, task: ReachTask, used: list[Any]) -> str:
    """A new episode of one lane, all from the counter-based draws of its key."""
    arm = a.scene.robot
    given = [f for f in arm.functions if "phi1" not in gives_of(f)]
    functions = (
        *given, *task.functions(a.scene), *task.begin_functions, arm.coordinates_of_joints,
    )  # fmt: skip
    drawn = [m for m in task.memory if m not in task.renewed]
    wanted = [*arm.coordinates, *drawn]
    lines, ranges = _start_ranges(a, task, used)
    lines += _statements(a, task, wanted, {*a.draws, *a.numbers, *ranges}, used, functions)
    zero = [*arm.rates, *(m for m in a.memory if m not in drawn)]
    zero += [*a.lanes.modes, "next_step"] if a.lanes else []
    zero += task.results
    writes = {**{w: w for w in wanted}, **dict.fromkeys(zero, "0.0")}
    place = a.lane_function("place", "Start and goal from draws.", lines, writes, lanes=1)
    body = ['"""A new episode of lane i, environment n, from its key."""']
    for g in range((task.draws + 3) // 4):
        words = ", ".join(f"word{4 * g + k}" for k in range(4))
        body.append(
            f"{words} = philox(np.uint64(tickets[n, 0]), np.uint64(tickets[n, 1]), "
            f"np.uint64({g}), np.uint64(0), np.uint64(tickets[n, 2]), np.uint64(tickets[n, 3]))"
        )
    body += [f"{a.at(u)} = uniform(word{k})" for k, u in enumerate(a.draws)]
    body.append("place(W, o + i)")
    return f"{place}\n\n\n@njit(**OPTIONS)\ndef begin(W, o, i, tickets, n):\n{indent(body, 1)}"


def _start_ranges(a: Assembly, task: ReachTask, used: list[Any]) -> tuple[list[str], list[str]]:
    """Lines that give each joint's range of starts inside the lane's own limits, and what they give."""
    lines: list[str] = []
    names: list[str] = []
    limits = [*spring_limits(a.scene), *hard_stops(a.scene)]  # a hard stop has the last word
    for joint in range(4):
        ends = f"start_low{joint + 1}", f"start_high{joint + 1}"
        first = task.start_range(a.scene, joint)
        lines += [f"{end} = {identifier(text)}" for end, text in zip(ends, first, strict=True)]
        for limited, lower, upper in limits:
            if limited == joint:
                a.names.emit(Call(ends, narrowed, (*ends, identifier(lower), identifier(upper))), lines, used)
        names += ends
    return lines, names


def _beyond_limit(a: Assembly, used: list[Any]) -> list[str]:
    """A line that tells how far the farthest joint is beyond the limit of a spring."""
    depths = []
    for joint, lower, upper in spring_limits(a.scene):
        depths.append(f"{a.names.of(depth_beyond)}(phi{joint + 1}, {identifier(lower)}, {identifier(upper)})")
    used.append(depth_beyond)
    return [f"beyond_limit = {functools.reduce('maximum({}, {})'.format, depths)}"]


def _observe(a: Assembly, task: ReachTask, used: list[Any]) -> str:
    """What lanes observe: a function of the state and the goal alone."""
    pure = [n for n in (*task.measures, *PLACES) if n not in (*a.memory, *task.results)]
    known = {*a.states, *a.numbers, *task.memory}
    limited = [f"phi{joint + 1}" for joint, *_ in spring_limits(a.scene)]
    lines = _statements(a, task, [*a.observed, *pure, *limited], known, used)
    if limited:
        lines += _beyond_limit(a, used)
    writes = dict(zip(a.shown, (*a.observed, *a.outputs), strict=True))
    return a.lane_function("observe", "Observations and outputs, side by side.", lines, writes, apart=True)


def _store(a: Assembly) -> str:
    observed, outputs = len(a.observed), len(a.outputs)
    first = a.every_row["out_reward"] * LANES
    body = [
        '"""Copy what lane i of a block shows to line n of obs and column n of out."""',
        f"for k in range({observed}):",
        f"    obs[n * {observed} + k] = S[{a.every_row['obs_0'] * LANES} + k * {LANES} + i]",
        f"for k in range({outputs}):",
        f"    out[k, n] = S[{first} + k * {LANES} + i]",
    ]
    show = [
        '"""Observe a block and copy what its lanes show to the tables."""',
        "wide_vectors()",
        "observe(W, o, S, 0)",
        f"if lanes == {LANES}:",
        f"    give_observed(S, 0, obs, first_lane * {observed})",
        f"    for k in range({outputs}):",
        f"        for i in range({LANES}):",
        f"            out[k, first_lane + i] = S[{first} + k * {LANES} + i]",
        "else:",
        "    for i in range(lanes):",
        "        store(S, i, first_lane + i, obs, out)",
    ]
    rows = [a.every_row[f"obs_{k}"] for k in range(observed)]
    return (
        f"give_observed = give({rows})\n\n\n"
        f"@njit(**OPTIONS)\ndef store(S, i, n, obs, out):\n{indent(body, 1)}\n\n\n"
        "@njit(inline='always', **OPTIONS)\n"
        f"def show(W, o, S, first_lane, lanes, obs, out):\n{indent(show, 1)}"
    )


def _environment(a: Assembly) -> str:
    """One call for all lanes: step, reset or observe, with autoreset."""
    done = f"{a.at('terminated')} + {a.at('truncated')} > 0.0"
    take = [
        f"if lanes == {LANES}:",
        "    take_actions(actions, 4 * first_lane, W, o)",
        "else:",
        "    for i in range(lanes):",
        *(f"        {a.at(f'action{k + 1}')} = actions[4 * (first_lane + i) + {k}]" for k in range(4)),
        "command(W, o)",
    ]
    settle = [
        "settle(W, o)",
        f"if autoreset == {NEXT_STEP}:",
        "    for i in range(lanes):",
        "        if tickets[first_lane + i, 4]:",
        "            begin(W, o, i, tickets, first_lane + i)",
        "            tickets[first_lane + i, 4] = 2",
        f"        elif {done}:",
        "            tickets[first_lane + i, 4] = 1",
        "show(W, o, S, first_lane, lanes, obs, out)",
        f"if autoreset == {SAME_STEP}:",
        "    again = False",
        "    for i in range(lanes):",
        f"        if {done}:",
        "            store(S, i, count + first_lane + i, obs, out)",
        "            begin(W, o, i, tickets, first_lane + i)",
        "            tickets[first_lane + i, 4] = 1",
        "            again = True",
        "    if again:",
        "        show(W, o, S, first_lane, lanes, obs, out)",
        "        for i in range(lanes):",
        "            if tickets[first_lane + i, 4]:",
        f"                for k in range({len(ENDS)}):",
        "                    out[k, first_lane + i] = out[k, count + first_lane + i]",
    ]
    body = [
        '"""Step, reset or observe all environments.',
        "",
        "A ticket is the key of a lane's next episode and, as its last number, whether the lane is to",
        "begin or has begun. After an autoreset in the same step the second half of obs and out holds",
        "what was before it. A checked step whose actions are not all finite does nothing but give a",
        "first reward that is not a number.",
        '"""',
        "wide_vectors()",
        "count = actions.size // 4",
        f"S = W[{BLOCKS} * STRIDE :]",
        f"if op == {CHECKED_STEP}:",
        "    for k in range(actions.size):",
        "        if not abs(actions[k]) < np.inf:",
        "            out[0, 0] = np.nan",
        "            return",
        f"if op == {STEP} or op == {CHECKED_STEP}:",
        *block(a.block_loop(take, settle)),
        "else:",
        f"    for b in range((count + {LANES - 1}) // {LANES}):",
        "        o = b * STRIDE",
        f"        first_lane = b * {LANES}",
        f"        lanes = min({LANES}, count - first_lane)",
        f"        if op == {RESET}:",
        "            for i in range(lanes):",
        "                if tickets[first_lane + i, 4]:",
        "                    begin(W, o, i, tickets, first_lane + i)",
        "        show(W, o, S, first_lane, lanes, obs, out)",
    ]
    actions = [a.rows[f"action{k}"] for k in range(1, 5)]
    return (
        f"take_actions = take({actions})\n\n\n"
        "def environment(W, actions, obs, out, tickets, op, autoreset, substeps):\n" + indent(body, 1)
    )


def _goal_reward(a: Assembly, task: ReachTask, used: list[Any]) -> str:
    """The reward of the goal environments, from achieved and desired goals alone."""
    used += [goal_error, task.goal_reward]
    return (
        "def goal_reward_of(achieved_x, achieved_y, desired_x, desired_y, reach, "
        "goal_tolerance):\n"
        f"    _, _, distance = {a.names.of(goal_error)}("
        "achieved_x, achieved_y, desired_x, desired_y)\n"
        f"    return {a.names.of(task.goal_reward)}(distance, reach, goal_tolerance)\n\n\n"
        "goal_reward_lane = straight_line(goal_reward_of, reads=range(6), writes=(6,), lanes=1)\n\n\n"
        "def goal_reward(achieved, desired, reach, goal_tolerance, row, reward):\n"
        '    """Reward of pairs of achieved and desired goals, m; row is room for one pair."""\n'
        "    for n in range(reward.size):\n"
        "        row[0] = achieved[n, 0]\n"
        f"        row[{LANES}] = achieved[n, 1]\n"
        f"        row[{2 * LANES}] = desired[n, 0]\n"
        f"        row[{3 * LANES}] = desired[n, 1]\n"
        f"        row[{4 * LANES}] = reach\n"
        f"        row[{5 * LANES}] = goal_tolerance\n"
        "        goal_reward_lane(row, 0)\n"
        f"        reward[n] = row[{6 * LANES}]"
    )
