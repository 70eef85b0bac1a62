"""How objects show themselves in a notebook: HTML of bounded length, whose texts are escaped."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from redundant_envs.support.values import printable

MAX_BYTES = 200_000  # of an object; one with longer HTML, of very long names of a user, is shown as text
LONGEST_CELL, LONGEST_TEXT = 100, 2000  # characters of a cell, and of an object as text
MAX_ROWS = 80
STYLE = (
    "<style>.redundant-envs table{border-collapse:collapse;margin:.4em 0;font-size:.9em}"
    ".redundant-envs th,.redundant-envs td{padding:.1em .7em;text-align:left;vertical-align:top;"
    "border-bottom:1px solid rgba(128,128,128,.35)}"
    ".redundant-envs svg{max-width:100%;height:auto}</style>"
)
"""The same on every object of a page; texts have the colour of the page, light or dark."""


def as_html(thing: Any, *parts: Callable[[], str]) -> str:
    """HTML of an object from its parts; the text of the object stands for parts that fail: any error is
    caught, since users' classes may do anything, and a picture must not hide the object."""
    fragments = []
    for part in parts:
        try:
            with np.errstate(all="ignore"):  # numbers may be of any size
                fragments.append(part())
        except Exception:
            fragments.append("")
    try:
        plain = repr(thing)
    except Exception:
        plain = f"<{type(thing).__name__}>"
    text = f"<pre>{escaped(plain, LONGEST_TEXT)}</pre>"
    page = f'<div class="redundant-envs">{STYLE}{"" if all(fragments) else text}{"".join(fragments)}</div>'
    return page if len(page.encode(errors="replace")) <= MAX_BYTES else text


def escaped(value: Any, longest: int = LONGEST_CELL) -> str:
    """A value as text in HTML; floats with six digits."""
    text = f"{value:.6g}" if isinstance(value, float) else printable(value)
    from html import escape  # with all entities, which cost a start 3 ms

    return escape(text if len(text) <= longest else f"{text[: longest - 3]}...")


def table(head: Sequence[Any], rows: Iterable[Sequence[Any]]) -> str:
    """A table; of many rows the first."""
    few = [*rows]
    if len(few) > MAX_ROWS:
        few[MAX_ROWS:] = [(f"... and {len(few) - MAX_ROWS} more",)]
    lines = [_line("th", head), *(_line("td", row) for row in few)]
    return f"<table>{''.join(lines)}</table>"


def _line(kind: str, cells: Sequence[Any]) -> str:
    return f"<tr>{''.join(f'<{kind}>{escaped(cell)}</{kind}>' for cell in cells)}</tr>"
