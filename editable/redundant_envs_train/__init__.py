"""The application of an editable install: the modules of agents/, under the name they have in a wheel."""

from pathlib import Path

COMMAND = "redundant-envs-train"
__path__ = [str(Path(__file__).parents[2] / "agents")]
