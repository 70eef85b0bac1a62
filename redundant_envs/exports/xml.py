"""XML: how numbers and comments are written."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any
from xml.etree import ElementTree as ET

from redundant_envs.exports.document import plain


def comment(lines: Iterable[str]) -> Any:
    """Lines as a comment."""
    text = "\n    ".join(lines)
    while "--" in text:  # not allowed in a comment
        text = text.replace("--", "- -")
    return ET.Comment(f" {text} ")


def numbers(*values: float) -> str:
    """Numbers that are read back to the last bit."""
    return " ".join(repr(float(x) + 0.0) for x in values)


def text_of(root: ET.Element) -> str:
    """The text of an XML document."""
    for element in root.iter():
        element.attrib.update({name: plain(value) for name, value in element.attrib.items()})
    ET.indent(root)
    return f'<?xml version="1.0"?>\n{ET.tostring(root, encoding="unicode")}\n'
