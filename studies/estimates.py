"""How sharp is the error estimate? Quantiles of the errors of single steps, for each range of their
estimates; docs/results/estimates.csv also has rows of the estimate before the present one, measured at commit
379746d."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.support.figures import bare, new_figure
from redundant_envs.support.progress import counted
from studies.interval_families import FAMILIES
from studies.intervals import tips_after

COLUMNS = "measure", "estimate", "steps", "beyond", "median", "q999", "largest"
BATCH = 4096
LOOSEST = 1e-3
"""Tolerance of the steps, m: a larger error has more than one step."""
EDGES = 10.0 ** np.arange(-12.0, -2.75, 0.5)
"""Limits of the ranges of estimates, m."""
LEAST = 100
"""Number of steps from which on a range has a row."""

Array = NDArray[np.float64]


def single_steps(count: int, seed: int) -> tuple[Array, Array]:
    """Estimates and errors of single steps without any event, m: ``count`` of each family."""
    estimates, errors = [], []
    with counted("estimates", len(FAMILIES)) as done:
        for number, family in enumerate(FAMILIES):
            rng = np.random.default_rng((seed, number))
            for start in range(0, count, BATCH):
                drawn = family.draw(min(BATCH, count - start), rng)
                (tip, step), (best, how) = (
                    tips_after(family, family.scene(**asked), drawn)
                    for asked in ({"tolerance": LOOSEST}, {"integrator": "dop853"})
                )
                error = np.linalg.norm(tip - best, axis=1)
                single = (step.evaluations == 12) & (step.numerics == 0) & (how.numerics == 0)
                estimates.append(step.error_estimate[single])
                errors.append(error[single])
            done(family.name)
    return np.concatenate(estimates), np.concatenate(errors)


def run(count: int, seed: int, measure: str = "now") -> list[dict[str, Any]]:
    """Rows of ``COLUMNS``: quantiles of the errors of steps whose estimates are in a range, m."""
    estimates, errors = single_steps(count, seed)
    rows = []
    for low, high in itertools.pairwise(EDGES):
        found = errors[(estimates >= low) & (estimates < high)]
        if len(found) < LEAST:
            continue
        median, q999, largest = np.quantile(found, (0.5, 0.999, 1.0))
        beyond = ((errors > estimates) & (estimates >= low) & (estimates < high)).sum()
        rows.append({
            "measure": measure, "estimate": f"{np.sqrt(low * high):.3g}", "steps": len(found),
            "beyond": int(beyond), "median": f"{median:.3g}", "q999": f"{q999:.3g}",
            "largest": f"{largest:.3g}",
        })  # fmt: skip
    return rows


def figure(rows: Sequence[dict[str, Any]]) -> Any:
    """Errors against estimates, one panel for each measure."""
    names = list(dict.fromkeys(row["measure"] for row in rows))
    drawn = new_figure(4.0 * len(names), 3.6)
    panels = drawn.subplots(1, len(names), sharey=True, squeeze=False)[0]
    for panel, name in zip(panels, names, strict=True):
        bare(panel)
        x, median, q999, largest = (
            [float(row[key]) for row in rows if row["measure"] == name]
            for key in ("estimate", "median", "q999", "largest")
        )
        panel.loglog(x, x, color="0.3", lw=1.0, label="error = estimate")
        panel.fill_between(x, median, largest, color="#0072B2", alpha=0.15, lw=0.0)
        panel.loglog(x, largest, color="#0072B2", lw=1.0, marker="o", ms=3.0, label="largest error")
        panel.loglog(x, q999, color="#0072B2", ls="--", lw=1.0, label="error of one step in 1000")
        panel.loglog(x, median, color="#D55E00", lw=2.0, label="median error")
        panel.set(title=name, xlabel="estimate of a step, m")
    panels[0].set_ylabel("error of the tip, m")
    panels[0].legend(frameon=False, fontsize=8)
    return drawn
