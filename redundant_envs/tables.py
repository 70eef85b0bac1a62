"""Tables: rows as CSV, as Markdown and as text in aligned columns."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from redundant_envs.disk import replacing


def write_rows(rows: Iterable[Mapping[str, Any]], columns: Sequence[str], path: Path) -> None:
    """Write rows as CSV."""
    with replacing(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(rows)


def table(head: Sequence[Any], rows: Iterable[Iterable[Any]], align: str = ">") -> str:
    """A table as text in aligned columns: ">" to the right, "<" to the left."""
    lines = [[str(cell) for cell in line] for line in (head, *rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    padded = ("  ".join(f"{c:{align}{w}}" for c, w in zip(line, widths, strict=True)) for line in lines)
    return "\n".join(line.rstrip() for line in padded)


def markdown(head: Sequence[Any], rows: Iterable[Iterable[Any]]) -> str:
    """A Markdown table; a bar in a cell is escaped."""
    lines = ([str(cell).replace("|", r"\|") for cell in line] for line in (head, ["---"] * len(head), *rows))
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
