"""Train, evaluate, play and report policies."""

import sys

from redundant_envs import __version__
from redundant_envs.extras import MissingPackage
from redundant_envs.modules import take_imports

from .presets import is_override, preset_path


def main(arguments: list[str] | None = None) -> int:
    """Run one command: 0; after a message 2 for a mistake or a missing package, and 130 for Ctrl-C."""
    words = sys.argv[1:] if arguments is None else arguments
    if words == ["--version"]:  # the packages that the commands need are missing
        print(f"redundant-envs {__version__}")
        return 0
    try:
        words = take_imports(words)
        if words[:1] in (["train"], ["tune"]) and len(words) > 1:
            first = words[1]  # a wrong name is refused before even the large parser is imported
            if not first.startswith("-") and not is_override(first):
                preset_path(first)
        from .commands import run

        return run(words)
    except (ValueError, MissingPackage, OSError) as error:
        print(f"error: {' '.join(str(error).splitlines())}", file=sys.stderr)
        return 2
    except MemoryError as error:
        print(f"error: {error or 'there is not enough memory'}; give smaller numbers", file=sys.stderr)
        return 2
    except KeyboardInterrupt as stop:
        print(str(stop) or "stopped", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
