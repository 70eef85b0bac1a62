"""The order of instructions.

A processor looks only about a hundred instructions ahead. In LLVM's order, made for few registers, it
waits for chains of divisions and sums although other instructions farther on could already begin. This
order moves these nearer.
"""

import heapq

from redundant_envs.compiler.tracing.graph import FREE, Operation, Value, reached

ISSUED = {4: 3, 8: 1}
"""Instructions that may begin in a cycle, by the lanes of a vector. Processors begin up to two with 8 lanes,
but with more than one here too many values are computed long before they are used (docs/design.md)."""
REGISTERS = 22
"""Values that may wait to be used before the order prefers to use them up (32 registers)."""
FAR = 120
"""Cycles between the first and the last use of a value beyond which it will wait in memory."""


def source_of(value: Operation) -> Operation:
    """The value for which an operand is another name."""
    while value.name in ("neg", "bit") and isinstance(value.arguments[0], Operation):
        value = value.arguments[0]
    return value


class Schedule:
    """Operations that wait to begin, and values that wait to be used."""

    def __init__(self, nodes: list[Operation]) -> None:
        self.users: dict[Operation, list[Operation]] = {n: [] for n in nodes}
        for n in nodes:
            for a in dict.fromkeys(n.operands):
                self.users[a].append(n)
        chain: dict[Operation, int] = {}
        """Cycles from the beginning of an operation to the end of all that follow from it."""
        for n in reversed(nodes):
            chain[n] = n.latency + max((chain[u] for u in self.users[n]), default=0)
        self.nodes = sorted(nodes, key=lambda n: -chain[n])
        self.rank = {n: k for k, n in enumerate(self.nodes)}
        """Place of an operation among all, those with the longest chains being the first."""
        self.inputs: dict[Operation, dict[Operation, None]] = {}
        self.uses: dict[Operation, list[Operation]] = {n: [] for n in nodes if n.name not in FREE}
        for n in self.uses:
            self.inputs[n] = dict.fromkeys(s for s in map(source_of, n.operands) if s in self.uses)
            for a in self.inputs[n]:
                self.uses[a].append(n)
        self.left = {a: len(users) for a, users in self.uses.items()}
        chains = {a: [chain[u] for u in users] for a, users in self.uses.items() if users}
        self.near = {a for a, some in chains.items() if max(some) - min(some) <= FAR}
        self.more_waiting = [int(n in self.near) for n in self.nodes]
        """How many more values wait to be used after an operation than before it."""
        for a in self.near:
            self._last_use_frees(a)
        self.missing = {n: len(set(n.operands)) for n in nodes}
        self.begins = dict.fromkeys(nodes, 0)
        self.coming = [(0, self.rank[n]) for n in nodes if self.missing[n] == 0]
        heapq.heapify(self.coming)
        self.ready: set[int] = set()
        self.waiting = 0

    def _last_use_frees(self, a: Operation) -> None:
        """Count that the only use left of a value, if there is one left, ends its waiting."""
        if self.left[a] == 1:
            for u in self.uses[a]:
                self.more_waiting[self.rank[u]] -= 1

    def done(self, n: Operation, cycle: int) -> None:
        """An operation has begun in a cycle: those that waited for it alone may follow."""
        for u in self.users[n]:
            self.begins[u] = max(self.begins[u], cycle + n.latency)
            self.missing[u] -= 1
            if self.missing[u] == 0:
                heapq.heappush(self.coming, (self.begins[u], self.rank[u]))

    def come(self, cycle: int) -> None:
        """Operations whose operands are available in a cycle become ready."""
        while self.coming and self.coming[0][0] <= cycle:
            k = heapq.heappop(self.coming)[1]
            if self.nodes[k].name in FREE:
                self.done(self.nodes[k], cycle)
            else:
                self.ready.add(k)

    def next(self) -> Operation | None:
        """The operation that begins next; None if it is better to wait."""
        chosen = self.ready
        if self.waiting >= REGISTERS:
            using_up = {k for k in self.ready if self.more_waiting[k] <= 0}
            chosen = using_up if using_up or self.coming else self.ready
        return self.nodes[min(chosen)] if chosen else None

    def begin(self, n: Operation, cycle: int) -> None:
        """Begin an operation in a cycle."""
        self.ready.discard(self.rank[n])
        self.waiting += self.more_waiting[self.rank[n]]
        for a in self.inputs[n]:
            self.left[a] -= 1
            if a in self.near:
                self._last_use_frees(a)
        self.done(n, cycle)


def in_order(results: list[Value], lanes: int = 8) -> list[Operation]:
    """The operations that some results need and that cost time, in an order that keeps a processor busy.

    A list schedule: in every cycle, of the operations whose operands are available, those begin that have
    the longest chains after them. When as many values wait to be used as there are registers, operations
    that use up values come first. Values used again much later are not counted: they wait in memory.
    """
    schedule, order, cycle = Schedule(reached(results)), list[Operation](), 0
    while schedule.coming or schedule.ready:
        schedule.come(cycle)
        for _ in range(ISSUED[lanes]):
            if (n := schedule.next()) is None:
                break
            order.append(n)
            schedule.begin(n, cycle)
        cycle += 1
    return order
