"""One step of a fixed-step method as straight-line text: stages, sums and the error estimate.

The text is the sum over the tableau and nothing else; what ``rhs`` computes is not known here.
Positions y and velocities v have the same count; further states z are first order.
"""

from __future__ import annotations

from collections.abc import Sequence

from redundant_envs.integrators.tableaus import Tableau


def weighted_sum(weights: Sequence[float], term: str) -> str:
    """ "w0*term0 + w1*term1 + ..." without the zero weights; ``term`` has {} for the stage."""
    return " + ".join(f"{w!r} * {term.format(j)}" for j, w in enumerate(weights) if w != 0.0)


def step_lines(
    method: Tableau, positions: Sequence[str], velocities: Sequence[str], extra: Sequence[str], call: str
) -> list[str]:
    """Lines that advance the named states by ``h`` and give them new names "<state>_new".

    ``call`` is the right-hand side with {} where the states of the stage go; it returns the
    derivatives of the velocities and of the extra states.
    """
    n = len(positions)
    states = (*positions, *velocities, *extra)
    if method.name == "euler":
        rates = [f"{s}_k" for s in (*velocities, *extra)]
        return [
            f"{', '.join(rates)}, = {call.format(', '.join(states))}",
            *(f"{s}_new = {s} + h * {s}_k" for s in (*velocities, *extra)),
            *(f"{p}_new = {p} + h * {v}_new" for p, v in zip(positions, velocities, strict=True)),
        ]
    slope = {p: f"{v}_s{{}}" for p, v in zip(positions, velocities, strict=True)}
    slope.update({s: f"{s}_k{{}}" for s in (*velocities, *extra)})
    lines = []
    for i, row in enumerate(method.a):
        for s in states:
            total = weighted_sum(row, slope[s])
            lines.append(f"{s}_s{i} = {s} + h * ({total})" if total else f"{s}_s{i} = {s}")
        results = ", ".join(f"{s}_k{i}" for s in (*velocities, *extra))
        lines.append(f"{results}, = {call.format(', '.join(f'{s}_s{i}' for s in states))}")
    lines += [f"{s}_new = {s} + h * ({weighted_sum(method.b, slope[s])})" for s in states]
    if method.error5:
        for s in states[: 2 * n]:
            lines.append(f"{s}_e5 = h * ({weighted_sum(method.error5, slope[s])})")
            lines.append(f"{s}_e3 = h * ({weighted_sum(method.error3, slope[s])})")
    return lines
