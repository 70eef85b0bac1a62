"""Programs of lanes: traced as state machines they do what they do on floats."""

import enum
import itertools
import textwrap

import numpy as np
import pytest

from redundant_envs.compiler.tracing.graph import Graph
from redundant_envs.compiler.tracing.number import value_of
from redundant_envs.compiler.tracing.program import ENDED, Machine
from redundant_envs.simulator.lane.direct import evaluate
from redundant_envs.simulator.lane.fields import SCRATCH, STATE, Layout, Variable
from redundant_envs.simulator.lane.memory import Lane, TracedLane


class Ask(enum.Enum):
    """What the programs of these tests ask for."""

    ADD = "adding"
    HALVE = "halving"


ACTIONS = {Ask.ADD: ("x", lambda x, d: x + d), Ask.HALVE: ("y", lambda y, d: 0.5 * y)}
"""The field that a request changes, and how, from the field and from d."""
GIVEN = ("x", "y", "d")


def layout():
    fields = [Variable(n, "", n, STATE) for n in (*GIVEN, "state", "count")]
    truths = ("answered", "complete", "large", *(ask.value for ask in Ask))
    return Layout([*fields, *(Variable(n, "", n, SCRATCH, truth=True) for n in truths)])


class Traced:
    """A program as functions of lanes, by the interpreter."""

    def __init__(self, program):
        self.layout = layout()
        self.machine = Machine(program, TracedLane(self.layout, Graph()), Ask, whole=True)
        self.functions = {
            ask: self.machine.after(ask, "answered") for ask in (None, *Ask) if ask in self.machine.graphs
        }
        self.names = {self.layout.row_of(n): n for n in self.layout.fields}

    def apply(self, ask, fields):
        written = self.functions[ask]
        found = evaluate(
            [value_of(x) for x in written.values()], lambda place: fields.get(self.names[place], 0.0)
        )
        fields |= dict(zip(written, found, strict=True))

    def run(self, **columns):
        """Fields at the end of the program, from columns of numbers."""
        fields = {n: np.array(x, dtype=float) for n, x in columns.items()}
        count = len(fields["x"])
        fields |= {"answered": np.ones(count), "state": np.full(count, -2.0)}
        self.apply(None, fields)
        for _ in range(10_000):
            waiting = {ask: np.broadcast_to(fields.get(ask.value, 0.0), count) > 0.0 for ask in Ask}
            if not any(w.any() for w in waiting.values()):
                assert (np.broadcast_to(fields["complete"], count) == 1.0).all()
                assert (np.broadcast_to(fields["state"], count) == ENDED).all()
                return fields
            ask = next(ask for ask in Ask if waiting[ask].any())
            name, action = ACTIONS[ask]
            fields[name] = np.where(waiting[ask], action(fields[name], fields["d"]), fields[name])
            fields["answered"] = np.where(waiting[ask], 1.0, 0.0)
            self.apply(ask, fields)
        raise AssertionError("the program does not end")


def on_floats(program, **numbers):
    """Fields at the end of a program of one lane, and what it has asked for."""
    known = {n: np.float64(x) for n, x in numbers.items()}
    lane, asked = Lane(layout(), lambda n: known.get(n, np.float64(0.0))), []
    for ask in program(lane):
        name, action = ACTIONS[ask]
        lane[name] = action(lane[name], lane["d"])
        asked.append(ask)
    return lane, asked


def halves(lane):
    """Asks until y is small; whether it was large before."""
    lane.large = lane.y > 4.0
    while lane.y > 1.0:
        yield Ask.HALVE
    return lane.large


def nested(lane):
    """Loops, early ends, and a part that is a program, too."""
    lane.count = 0.0
    while lane.count < 6.0:
        yield Ask.ADD
        if lane.x > 9.0 or (lane.d < 0.0 and lane.x < -3.0):
            lane.y = -1.0
            return
        if lane.x > lane.y:
            if (yield from halves(lane)):
                lane.x = lane.x - 2.0
                continue
            lane.y = lane.y + 5.0
        lane.count = lane.count + 1.0
    lane.y = lane.y * 2.0


def two_places(lane):
    """One request at two places: each lane goes on where it waits."""
    if lane.x < lane.y:
        yield Ask.ADD
        lane.count = lane.count + 1.0
    else:
        yield Ask.ADD
        lane.count = lane.count - 1.0
    if not lane.x > 2.0:
        yield Ask.HALVE


LANES = list(itertools.product([-4.0, -0.5, 0.0, 1.0, 3.0, 7.0, 20.0], repeat=3))


@pytest.mark.parametrize(
    ("program", "ways", "states"),
    [(nested, 20, 3), (two_places, 2, 4)],
    ids=lambda x: getattr(x, "__name__", x),
)
def test_a_program_on_floats_and_its_traced_graph_agree_on_all_lanes(program, ways, states):
    """They ask for different things, and wait at different places."""
    traced, asked = Traced(program), set()
    found = traced.run(**dict(zip(GIVEN, np.array(LANES).T, strict=True)))
    for k, numbers in enumerate(LANES):
        lane, requests = on_floats(program, **dict(zip(GIVEN, numbers, strict=True)))
        asked.add(tuple(requests))
        for name in (*GIVEN, "count"):
            assert np.broadcast_to(found.get(name, 0.0), len(LANES))[k] == lane[name], (name, numbers)
    assert len(asked) >= ways
    assert len(traced.machine.states) == states


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
    "set in one way": ("if lane.x < 1.0:\n    kind = 1\nyield Ask.ADD", DIFFERENT),
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
        Traced(found["program"])


def many_ways(lane):
    yield Ask.ADD
    for k in range(9):
        if lane.x > float(k) * lane.d:
            lane.count = lane.count + 1.0
        elif lane.y > float(k):
            lane.count = lane.count - 1.0
    yield Ask.ADD


def test_a_stretch_with_more_than_256_ways_is_refused():
    words = "the stretch after ADD has more than 256 ways; let a function marked with @branches"
    with pytest.raises(ValueError, match=words):
        Traced(many_ways)
