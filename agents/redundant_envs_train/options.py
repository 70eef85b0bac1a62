"""Arguments and options that several commands have, and completions."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from redundant_envs.extras import needs

with needs("train"):
    import typer

Folder = Annotated[Path, typer.Argument(help="run folder")]
PolicyFolder = Annotated[Path, typer.Argument(help="run folder, or folder of an exported policy")]
Folders = Annotated[list[Path], typer.Argument(help="run folders")]
Runs = Annotated[
    list[Path],
    typer.Argument(help="run folders; tables of runs, or runs of a table, such as runs.csv/*_sac/*"),
]
Out = Annotated[Path | None, typer.Option(help="folder to write to")]
Overwrite = Annotated[
    bool, typer.Option("--overwrite", help="write into the run folder, or replace files in --out")
]
Trust = Annotated[
    bool,
    typer.Option(
        "--trust", help="unpickle policy.zip, as stable-baselines3 does: runs any code its author put in"
    ),
]


def presets() -> list[str]:
    """Completions of a preset's name."""
    from .presets import presets

    return presets()


def complete(incomplete: str) -> list[str]:
    """Completions of key=value."""
    from .config.keys import complete

    return complete(incomplete)
