"""Pages for readers: Markdown templates of Jinja2, one file each."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from redundant_envs.support.extras import needs
from redundant_envs.support.tables import Markdown, code, escaped, markdown

from ..rollout import expert_name

with needs("train"):
    import jinja2

MEASURES = (
    ("hold success", "hold_success", 100.0, 1, " %"), ("touch success", "touch_success", 100.0, 1, " %"),
    ("median final distance", "median_distance", 1000.0, 2, " mm"),
    ("median time to hold", "time_to_hold", 1.0, 2, " s"), ("effort", "effort", 1.0, 4, ""),
    ("smoothness", "smoothness", 1.0, 4, ""), ("mean return", "mean_return", 1.0, 1, ""),
)  # fmt: skip
"""Lines of a table of results: name, key, factor, digits, unit."""


def results_table(result: Mapping[str, Any], goals: str, policy: str, count: int = len(MEASURES)) -> Markdown:
    """The first ``count`` results of a policy as a Markdown table beside those of the task's expert, and
    which are better beyond chance if the evaluation has compared them."""
    rows, better = [], result["better"]
    expert = expert_name(result["env"])
    words = {True: policy, False: expert}
    for label, key, scale, digits, unit in MEASURES[:count]:
        values = [result.get(f"{who}{key}") for who in ("", "expert_")]
        if result["hold_success"] is None and not any(value is not None for value in values):
            continue  # what a task without success does not tell
        cells = ["-" if v is None else f"{scale * v:.{digits}f}{unit}" for v in values]
        rows.append((label, *cells, *([words.get(better.get(key), "-")] if better else [])))
    for name, value in result["metrics"].items():
        rows.append((name, f"{value:.4g}", "-", *(["-"] if better else [])))
    return markdown((goals, policy, expert, *(["better"] if better else [])), rows)


def page(name: str, folder: Path = Path(__file__).parent, /, **facts: Any) -> str:
    """The text of the template ``name``.md of a folder with these facts; a fact that is missing is an error.
    A text among them is escaped, unless it is :class:`Markdown`; the filter ``code`` shows it as code."""
    templates = jinja2.Environment(
        loader=jinja2.FileSystemLoader(folder), undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True, trim_blocks=True,
        finalize=lambda fact: escaped(fact) if isinstance(fact, str) else fact,
    )  # fmt: skip
    templates.filters["code"] = code
    return templates.get_template(f"{name}.md").render(facts)
