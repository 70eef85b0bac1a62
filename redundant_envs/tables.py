"""Tables: rows as CSV, as Markdown and as text in aligned columns."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from redundant_envs.disk import replacing
from redundant_envs.values import printable


def write_rows(rows: Iterable[Mapping[str, Any]], columns: Sequence[str], path: Path) -> None:
    """Write rows as CSV."""
    with replacing(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(rows)


class Markdown(str):
    """A text that is Markdown; any other is escaped where it comes into a table or a page."""

    __slots__ = ()


def escaped(text: Any) -> Markdown:
    """A text in one line of Markdown without a meaning there: no HTML, link, code, cell or control
    character; one that is Markdown stays."""
    if isinstance(text, Markdown):
        return text
    line = printable(" ".join(str(text).splitlines())).replace("<", "&lt;")
    return Markdown(re.sub(r"[\\`|]|\](?=[(\[:])", r"\\\g<0>", line))


def code(text: Any) -> Markdown:
    """A text as code in a line of Markdown, between more backticks than it has one after the other."""
    line = printable(" ".join(str(text).splitlines()))
    marks = "`" * (1 + max(map(len, re.findall("`+", line)), default=0))
    space = " " * (len(marks) > 1)
    return Markdown(f"{marks}{space}{line}{space}{marks}")


def table(head: Sequence[Any], rows: Iterable[Iterable[Any]], align: str = ">") -> str:
    """A table as text in aligned columns: ">" to the right, "<" to the left."""
    lines = [[printable(" ".join(str(cell).splitlines())) for cell in line] for line in (head, *rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    padded = ("  ".join(f"{c:{align}{w}}" for c, w in zip(line, widths, strict=True)) for line in lines)
    return "\n".join(line.rstrip() for line in padded)


def markdown(head: Sequence[Any], rows: Iterable[Iterable[Any]], formatted: bool = False) -> Markdown:
    """A Markdown table of texts; ``formatted`` cells are Markdown, in which only a bar is escaped."""

    def cell(text: Any) -> str:
        return str(text).replace("|", r"\|") if formatted else escaped(text)

    lines = (map(cell, line) for line in (head, ["---"] * len(head), *rows))
    return Markdown("\n".join(f"| {' | '.join(line)} |" for line in lines))
