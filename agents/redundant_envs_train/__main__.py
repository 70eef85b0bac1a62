"""Train, evaluate, play and report policies."""

import sys

from redundant_envs import __version__
from redundant_envs.support.modules import status_of, take_imports
from redundant_envs.support.values import say


def main(arguments: list[str] | None = None) -> int:
    """Run one command to its exit status, that of :func:`status_of`."""
    return status_of(lambda: _run(sys.argv[1:] if arguments is None else arguments), "error")


def _run(words: list[str]) -> int:
    if words == ["--version"]:  # the packages that the commands need are missing
        say(f"redundant-envs {__version__}")
        return 0
    words = take_imports(words)
    if words[:1] == ["study"]:
        command_line = " ".join(("python -m studies", *words[1:]))
        raise ValueError(f"studies are in the source tree alone; write there: {command_line}")
    from .commands import run

    return run(words)


if __name__ == "__main__":
    sys.exit(main())
