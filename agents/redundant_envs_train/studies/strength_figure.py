"""The figure of hold success over the strength of the motors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from redundant_envs.figures import bare, new_figure

from .strength import ARMS, COLORS, HOLDABLE, Row

MARKERS = dict(zip(COLORS, ("o", "v", "s", "^"), strict=True))
"""A marker for each, so that they can be distinguished without colours."""
AREA = "#D9D9D9"


def figure(rows: Sequence[Row]) -> Any:
    """A panel for each arm: hold success [%] over the factor of the effort limits.

    The share that can be held at all is a grey area. Intervals are bands. The legend is below the panels.

    Parameters
    ----------
    rows : sequence of Row
        In any order; arms without rows have no panel.

    Returns
    -------
    matplotlib Figure

    Raises
    ------
    ValueError
        If there are no rows.
    """
    arms = [arm for arm in ARMS if any(row.arm == arm for row in rows)]
    if not arms:
        raise ValueError("rows is empty; give those of expert_rows and learner_rows")
    result = new_figure(4.0 * len(arms) + 0.6, 3.9, 120)
    panels = result.subplots(1, len(arms), sharey=True, squeeze=False)[0]
    handles: dict[str, Any] = {}
    for panel, arm in zip(panels, arms, strict=True):
        handles |= _draw(panel, [row for row in rows if row.arm == arm])
        panel.set_title(arm, loc="left", fontweight="bold")
        panel.set_xlabel("motor strength (effort limits times ...)")
        bare(panel)
    panels[0].set_ylabel("hold success, %")
    panels[0].set_ylim(0.0, 103.0)
    shown = [who for who in (HOLDABLE, *COLORS) if who in handles]
    result.legend([handles[who] for who in shown], shown, loc="outside lower center", ncols=3, frameon=False)
    return result


def _draw(panel: Any, rows: Sequence[Row]) -> dict[str, Any]:
    """Area, bands and curves of an arm; returns their handles for the legend."""
    handles: dict[str, Any] = {}
    for who in (HOLDABLE, *COLORS):
        own = sorted((row for row in rows if row.who == who), key=lambda row: row.factor)
        if not own:
            continue
        x = [row.factor for row in own]
        y = [100.0 * row.hold_success for row in own]
        if who == HOLDABLE:
            handles[who] = panel.fill_between(x, 0.0, y, color=AREA, linewidth=0.0)
            continue
        low, high = ([100.0 * getattr(row, end) for row in own] for end in ("low", "high"))
        panel.fill_between(x, low, high, color=COLORS[who], alpha=0.2, linewidth=0.0)
        (handles[who],) = panel.plot(
            x, y, color=COLORS[who], marker=MARKERS[who], markersize=4.5, linewidth=1.8
        )
    factors = sorted({row.factor for row in rows})
    panel.set_xticks(factors, [f"{factor:g}" for factor in factors])
    return handles
