"""Train, evaluate, play and report policies: an application on top of redundant_envs.

A wheel has this module beside ``redundant_envs``, under the same name. ``python -m agents`` runs it in a
checkout, ``redundant-envs-train`` where the package is installed.
"""

import os
import shlex
from pathlib import Path

from redundant_envs.support import modules

IN_CHECKOUT = os.path.samestat(os.stat("."), os.stat(Path(__file__).parents[2]))
COMMAND = "python -m agents" if IN_CHECKOUT else "redundant-envs-train"
"""The command with which users run it, the same in all messages: in a checkout nothing need be installed."""


def command(*words: object) -> str:
    """A command to paste into a shell: paths are quoted, and modules that this one imports named again."""
    imports = (word for module in modules.IMPORTED for word in (modules.OPTION, module))
    return f"{COMMAND} {shlex.join(map(str, (*imports, *words)))}"


def train_again(folder: Path) -> str:
    """The command that trains the configuration of a run folder into a new one."""
    return command("train", folder / "config.yaml", "--out", "NEW_FOLDER")
