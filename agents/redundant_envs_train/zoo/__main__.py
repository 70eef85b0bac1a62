"""``python -m redundant_envs_train.zoo``: takes all arguments of ``rl_zoo3.train``."""

import sys

from redundant_envs.extras import MissingPackage


def main() -> int:
    """Train; after a message 2 for a missing package or a mistake in the input."""
    try:
        from .experiment import train

        train()
    except (MissingPackage, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
