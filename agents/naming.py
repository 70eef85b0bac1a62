"""The command with which users run this application."""

from __future__ import annotations

import shlex

COMMAND = "python -m agents" if __name__.partition(".")[0] == "agents" else "redundant-envs-train"


def command(*words: object) -> str:
    """A command of this application to paste into a shell: paths are quoted if necessary."""
    return f"{COMMAND} {shlex.join(map(str, words))}"
