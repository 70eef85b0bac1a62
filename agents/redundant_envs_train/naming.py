"""The command with which users run this application."""

from __future__ import annotations

import shlex
from pathlib import Path

COMMAND = "python -m agents" if Path.cwd() == Path(__file__).parents[2] else "redundant-envs-train"
"""In a checkout nothing need be installed; elsewhere the name of the script, in the same words everywhere."""


def command(*words: object) -> str:
    """A command of this application to paste into a shell: paths are quoted if necessary."""
    return f"{COMMAND} {shlex.join(map(str, words))}"
