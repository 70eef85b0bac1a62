"""What users type to run this application."""

from __future__ import annotations

import shlex

COMMAND = "python -m agents" if __name__.partition(".")[0] == "agents" else "redundant-envs-train"


def command(*words: object) -> str:
    """A command of this application to paste into a shell: paths are quoted where they need it."""
    return f"{COMMAND} {shlex.join(map(str, words))}"
