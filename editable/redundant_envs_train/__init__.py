"""The application of an editable install: the modules of agents/, under the name they have in a wheel."""

from pathlib import Path

__path__ = [str(Path(__file__).parents[2] / "agents")]

from .naming import COMMAND, command

__all__ = ["COMMAND", "command"]
