"""The stages of a step as calls of one right-hand side, and lane functions as LLVM functions.

Twelve copies of a right-hand side do not fit into a processor's instruction cache, so it becomes a
function of its own, in two parts that do not wait for each other. The later part follows from the
velocities of a stage and is a long chain. The earlier part, the sines above all, follows from its
positions alone; those are known before the accelerations of the stage before are. So a call does the
later part of its stage together with the earlier part of the next one.
"""

import itertools

from llvmlite import ir

from redundant_envs.evaluators.instructions import (
    DOUBLE,
    INT64,
    LANES,
    Emitter,
    Graph,
    Number,
    Operation,
    Rows,
    fuse,
    pointer,
    reached,
    specialise,
    value_of,
    widen,
)
from redundant_envs.evaluators.order import in_order

RETURNED = 4
"""Results of a call that processors return in registers."""


class Subroutine:
    """A function of the dialect that each stage calls.

    Its first ``positions`` arguments do not depend on the results of the stage before.
    """

    def __init__(self, function, positions, results):
        self.function = function
        self.positions = positions
        self.results = results

    def __call__(self, *numbers):
        graph = numbers[0].builder
        return tuple(Number(graph, r) for r in graph.stage(self, [n.value for n in numbers]))


class Stages:
    """The calls of a subroutine in a graph, and the LLVM functions they call.

    Arguments that are the same row in every call are loaded by the functions; what follows from such
    rows alone, the first of them finds for all. What the earlier part finds for the later one is carried
    to the next call in memory, in two places by turns.
    """

    def __init__(self, calls, caller, known):
        self.calls = calls
        self.subroutine = calls[0].extra
        self.type = calls[0].arguments[0].type
        if any(c.extra is not self.subroutine for c in calls):
            raise ValueError("a lane function calls two subroutines; give it one")
        for before, after in itertools.pairwise(calls):
            if before in reached(after.arguments[: self.subroutine.positions]):
                name = self.subroutine.function.__name__
                raise ValueError(f"positions given to {name} follow from its results in the stage before")
        columns = list(zip(*(c.arguments for c in calls), strict=True))
        self.given = [k for k, column in enumerate(columns) if any(a is not column[0] for a in column)]
        graph = Graph()
        numbers = [
            Number(graph, graph.load("given", k, self.type) if k in self.given else a)
            for k, a in enumerate(calls[0].arguments)
        ]
        results = [value_of(r, self.type) for r in self.subroutine.function(*numbers)]
        fuse(results)
        self.results, self.carried, self.shared = self._split(specialise(results, known))
        # Results that are the same number are given once.
        self.first = [self.results.index(r) for r in self.results]
        computed = [k for k, r in enumerate(self.results) if isinstance(r, Operation) and self.first[k] == k]
        self.returned, self.told = computed[:RETURNED], computed[RETURNED:]
        self.carriers = self.common = None
        again = self._with_shared(self.carried)
        self.functions = {
            "first": self._function(caller, "first", [], self.carried, self.shared),
            "middle": self._function(caller, "middle", self.results, again),
            "last": self._function(caller, "last", self.results, []),
        }

    def _split(self, results):
        """The results as they follow from velocities, carried and shared values, and what those are."""
        early, given = {}, {}
        for n in reached(results):
            is_given = n.name == "load" and n.extra[0] == "given"
            given[n] = is_given or any(given[a] for a in n.operands)
            early[n] = (
                n.extra[1] < self.subroutine.positions if is_given else all(early[a] for a in n.operands)
            )
        graph, carried = Graph(), []
        shared = {n for n in reached(results) if not given[n] and self._kept(n)}
        used = []

        def loaded(n):
            if not isinstance(n, Operation) or not self._kept(n):
                return None
            if n in shared:
                if n not in used:
                    used.append(n)
                return graph.load("shared", used.index(n), self.type)
            if early[n]:
                carried.append(n)
                return graph.load("carried", len(carried) - 1, self.type)
            return None

        later = self._replaced(results, loaded)
        # What is carried follows from shared values too.
        self._replaced(carried, lambda n: loaded(n) if n in shared else None)
        return later, carried, used

    def _kept(self, node):
        """Whether an operation is worth a place in memory."""
        return node.type == self.type and node.name not in ("load", "fneg")

    def _with_shared(self, nodes):
        """Operations that load what all stages share."""
        graph, places = Graph(), {n: k for k, n in enumerate(self.shared)}
        return self._replaced(
            nodes, lambda n: graph.load("shared", places[n], self.type) if n in places else None
        )

    def _replaced(self, nodes, replacement):
        """Operations anew, where ``replacement`` gives another one for some of those they follow from."""
        made = {}

        def anew(n):
            if not isinstance(n, Operation):
                return n
            if n not in made:
                made[n] = replacement(n) or (
                    n
                    if n.name == "load"
                    else Operation(n.name, [anew(a) for a in n.arguments], n.extra, n.type)
                )
            return made[n]

        return [anew(n) for n in nodes]

    def _function(self, caller, part, results, carried, shared=()):
        """An LLVM function: memory, places of shared values, of carried ones (two) and results, arguments."""
        made = ir.LiteralStructType([self.type] * len(self.returned)) if results else ir.VoidType()
        arguments = [DOUBLE.as_pointer()] * 5 + [self.type] * len(self.given)
        name = f"{caller.name}_{self.subroutine.function.__name__}_{part}"
        function = ir.Function(caller.module, ir.FunctionType(made, arguments), name)
        function.linkage = "internal"
        set.add(function.attributes, "noinline")
        widen(function)
        base, common, before, after, told, *values = function.args
        for argument in (base, common, before, after, told):
            argument.add_attribute("noalias")
        builder = ir.IRBuilder(function.append_basic_block())
        given = dict(zip(self.given, values, strict=True))
        places = {
            "row": Rows(builder, base),
            "shared": Rows(builder, common),
            "carried": Rows(builder, before),
            "given": lambda k, type_: given[k],
        }
        emitter = Emitter(builder, places)
        place = {n: (common, k) for k, n in enumerate(shared)}
        place |= {n: (after, k) for k, n in enumerate(carried)}
        for n in [*in_order([*results, *carried, *shared]), *carried]:
            emitter.value(n)
            if n in place:  # at once, so that it needs no register
                memory, k = place.pop(n)
                address = pointer(builder, memory, LANES * k, self.type)
                builder.store(emitter.value(n), address, align=8)
        if not results:
            builder.ret_void()
            return function
        for k, r in enumerate(self.told):
            address = pointer(builder, told, LANES * k, self.type)
            builder.store(emitter.value(results[r]), address, align=8)
        value = ir.Constant(made, ir.Undefined)
        for k, r in enumerate(self.returned):
            value = builder.insert_value(value, emitter.value(results[r]), k)
        builder.ret(value)
        return function

    def in_order(self, results):
        """What some results need, with sums for the next call before the present one.

        They fill its waits; sums for later ones would fill the registers.
        """
        nodes = reached(results)
        calls = {c: i for i, c in enumerate(self.calls)}
        ready, wanted = {}, {}  # calls that must be done before, and calls before it is needed
        for n in nodes:
            ready[n] = calls[n] + 1 if n in calls else max((ready[a] for a in n.operands), default=0)
        for c, i in calls.items():
            for k, a in enumerate(c.arguments):
                for n in reached([a]):
                    call = max(i - 1, 0) if k < self.subroutine.positions else i
                    wanted[n] = min(call, wanted.get(n, call))

        def place(n):
            return calls.get(n, max(ready[n], wanted.get(n, len(calls)) - 1)), n in calls

        return sorted(nodes, key=place)

    def emit(self, emitter, node):
        """The call of a stage; the first is preceded by the earlier part of its own."""
        i = self.calls.index(node)
        if self.carriers is None:
            sizes = (len(self.shared), *[len(self.carried)] * 2, len(self.told) * len(self.calls))
            self.common, *self.carriers, self.places = (self._memory(emitter.builder, n) for n in sizes)
            self._call(emitter, "first", self.carriers[::-1], node, None)
        carriers = self.carriers if i % 2 == 0 else self.carriers[::-1]
        if i + 1 == len(self.calls):
            return self._call(emitter, "last", carriers, None, node)
        return self._call(emitter, "middle", carriers, self.calls[i + 1], node)

    def _memory(self, builder, vectors):
        memory = builder.alloca(DOUBLE, ir.Constant(ir.IntType(32), LANES * max(1, vectors)))
        memory.align = 8 * LANES  # a vector that straddles cache lines is read twice
        return memory

    def _told(self, builder, call):
        """Where a call tells the results that it does not return."""
        return builder.gep(self.places, [ir.Constant(INT64, LANES * len(self.told) * call)])

    def result(self, emitter, node):
        """A result of a stage: returned, told in memory, or known without the call."""
        (stage,), k = node.arguments, self.first[node.extra]
        value = emitter.value(stage)
        if k in self.returned:
            return emitter.builder.extract_value(value, self.returned.index(k))
        if k in self.told:
            place = self._told(emitter.builder, self.calls.index(stage))
            address = pointer(emitter.builder, place, LANES * self.told.index(k), self.type)
            return emitter.builder.load(address, align=8)
        return self.results[k]

    def _call(self, emitter, part, carriers, upcoming, present):
        values = []
        for k in self.given:
            stage = upcoming if k < self.subroutine.positions else present
            unused = ir.Constant(self.type, ir.Undefined)
            values.append(emitter.value(stage.arguments[k]) if stage else unused)
        told = self._told(emitter.builder, self.calls.index(present) if present else 0)
        arguments = [emitter.places["row"].base, self.common, *carriers, told, *values]
        return emitter.builder.call(self.functions[part], arguments)


def emit(builder, results, base, known):
    """Emit what some results need of a graph whose rows begin at ``base``; gives their values.

    ``known`` maps rows to the numbers that all lanes are known to have in them.
    """
    fuse(results)
    calls = [n for n in reached(results) if n.name == "stage"]
    stages = Stages(calls, builder.function, known) if calls else None
    results = specialise(results, known)
    emitter = Emitter(builder, {"row": Rows(builder, base)}, stages)
    for node in stages.in_order(results) if stages else in_order(results):
        emitter.value(node)
    return [emitter.value(r) for r in results]
