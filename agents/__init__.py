"""Train, evaluate, play and report policies: an application on top of redundant_envs.

In a checkout it is the module ``agents``; a wheel ships it as ``redundant_envs_train``. So modules in
here import each other relatively.
"""

import shlex

COMMAND = "python -m agents" if __name__ == "agents" else "redundant-envs-train"
"""What a user types to run this application."""


def command(*words: object) -> str:
    """A command of this application to paste into a shell: paths are quoted where they need it."""
    return f"{COMMAND} {shlex.join(map(str, words))}"
