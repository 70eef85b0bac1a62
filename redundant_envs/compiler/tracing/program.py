"""Programs of lanes: generators with ``if`` and ``while`` on numbers, traced as state machines.

A program asks with ``yield`` for what all lanes do together, and goes on when it is done. On floats it simply
runs. On traced numbers the stretch from one request to the next is run once for each way that its conditions
can go; what the ways write into fields of the lane is merged. Fields are all that survives a request.
"""

import enum
import functools
import itertools
from collections.abc import Callable, Generator, Iterator
from typing import Any, NamedTuple

from redundant_envs.compiler.tracing.graph import Graph, Operation, setting
from redundant_envs.compiler.tracing.number import Traced, deciding, outlives
from redundant_envs.compiler.tracing.ways import Exclusive, Tree, Ways, ending, every_way, merged_fields, same
from redundant_envs.language.algebra import any_of, logical_not, where

ENDED = -1.0
"""The number of a state in which a program has ended."""
MISSING = "unset"

Program = Callable[[Any], Generator[enum.Enum, None, None]]
Writes = dict[str, Any]


class OnlyNumbers:
    """In place of a local variable that holds nothing but numbers of lanes."""


class WaitingPoint(NamedTuple):
    """Where a program may wait."""

    number: int
    request: enum.Enum | None  # what it has asked for; None before it begins
    answers: tuple[tuple[bool, ...], ...]  # to the conditions of each stretch that leads there


class Machine:
    """The states of a program, and what it writes between them.

    Every stretch also writes the field "state"; for each request whether the program asks for it, in the
    field that is the value of the request; and "complete", whether the program has ended. The lane is read
    anew with ``lane.begin(graph)`` before each stretch, which sets ``lane.written()``;
    ``lane.loaded(name)`` is a field as it is in memory.
    """

    def __init__(self, program: Program, lane: Any, requests: type[enum.Enum], whole: bool = False) -> None:
        self.program, self.lane, self.requests = program, lane, requests
        self.states: list[WaitingPoint] = [WaitingPoint(0, None, ())]
        self.ways: dict[int, Tree] = {}
        self.graphs: dict[enum.Enum | None, Graph] = {}
        self._rehearsals: dict[enum.Enum | None, Graph] = {}
        self._found: dict[Any, tuple[WaitingPoint, Any]] = {}
        for state in self.states:  # grows while it is explored
            graph = self.graphs.setdefault(state.request, Graph(whole))
            name = "the beginning" if state.request is None else f"the stretch after {state.request.name}"
            self.ways[state.number] = every_way(graph, functools.partial(self._run, state), name)

    def _run(self, state: WaitingPoint, ways: Ways) -> Writes:
        """One way of the stretch after a state."""
        rehearsal = self._rehearsals.setdefault(state.request, Graph(ways.graph.whole))
        running = self.program(self.lane)
        for answers in state.answers:
            self.lane.begin(rehearsal)
            with setting(deciding, Ways(rehearsal, answers).answer):
                next(running)
        self.lane.begin(ways.graph)
        request = next(running, None)
        number = ENDED if request is None else self._reached(state, request, running, ways)
        written = self.lane.written()
        for x in written.values():
            if isinstance(x, Traced) and x.graph is not ways.graph and isinstance(x.value, Operation):
                outlives()
        return {**written, "state": number}

    def _reached(self, before: WaitingPoint, request: enum.Enum, running: Any, ways: Ways) -> float:
        """Number of the state in which the program waits now."""
        place: list[tuple[Any, ...]] = []
        values: dict[tuple[str, str], Any] = {}
        while running is not None:
            frame = getattr(running, "gi_frame", None)
            if frame is None:
                raise TypeError(
                    f"{place[-1][0]} yields from {type(running).__name__}, which does not tell where it "
                    "waits; yield from a generator function"
                )
            place.append(_place(frame))
            variables = ((n, _without_numbers(v)) for n, v in frame.f_locals.items())
            values |= {(frame.f_code.co_qualname, n): v for n, v in variables if v is not OnlyNumbers}
            running = running.gi_yieldfrom
        key = tuple(place)
        if key not in self._found:
            answers = (*before.answers, tuple(a for _, a in ways.taken))
            self._found[key] = WaitingPoint(len(self.states), request, answers), values
            self.states.append(self._found[key][0])
        state, known = self._found[key]
        for where_, name in {*known, *values}:
            a, b = known.get((where_, name), MISSING), values.get((where_, name), MISSING)
            if not _alike(a, b):
                raise TypeError(
                    f"{where_} reaches one yield with different local variables: {name} is {a!r} in one way "
                    f"and {b!r} in another; keep it in a field of the lane, or ask at two places, not in a "
                    "loop"
                )
        return float(state.number)

    def after(self, request: enum.Enum | None, answered: str, first: bool = False) -> Writes:
        """What is written by all stretches after a request, or after the ``first`` one of a program, where
        the field ``answered`` is true."""
        lane = self.lane
        lane.begin(self.graphs[request])
        states = [s for s in self.states if s.request is request and (len(s.answers) == 1 or not first)]
        parts = [(s, self.ways[s.number]) for s in states]
        here = lane[answered]
        ends: list[tuple[Any, Tree]] = []
        while (end := ending([tree for _, tree in parts])) is not None:
            condition, way, rest = end
            ends.append((here & condition, way))
            here = here & logical_not(condition)
            parts = [(s, tree) for (s, _), tree in zip(parts, rest, strict=True)]
        if len(parts) > 1:
            ends += [(here & (lane["state"] == float(s.number)), tree) for s, tree in parts]
        else:
            ends.append((here, parts[0][1]))
        tree = Exclusive(ends)
        results = [way.result for way in tree.leaves]
        before = {name: lane.loaded(name) for result in results for name in result}
        total = merged_fields(tree, {n: [r.get(n, x) for r in results] for n, x in before.items()})
        for asked in self.requests:
            waits = [total["state"] == float(s.number) for s in self.states if s.request is asked]
            if waits:
                total[asked.value] = where(any_of(waits), 1.0, 0.0)
        total["complete"] = where(total["state"] == ENDED, 1.0, 0.0)
        return {n: x for n, x in total.items() if n not in before or not same(x, before[n])}


def _without_numbers(value: Any) -> Any:
    """What of a local variable a way may not depend on: all but numbers of lanes, and objects that hold them.
    Without objects a loop over some would be one state that never ends."""
    if isinstance(value, Traced | Iterator):
        return OnlyNumbers
    if isinstance(value, tuple | list | set | frozenset | dict):
        items = value.items() if isinstance(value, dict) else value
        entries = [_without_numbers(v) for v in items if not isinstance(v, int | float)]
        return tuple(v for v in entries if v is not OnlyNumbers and v != ()) or OnlyNumbers
    return value


def _alike(a: Any, b: Any) -> bool:
    """Whether two values of a local variable are the same in all ways."""
    if a is MISSING or b is MISSING:
        return isinstance(b if a is MISSING else a, tuple)  # results of a function, mostly numbers
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(_alike, a, b))
    return a is b or (type(a) is type(b) and (a == b) is True)


def _place(frame: Any) -> tuple[Any, ...]:
    """Function, line and column of the yield at which a generator waits: not its place in the bytecode."""
    line, _, column, _ = next(itertools.islice(frame.f_code.co_positions(), frame.f_lasti // 2, None))
    return frame.f_code.co_qualname, line, column
