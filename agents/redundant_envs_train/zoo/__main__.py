"""``python -m redundant_envs_train.zoo``: rl_zoo3's train, and with ``enjoy`` first its enjoy."""

import sys

from redundant_envs.modules import status_of


def main() -> int:
    """Train or watch; the exit status is that of the other commands."""
    return status_of(_run, "error")


def _run() -> None:
    from .experiment import enjoy, train

    if sys.argv[1:2] == ["enjoy"]:
        del sys.argv[1]
        enjoy()
    else:
        train()


if __name__ == "__main__":
    sys.exit(main())
