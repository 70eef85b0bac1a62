"""The order of instructions.

A processor looks only about a hundred instructions ahead. In LLVM's order, made for few registers, it
waits for chains of divisions and sums although other instructions farther on could already begin. This
order moves these nearer.
"""

from __future__ import annotations

import heapq

from redundant_envs.tracing.graph import FREE, Operation, Value, reached

ISSUED = 3
"""Instructions that may begin in a cycle: two with vectors of 512 bits, more with 256 bits."""
REGISTERS = 26
"""Values that may wait to be used before the order prefers to use them up (32 registers)."""
FAR = 120
"""Cycles between the first and the last use of a value beyond which it will wait in memory."""


def source_of(value: Operation) -> Operation:
    """The value for which an operand is another name."""
    while value.name == "neg" and isinstance(value.arguments[0], Operation):
        value = value.arguments[0]
    return value


def in_order(results: list[Value]) -> list[Operation]:
    """The operations that some results need and that cost time, in an order that keeps a processor busy.

    A list schedule: in every cycle, of the operations whose operands are available, those begin that have
    the longest chains after them. When as many values wait to be used as there are registers, operations
    that use up values come first. Values used again much later are not counted: they wait in memory.
    """
    nodes = reached(results)
    users: dict[Operation, list[Operation]] = {n: [] for n in nodes}
    for n in nodes:
        for a in dict.fromkeys(n.operands):
            users[a].append(n)
    chain: dict[Operation, int] = {}  # cycles from the beginning of an operation to the end of all
    for n in reversed(nodes):
        chain[n] = n.latency + max((chain[u] for u in users[n]), default=0)
    real = [n for n in nodes if n.name not in FREE]
    inputs = {n: dict.fromkeys(s for s in map(source_of, n.operands) if s.name not in FREE) for n in real}
    uses: dict[Operation, list[int]] = {n: [] for n in real}
    for n in real:
        for a in inputs[n]:
            uses[a].append(chain[n])
    far = {a for a, chains in uses.items() if chains and max(chains) - min(chains) > FAR}
    left = {a: len(chains) for a, chains in uses.items()}
    missing = {n: len(set(n.operands)) for n in nodes}
    place = {n: k for k, n in enumerate(nodes)}
    begins = dict.fromkeys(place, 0)

    def more_waiting(n: Operation) -> int:
        freed = sum(left[a] == 1 and a not in far for a in inputs[n])
        return (n not in far and left[n] > 0) - freed

    order: list[Operation] = []
    waiting = cycle = 0
    coming = [(0, place[n]) for n in nodes if missing[n] == 0]
    ready: set[int] = set()

    def done(n: Operation, cycle: int) -> None:
        for u in users[n]:
            begins[u] = max(begins[u], cycle + n.latency)
            missing[u] -= 1
            if missing[u] == 0:
                heapq.heappush(coming, (begins[u], place[u]))

    while coming or ready:
        while coming and coming[0][0] <= cycle:
            k = heapq.heappop(coming)[1]
            if nodes[k].name in FREE:
                done(nodes[k], cycle)
            else:
                ready.add(k)
        for _ in range(ISSUED):
            if not ready:
                break
            if waiting < REGISTERS:
                k = max(ready, key=lambda k: (chain[nodes[k]], -k))
            else:
                k = min(ready, key=lambda k: (max(more_waiting(nodes[k]), 0), -chain[nodes[k]], k))
                if more_waiting(nodes[k]) > 0 and coming:
                    break
            n = nodes[k]
            ready.discard(k)
            waiting += more_waiting(n)
            for a in inputs[n]:
                left[a] -= 1
            order.append(n)
            done(n, cycle)
        cycle += 1
    return order
