"""The figure of the policy study: differences from the reference with their intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from redundant_envs.figures import bare, new_figure

from .run import ArmResult
from .settings import Study
from .words import LOOKS, Difference, hold_difference, percent, plain, return_difference, signed


def figure(result: ArmResult, study: Study, about: Mapping[str, str]) -> Any:
    """Differences of hold success and return from the reference, with intervals, per physics."""
    reference = next(row for row in result.rows if row["physics"] == study.reference)
    rows = [row for row in result.rows if row is not reference and not row.get("refused")]
    drawn = new_figure(7.0, 2.4 + 0.45 * len(rows))
    panels = drawn.subplots(1, 2, sharey=True)
    holds = [hold_difference(row, study) for row in rows]
    returns = [return_difference(row, study, reference) for row in rows]
    _draw(panels[0], f"hold success minus {study.reference}, points", holds)
    _draw(panels[1], f"mean return minus {study.reference}", returns)
    names = [f"{row['physics']}\n{percent(row['hold_success'])} held" for row in rows]
    panels[0].set_yticks(range(len(rows)), names)
    panels[0].set_ylim(len(rows) - 0.5, -0.7)
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    seen = {d.verdict for d in (*holds, *returns)}
    handles: list[Any] = [
        Line2D([], [], color=color, marker=marker, lw=2.0, label=text)
        for key, (color, marker, text) in LOOKS.items()
        if key in seen
    ]
    handles.append(Patch(color="0.92", label="margin"))
    drawn.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    drawn.suptitle(
        f"{result.name}: one policy, {reference['episodes']} paired episodes, 95 % bootstrap intervals\n"
        f"{study.reference}: {percent(reference['hold_success'])} held, mean return "
        f"{reference['mean_return']:.2f}\n"
        f"{about['machine']}, {about['date']}, commit {about['commit'] or 'unknown'}",
        fontsize=9, x=0.01, ha="left",
    )  # fmt: skip
    return drawn


def _draw(panel: Any, label: str, differences: Sequence[Difference]) -> None:
    """Intervals below each other; beyond the margin the axis is logarithmic if it must be."""
    margin = max((d.margin for d in differences), default=1.0)
    widest = max((abs(end) for d in differences for end in (d.low, d.high)), default=0.0)
    panel.axvspan(-margin, margin, color="0.92", lw=0)
    panel.axvline(0.0, color="0.4", lw=0.8)
    for y, d in enumerate(differences):
        color, marker, _ = LOOKS[d.verdict]
        panel.plot([d.low, d.high], [y, y], color=color, lw=2.0, solid_capstyle="butt")
        panel.plot(d.value, y, marker, color=color, ms=6)
        panel.annotate(
            signed(d.value), (d.value, y), (0, 7), textcoords="offset points", ha="center", fontsize=8,
            bbox={"facecolor": "white", "alpha": 0.7, "lw": 0, "pad": 0.6},
        )  # fmt: skip
    edge = max(1.15 * widest, 1.4 * margin)
    if widest > 10.0 * margin:
        edge = 4.0 * widest
        panel.set_xscale("symlog", linthresh=margin, linscale=1.0)
        first = math.ceil(math.log10(margin) - 1e-9)
        ticks = [10.0**k for k in range(first, math.floor(math.log10(edge)) + 1)]
        ticks = [*(-t for t in reversed(ticks)), 0.0, *ticks]
        panel.set_xticks(ticks, [f"{t:g}" for t in ticks])
        panel.set_xticks([], minor=True)
        label += f"\n(logarithmic beyond ±{plain(margin)})"
    panel.set_xlim(-edge, edge)
    panel.set_xlabel(label, fontsize=8.5)
    panel.tick_params(labelsize=8)
    bare(panel)
