"""A program as text: everything that it does, in the order of its operations."""

import re

from redundant_envs.compiler.tracing.flow import Kernel, Program
from redundant_envs.compiler.tracing.listing import function_lines, lines
from redundant_envs.compiler.tracing.passes.stages import Subroutine
from redundant_envs.simulator.lane.fields import SCRATCH, STATE, Layout, Variable
from redundant_envs.simulator.lane.memory import traced

LAYOUT = Layout([Variable(n, "", "", STATE) for n in ("x", "v")] + [Variable("f", "", "", SCRATCH)])


def printed(function):
    p = Kernel("probe", {"x": "f64"})
    p.call(traced("work", LAYOUT, function), x=p["x"])
    return list(lines(Program([p])))


def listed(function, *name_of, **more):
    """Lines of a function, without those of its memories."""
    found = function_lines(traced("work", LAYOUT, function, **more), *name_of)
    return [line.strip() for line in found if not line.startswith("  memories (")]


def test_a_function_is_its_operations_what_it_leaves_and_what_it_tells():
    def work(lane):
        lane.x = lane.x + 2.5 * lane.v
        return {("out", "f32", 1, 3): lane.x, ("fast", "i8", 0, 0): lane.v > 1.0}

    assert listed(work) == [
        "function work:", "%0 = state[0]", "%1 = state[1]", "%2 = * 2.5, %1", "%3 = + %0, %2",
        "%4 = > %1, 1.0", "state[0] <- %3", "out[1/3] (f32) <- %3", "fast[0/0] (i8) <- %4",
    ]  # fmt: skip
    assert listed(lambda lane: lane.set(["v"], [lane.x + 1.0]), lambda space, k: f"{space}.{'xv'[k]}") == [
        "function work:", "%0 = state.x", "%1 = + %0, 1.0", "state.v <- %1",
    ]  # fmt: skip


def test_tables_and_known_numbers_are_listed():
    found = listed(lambda lane: None, inputs={"efforts": ("f64", ("f",))}, known={"v": 0.0})
    assert "tables [('efforts', ('f64', 1))]" in found
    assert "known [(('state', 1), 0.0)]" in found
    assert found[-1] == "scratch[0] <- %0"


def test_a_kernel_is_its_loops_and_branches_and_calls():
    p = Kernel("walk", {"x": "f64", "n": "int"})
    function = traced("half", LAYOUT, lambda lane: lane.set(["x"], [lane.x * 0.5]))
    with p.each(p["n"]) as i, p.when(i > 2):
        p.call(function, x=p["x"] + i)
    text = "\n".join(lines(Program([p])))
    memories = "memories ('state', 'parameter', 'scratch', 'log')"
    assert f"function half:\n  {memories}\n  %0 = state[0]\n  %1 = * %0, 0.5\n  state[0] <- %1" in text
    assert "kernel walk(x: f64, n: int):" in text
    inside = text[text.index("kernel walk") :]
    steps = ("while", "< truth", "end", "> truth", "when", r"\+ f64", r"call int .* \('half'", "end", "end")
    assert re.search(".*".join(steps), inside, re.DOTALL)


def test_a_subroutine_is_listed_once_and_its_calls_where_they_are():
    rate = Subroutine(lambda x, v: (-2.0 * x,), 1, 1)

    def step(lane):
        for _ in range(2):
            (slope,) = rate(lane.x, lane.v)
            lane.x, lane.v = lane.x + lane.v, lane.v + slope

    found = listed(step)
    assert found[:4] == ["subroutine of work:", "%0 = given[0]", "%1 = * -2.0, %0", "gives %1"]
    assert found[4] == "function work:"
    calls = [line.split(" = ")[1] for line in found if " = stage " in line]
    assert calls[0] == "stage %0, %1"
    assert len(calls) == 2
    assert sum(" = result 0 %" in line for line in found) == 2


def test_programs_are_told_apart_by_the_places_of_arguments_whatever_they_are_called():
    """Machine code is kept by the text with plain names: that with other names takes these two for one."""
    doubled = (
        Subroutine(lambda k, g: (2.0 * k,), 1, 1, ("k", "g")),
        Subroutine(lambda g, k: (2.0 * g,), 1, 1, ("k", "g")),
        Subroutine(lambda k, g: (2.0 * g,), 1, 1, ("g", "k")),
    )
    one, same, other = (lambda lane, f=f: lane.set(["v"], f(lane.x, lane.v)) for f in doubled)
    named = [listed(f, lambda space, k: f"{space} {k}") for f in (one, same, other)]
    assert named[0][1:4] == ["%0 = k", "%1 = * 2.0, %0", "gives %1"]
    assert named[0] == named[1] == named[2]
    assert printed(one) == printed(same) != printed(other)
