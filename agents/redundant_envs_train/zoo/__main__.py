"""``python -m redundant_envs_train.zoo``: rl_zoo3's train, and with ``enjoy`` first its enjoy."""

import sys

from redundant_envs.extras import MissingPackage


def main() -> int:
    """Train or watch; after a message 2 for a missing package or a mistake in the input."""
    try:
        from .experiment import enjoy, train

        if sys.argv[1:2] == ["enjoy"]:
            del sys.argv[1]
            enjoy()
        else:
            train()
    except (MissingPackage, ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
