"""``python -m agents`` runs the application of this checkout; ``python -m studies`` its studies."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))


def main(words: list[str]) -> int:
    """Run a command to its exit status."""
    if words[:1] == ["study"]:
        from studies.__main__ import main as study

        return study(words[1:])
    from redundant_envs_train.__main__ import main as command

    return command(words)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
