"""Lanes with declared fields, on any kind of numbers."""

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

from redundant_envs.compiler.tracing.flow import LaneFunction, Output
from redundant_envs.compiler.tracing.graph import Graph
from redundant_envs.compiler.tracing.number import Condition, Number, value_of
from redundant_envs.language.algebra import where
from redundant_envs.simulator.lane.fields import EngineFields, Layout, Lifetime


class Lane(EngineFields):
    """One lane, or many alike: fields are read and set as attributes, or by ``lane[name]``. A field has the
    value that was set last, or, before it is set, that of ``load`` by its name."""

    __slots__ = ("_layout", "_load", "_now", "_written")

    def __init__(self, layout: Layout, load: Callable[[str], Any]) -> None:
        self._layout, self._load = layout, load
        self._now: dict[str, Any] = {}
        self._written: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._now:
            self._layout.row_of(name)
            value = self._load(name)
            self._now[name] = value > 0.0 if self._layout.fields[name].truth else value
        return self._now[name]

    def __setitem__(self, name: str, value: Any) -> None:
        self._layout.row_of(name)
        self._now[name] = self._written[name] = value

    if not TYPE_CHECKING:  # mypy knows the fields that are declared

        def __getattr__(self, name: str) -> Any:
            return self[name]

        def __setattr__(self, name: str, value: Any) -> None:
            if name.startswith("_"):
                object.__setattr__(self, name, value)
            else:
                self[name] = value

    def next_part(self) -> None:
        """Start a part that is computed apart from the previous ones: it has the same bits as alone."""

    def get(self, names: Iterable[str], of: str = "{}") -> list[Any]:
        """Several fields, ``of`` being a form of their names such as "{}_start"."""
        return [self[of.format(name)] for name in names]

    def values(self, names: Iterable[str], of: str = "{}") -> dict[str, Any]:
        """The same by their names, without the form."""
        return {name: self[of.format(name)] for name in names}

    def set(self, names: Iterable[str], values: Iterable[Any], of: str = "{}") -> None:
        for name, value in zip(names, values, strict=True):
            self[of.format(name)] = value

    def set_where(self, condition: Any, values: Mapping[str, Any]) -> None:
        """Give fields new values, by their names, where a condition holds."""
        for name, value in values.items():
            self[name] = where(condition, value, self[name])

    def copy(self, names: Iterable[str], of: str = "{}", to: str = "{}") -> None:
        """Set fields of one form to those of another."""
        names = tuple(names)
        self.set(names, self.get(names, of), to)

    def __contains__(self, name: str) -> bool:
        return name in self._layout

    def written(self) -> dict[str, Any]:
        """Fields that were set, and the last values of each: conditions as 1 or 0."""
        fields = self._layout.fields
        return {n: where(x, 1.0, 0.0) if fields[n].truth else x for n, x in self._written.items()}


class TracedLane(Lane):
    """A lane whose numbers are recorded in a graph; of a program, in one graph after the other."""

    __slots__ = ("_graph",)

    def __init__(self, layout: Layout, graph: Graph) -> None:
        super().__init__(layout, self.loaded)
        self._graph = graph

    def next_part(self) -> None:
        self._graph.part += 1

    def begin(self, graph: Graph) -> None:
        """Read all fields anew, as numbers of a graph."""
        self._graph = graph
        self._now.clear()
        self._written.clear()

    def loaded(self, name: str) -> Number:
        """A field as it is in memory."""
        return Number(self._graph, self._graph.load(*self._layout.row_of(name)))


def function_of(layout: Layout, name: str, written: Mapping[str, Any]) -> LaneFunction:
    """A function of lanes that stores values of a graph in fields."""
    stores = [(*layout.row_of(n), value_of(v)) for n, v in written.items()]
    asides = frozenset(layout.row_of(n) for n, f in layout.fields.items() if f.book)
    return LaneFunction(name, tuple(str(lifetime) for lifetime in Lifetime), stores, asides=asides)


def traced(
    name: str,
    layout: Layout,
    *procedures: Callable[[Lane], Mapping[tuple[str, str, int, int], Any] | None],
    inputs: Mapping[str, tuple[str, tuple[str, ...]]] | None = None,
    known: Mapping[str, float] | None = None,
    whole: bool = False,
    joins: bool = True,
) -> LaneFunction:
    """Record the effect of procedures on a lane, the last of which may return values for arrays, by (array,
    type of its elements, column, columns). ``inputs`` are arrays with their type and the fields that columns
    hold, ``known`` fields of certain numbers; ``whole`` is for :class:`Graph`, ``joins`` for
    :class:`LaneFunction`."""
    graph = Graph(whole)
    lane = TracedLane(layout, graph)
    for array, (_, fields) in (inputs or {}).items():
        lane.set(fields, [Number(graph, graph.load(array, k)) for k in range(len(fields))])
    *_, outputs = [procedure(lane) for procedure in procedures]
    function = function_of(layout, name, lane.written())
    for place, v in (outputs or {}).items():
        function.outputs.append(Output(*place, v.value if isinstance(v, Condition) else value_of(v)))
    function.inputs |= {array: (element, len(fields)) for array, (element, fields) in (inputs or {}).items()}
    function.joins = joins
    function.known = {layout.row_of(n): x for n, x in (known or {}).items()}
    return function
