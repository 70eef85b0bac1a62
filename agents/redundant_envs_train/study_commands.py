"""The commands of ``study``: each checks its arguments before it imports anything large."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from redundant_envs.extras import needs

from .options import Folder, Trust
from .training.interrupt import Stopped

with needs("train"):
    import typer

study = typer.Typer(help="Measure effects on policies.", no_args_is_help=True, rich_markup_mode=None)


@study.command("stops")
def study_stops(
    folder: Folder,
    lanes: int = 4096,
    out: Annotated[Path, typer.Option(help="CSV file")] = Path("runs/studies/stops.csv"),
    trust: Trust = False,
) -> None:
    """Cost of hard stops on the states of an RPRP policy."""
    try:
        from redundant_envs.studies import stops
    except ModuleNotFoundError:
        raise ValueError("study stops is in the source tree, not in the wheel; run it there") from None
    from redundant_envs.tables import table, write_rows

    from .own_scene import own_config, tell_differences

    config = own_config(folder)
    if lanes < 8:
        raise ValueError(f"lanes is {lanes}; give at least 8")
    if config.env != stops.ENVIRONMENT:
        raise ValueError(f"folder is a run of {config.env}; the study is of {stops.ENVIRONMENT}")
    tell_differences([folder])
    from .policies import load_policy

    model = load_policy(folder, config, trust)
    policies: dict[str, Any] = {
        "policy": lambda obs: model.predict(obs, deterministic=True)[0],
        "random actions": stops.random_policy(0),
    }
    rows = stops.run(policies, lanes)
    write_rows(rows, stops.COLUMNS, out)
    shown = stops.COLUMNS[stops.COLUMNS.index("states") :]
    print(table(shown, ([row[c] for c in shown] for row in rows)))
    print(out)


@study.command("policy")
def study_policy(
    overrides: Annotated[list[str] | None, typer.Argument(help="key=value, such as train_seeds=0")] = None,
    config: Annotated[
        Path | None, typer.Option(help="YAML file (default configs/studies/policy.yaml)")
    ] = None,
    out: Annotated[Path, typer.Option(help="folder; a stopped study in it is continued")] = Path(
        "runs/studies/policy"
    ),
    trust: Trust = False,
) -> None:
    """Effect of the physics on a policy, and training under the cheapest."""
    from redundant_envs.files import config_folder

    from .drawing import check_drawing
    from .studies.policy.settings import load_study

    what = load_study(config or config_folder("studies") / "policy.yaml", overrides or ())
    check_drawing()
    from .studies.policy.report import write_report
    from .studies.policy.run import run_study

    try:
        results = run_study(what, out, trust)
    except KeyboardInterrupt:
        raise Stopped("stopped; the same command goes on after the last finished training") from None
    path = write_report(what, results, out)
    print(path.read_text(encoding="utf-8"))
    print(f"report: {path}")


@study.command("strength")
def study_strength(
    seeds: Annotated[str, typer.Option(help="of the learners, such as 0..2; none: no training")] = "0..2",
    factors: Annotated[str, typer.Option(help="effort limits, times those of the reach scenes")] = "",
    episodes: Annotated[int, typer.Option(help="goals")] = 1000,
    runs: Annotated[
        list[Path] | None, typer.Option(help="run folder or table of runs, taken beside those trained")
    ] = None,
    processes: Annotated[int | None, typer.Option(help="trainings at a time (default: all cores)")] = None,
    out: Annotated[Path, typer.Option(help="folder; a stopped study in it is continued")] = Path(
        "runs/studies/strength"
    ),
) -> None:
    """Where learning pays: hold success over the strength of the motors."""
    from .drawing import check_drawing
    from .studies.factors import factors_of
    from .training.amount import seeds_of

    chosen = [] if seeds == "none" else seeds_of(seeds)
    times = factors_of(factors)
    check_drawing()
    from .studies.strength_run import run_study

    print(run_study(times, chosen, episodes, runs or (), processes, out))
