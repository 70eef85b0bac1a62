"""Programs of lanes are traced as state machines, if all that goes on after a request is in fields.

``lane/test_evaluators_agree.py`` compares those of the engine with the same on floats.
"""

import enum
import itertools
import textwrap

import pytest

from redundant_envs.compiler.tracing.graph import Graph
from redundant_envs.compiler.tracing.program import Machine
from redundant_envs.simulator.lane.fields import SCRATCH, STATE, Layout, Variable
from redundant_envs.simulator.lane.memory import TracedLane


class Ask(enum.Enum):
    """What the programs of these tests ask for."""

    ADD = "adding"


def trace(program):
    truths = [Variable(n, "", n, SCRATCH, truth=True) for n in ("answered", "complete", "adding")]
    layout = Layout([*(Variable(n, "", n, STATE) for n in ("x", "y", "d", "state", "count")), *truths])
    machine = Machine(program, TracedLane(layout, Graph()), Ask, whole=True)
    for ask in (None, Ask.ADD):
        machine.after(ask, "answered")


class Part:
    """One of several objects that ask alike."""

    def __init__(self, field):
        self.field = field

    def ask(self, lane):
        yield Ask.ADD
        lane[self.field] = 1.0


OUTLIVES = (
    r"outlives a yield .*; keep it in a field before \(lane.name = x\) and read that after \(lane.name\)"
)
DIFFERENT = (
    r"reaches one yield with different local variables: \w+ is .* in one way and .* in another; "
    "keep it in a field of the lane, or ask at two places, not in a loop"
)
REFUSED = {
    "a number": ("x = lane.x + 1.0\nyield Ask.ADD\nlane.y = x", OUTLIVES),
    "a condition": ("near = lane.x < 1.0\nyield Ask.ADD\nif near:\n    lane.y = 1.0", OUTLIVES),
    "words": ("kind = 'near' if lane.x < 1.0 else 'far'\nyield Ask.ADD", DIFFERENT),
    "counts": ("for k in range(3):\n    yield Ask.ADD", DIFFERENT),
    "objects": ("for part in PARTS:\n    yield from part.ask(lane)", DIFFERENT),
    "objects of a list": ("rest = [*PARTS]\nwhile rest:\n    yield from rest.pop().ask(lane)", DIFFERENT),
    "parts in a chain": (
        "yield from itertools.chain(*(part.ask(lane) for part in PARTS))",
        "program yields from chain, which does not tell where it waits; yield from a generator function",
    ),
}


@pytest.mark.parametrize(("body", "words"), REFUSED.values(), ids=REFUSED)
def test_what_goes_on_after_a_yield_beside_fields_is_refused(body, words):
    found = {"Ask": Ask, "PARTS": (Part("x"), Part("y")), "itertools": itertools}
    source = f"def program(lane):\n{textwrap.indent(body, '    ')}"
    exec(compile(source, "program.py", "exec"), found)
    with pytest.raises(TypeError, match=words):
        trace(found["program"])
