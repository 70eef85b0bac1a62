"""Tables: rows as CSV, as Markdown and as text in aligned columns."""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from redundant_envs.support.disk import replacing
from redundant_envs.support.values import printable


def write_rows(rows: Iterable[Mapping[str, Any]], columns: Sequence[str], path: Path) -> None:
    """Write rows as CSV."""
    import csv

    with replacing(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(rows)


class Markdown(str):
    """A text that is Markdown; any other is escaped where it comes into a table or a page."""

    __slots__ = ()


MEANING = r"""(?xi)
    [\\`*|~$]                             # code, emphasis, cells, formulas
    | (?<![^\W_])_ | _(?![^\W_])          # emphasis, which underscores within a word are not
    | \](?=[(\[:]) | &(?=[#a-zA-Z])       # links, characters by their names
    | :(?=//) | (?<=mailto): | (?<=xmpp): | (?<=www)\. | //(?=[^\W_])  # addresses, which become links
    | (?<=[^\W_])\.(?=([a-z]{2}|biz|com|edu|gov|net|org|pro|web|xxx|aero|asia|coop|info|museum|name|shop|рф
        |xn--\w+)(?![^\W_]))  # ends of addresses
"""
"""What has a meaning anywhere in a line of Markdown; compiled when a line is written, not at a start."""
BEGINNING = re.compile(r"^([#>=]|[-+](?=[-+\s]|$)|\d+[.)](?=\s|$))")
"""What has one at its beginning: headings, quotations and lists, none of which a cell can be."""
AT = "@&#8203;"  # what an @ becomes: with an invisible space after it, it is in no address of mail


def escaped(text: Any) -> Markdown:
    """A text in one line of Markdown without a meaning there: no HTML, link, emphasis, code, cell, list or
    control character; one that is Markdown stays."""
    return text if isinstance(text, Markdown) else Markdown(BEGINNING.sub(_escape, _cell(text)))


def _cell(text: Any) -> Markdown:
    """The same within a cell of a table."""
    if isinstance(text, Markdown):
        return text
    return Markdown(re.sub(MEANING, _escape, _line(text).strip()).replace("<", "&lt;").replace("@", AT))


def _escape(match: re.Match[str]) -> str:
    return re.sub(r"(\W|_)", r"\\\1", match[0])


def _line(text: Any) -> str:
    return printable(" ".join(str(text).splitlines()))


def code(text: Any) -> Markdown:
    """A text as code in a line of Markdown, between more backticks than it has one after the other."""
    line = _line(text)
    marks = "`" * (1 + max(map(len, re.findall("`+", line)), default=0))
    space = " " * (len(marks) > 1)
    return Markdown(f"{marks}{space}{line}{space}{marks}")


def table(head: Sequence[Any], rows: Iterable[Iterable[Any]], align: str = ">") -> str:
    """A table as text in aligned columns: ">" to the right, "<" to the left."""
    lines = [[_line(cell) for cell in line] for line in (head, *rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    padded = ("  ".join(f"{c:{align}{w}}" for c, w in zip(line, widths, strict=True)) for line in lines)
    return "\n".join(line.rstrip() for line in padded)


def markdown(head: Sequence[Any], rows: Iterable[Iterable[Any]], formatted: bool = False) -> Markdown:
    """A Markdown table of texts; ``formatted`` cells are Markdown, in which only a bar is escaped."""

    def cell(text: Any) -> str:
        return str(text).replace("|", r"\|") if formatted else _cell(text)

    lines = (map(cell, line) for line in (head, ["---"] * len(head), *rows))
    return Markdown("\n".join(f"| {' | '.join(line)} |" for line in lines))
