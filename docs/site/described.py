"""What classes say about their parameters."""

from __future__ import annotations

import inspect
import re
import textwrap


def described(kind: type) -> dict[str, str]:
    """The parameters of a class and of those from which it is derived, with their descriptions."""
    found: dict[str, str] = {}
    for base in kind.__mro__:
        _, _, text = (inspect.cleandoc(vars(base).get("__doc__") or "")).partition("Parameters\n----------\n")
        for names, words in re.findall(r"(?m)^(\w[\w, ]*) : .*\n((?:    .*\n?)+)", text):
            joined = " ".join(textwrap.dedent(words).split())
            found = {**dict.fromkeys(names.split(", "), joined), **found}
    return found
