"""One step of a fixed-step method as straight-line text: stages, sums and the error estimate.

The text is the sum over the tableau and nothing else; what ``rhs`` computes is not known here.
Positions y and velocities v have the same count; further states z are first order.
"""

from __future__ import annotations

from collections.abc import Sequence

from redundant_envs.integrators.tableaus import Tableau


def weighted_sum(weights: Sequence[float], term: str) -> tuple[float, str]:
    """A factor and "term0 + w1*term1 + ..." without zero weights; ``term`` has {} for the stage.

    The first weight is the factor, which is multiplied with the step once for all states.
    """
    (first, factor), *rest = ((j, w) for j, w in enumerate(weights) if w != 0.0)
    return factor, " + ".join([term.format(first), *(f"{w / factor!r} * {term.format(j)}" for j, w in rest)])


def extremes(name: str, value: str, first: bool) -> list[str]:
    """Lines that keep the least and the greatest value of a quantity as "<name>_least", "<name>_most"."""
    if first:
        return [f"{name}_least, {name}_most = {value}, {value}"]
    least = f"{name}_least = minimum({name}_least, {value})"
    return [least, f"{name}_most = maximum({name}_most, {value})"]


def step_lines(
    method: Tableau,
    positions: Sequence[str],
    velocities: Sequence[str],
    extra: Sequence[str],
    call: str,
    watched: Sequence[str] = (),
) -> list[str]:
    """Lines that advance the named states by ``h`` and give them new names "<state>_new".

    ``call`` is the right-hand side with {} where the states of the stage go; it returns the
    derivatives of the velocities and of the extra states, then the watched quantities, of which the
    least and the greatest value in any stage get the names "<quantity>_least" and "<quantity>_most". A
    method with an error estimate gives its two parts, up to their signs, as "h_e5" times "<state>_e5"
    and "h_e3" times "<state>_e3".
    """
    n = len(positions)
    states = (*positions, *velocities, *extra)
    if method.name == "euler":
        rates = [f"{s}_k0" for s in (*velocities, *extra)]
        seen = [f"{w}_k0" for w in watched]
        return [
            f"{', '.join((*rates, *seen))}, = {call.format(', '.join(states))}",
            *(line for w in watched for line in extremes(w, f"{w}_k0", first=True)),
            *(f"{s}_new = {s} + h * {s}_k0" for s in (*velocities, *extra)),
            *(f"{p}_new = {p} + h * {v}_new" for p, v in zip(positions, velocities, strict=True)),
        ]
    slope = {p: f"{v}_s{{}}" for p, v in zip(positions, velocities, strict=True)}
    slope.update({s: f"{s}_k{{}}" for s in (*velocities, *extra)})
    lines = []
    for i, row in enumerate(method.a):
        for s in states:
            if any(row):
                factor, total = weighted_sum(row, slope[s])
                lines.append(f"{s}_s{i} = {s} + (h * {factor!r}) * ({total})")
            else:
                lines.append(f"{s}_s{i} = {s}")
        results = ", ".join(f"{s}_k{i}" for s in (*velocities, *extra, *watched))
        lines.append(f"{results}, = {call.format(', '.join(f'{s}_s{i}' for s in states))}")
        for w in watched:
            lines += extremes(w, f"{w}_k{i}", first=i == 0)
    for s in states:
        factor, total = weighted_sum(method.b, slope[s])
        lines += [f"{s}_sum = {total}", f"{s}_new = {s} + (h * {factor!r}) * {s}_sum"]
    if method.error5:
        # The lower of the two embedded methods differs from the method itself in three weights only.
        first = method.b[0]
        lower = [(e - b) / first for e, b in zip(method.error3, method.b, strict=True)]
        for s in states[: 2 * n]:
            factor5, total = weighted_sum(method.error5, slope[s])
            lines.append(f"{s}_e5 = {total}")
            factor3, total = weighted_sum(lower, slope[s])
            lines.append(f"{s}_e3 = {s}_sum + {factor3!r} * ({total})")
        lines += [f"h_e5 = h * {abs(factor5)!r}", f"h_e3 = h * {first!r}"]
    return lines
