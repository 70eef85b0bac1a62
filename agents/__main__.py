"""Command line of the application: train | evaluate | report | table | play | study."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from redundant_envs import __version__
from redundant_envs.extras import MissingPackage

from . import COMMAND
from .interrupt import Stopped


def main(arguments: list[str] | None = None) -> int:
    """Run one command.

    Returns
    -------
    int
        0; after a message 2 for a mistake in the input or a missing package, and 130 for Ctrl-C.
    """
    parser = argparse.ArgumentParser(prog=COMMAND, description=__doc__)
    parser.add_argument("--version", action="version", version=f"redundant-envs {__version__}")
    commands = parser.add_subparsers(dest="command", required=True)
    p = commands.add_parser("train", help="train, evaluate and report")
    p.add_argument("config", help="YAML file, or name of a preset such as rprp_reach_ppo")
    p.add_argument("overrides", nargs="*", help="key=value, such as seed=3 ppo.gamma=0.98")
    p.add_argument("--out", type=Path, help="run folder (default runs/<config>_seed<seed>_<time>)")
    p = commands.add_parser("evaluate", help="evaluate the policy of a run folder again")
    p.add_argument("folder", type=Path)
    _add_trust(p)
    p = commands.add_parser("report", help="draw plots, clips and report.md of a run folder again")
    p.add_argument("folder", type=Path)
    _add_trust(p)
    p = commands.add_parser("table", help="print evaluated runs as a Markdown table")
    p.add_argument("folders", type=Path, nargs="+")
    p = commands.add_parser("play", help="watch a run folder's policy, or an id without one")
    p.add_argument("target", help="run folder, or id such as RPRPReach-v0")
    p.add_argument("--actions", choices=("zero", "random", "expert"),
                   help="actions for an id (default expert)")  # fmt: skip
    p.add_argument("--clip", type=Path, help="write a .gif or .mp4 instead of opening a window")
    p.add_argument("--episodes", type=int, default=3)
    p.add_argument("--seed", type=int, default=0)
    _add_trust(p)
    p = commands.add_parser("study", help="measure what policies depend on")
    studies = p.add_subparsers(dest="study", required=True)
    p = studies.add_parser("stops", help="what hard stops cost on the states of an RPRP policy")
    p.add_argument("folder", type=Path, help="run folder")
    p.add_argument("--lanes", type=int, default=4096)
    p.add_argument("--out", type=Path, default=Path("runs/studies/stops.csv"), help="CSV file")
    _add_trust(p)
    p = studies.add_parser("policy", help="what the physics costs a policy, and training under the cheapest")
    p.add_argument("overrides", nargs="*", help="key=value, such as train_seeds=0")
    p.add_argument("--config", type=Path, help="YAML file (default configs/studies/policy.yaml)")
    p.add_argument("--out", type=Path, default=Path("runs/studies/policy"),
                   help="folder; a study that was stopped goes on in it")  # fmt: skip
    _add_trust(p)
    # argparse takes positional arguments in one place only: overrides after --out are left over.
    options, rest = parser.parse_known_args(arguments)
    late = [word for word in rest if "=" in word and not word.startswith("-")]
    if options.command == "train" or getattr(options, "study", "") == "policy":
        options.overrides += late
        rest = [word for word in rest if word not in late]
    if rest:
        parser.error(f"unrecognized arguments: {' '.join(rest)}")
    try:
        run = {
            "train": _train,
            "evaluate": _evaluate,
            "report": _report,
            "table": _table,
            "play": _play,
            "study": _study,
        }[options.command]
        return run(options)
    except (ValueError, MissingPackage, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as stop:
        print(str(stop) or "stopped", file=sys.stderr)
        return 130


def _add_trust(p: argparse.ArgumentParser) -> None:
    p.add_argument(
        "--trust", action="store_true",
        help="unpickle policy.zip, as stable-baselines3 does: runs any code its author put in",
    )  # fmt: skip


def _train(options: argparse.Namespace) -> int:
    from .config import load
    from .evaluate import evaluate, summary
    from .report import check_drawing, report
    from .train import train

    check_drawing()
    config = load(options.config, options.overrides)
    name = f"{Path(options.config).stem}_seed{config.seed}_{time.strftime('%Y%m%d-%H%M%S')}"
    folder = options.out or Path("runs") / name
    facts = train(config, folder)
    try:
        print(summary(evaluate(config, folder)))
        print(f"{facts['env_steps']} environment steps in {facts['train_seconds']:.0f} s")
        print(f"report: {report(folder)}")
    except KeyboardInterrupt:
        raise Stopped(f"stopped after the training; go on with: {COMMAND} report {folder}") from None
    return 0


def _evaluate(options: argparse.Namespace) -> int:
    from .evaluate import evaluate, summary
    from .run_folder import read_config

    print(summary(evaluate(read_config(options.folder), options.folder, options.trust)))
    return 0


def _report(options: argparse.Namespace) -> int:
    from .report import report

    print(f"report: {report(options.folder, options.trust)}")
    return 0


def _table(options: argparse.Namespace) -> int:
    from .report import table

    print(table(options.folders))
    return 0


def _play(options: argparse.Namespace) -> int:
    from .play import play

    play(options.target, options.actions, options.clip, options.episodes, options.seed, options.trust)
    return 0


def _study(options: argparse.Namespace) -> int:
    if options.study == "stops":
        return _study_stops(options)
    from redundant_envs.studies.throughput import study_path

    from .policy_report import write_report
    from .policy_study import load_study, run_study
    from .report import check_drawing

    check_drawing()
    study = load_study(options.config or study_path("policy"), options.overrides)
    try:
        results = run_study(study, options.out, options.trust)
    except KeyboardInterrupt:
        raise Stopped("stopped; the same command goes on after the last finished training") from None
    path = write_report(study, results, options.out)
    print(path.read_text(encoding="utf-8"))
    print(f"report: {path}")
    return 0


def _study_stops(options: argparse.Namespace) -> int:
    from redundant_envs.studies import stops, throughput

    from .policies import load_policy
    from .run_folder import read_config

    config = read_config(options.folder)
    if options.lanes < 8:
        raise ValueError(f"lanes is {options.lanes}; give at least 8")
    if config.env != stops.ENVIRONMENT:
        raise ValueError(f"folder is a run of {config.env}; the study is of {stops.ENVIRONMENT}")
    model = load_policy(options.folder, config, options.trust)
    policies = {
        "policy": lambda obs: model.predict(obs, deterministic=True)[0],
        "random actions": stops.random_policy(0),
    }
    rows = stops.run(policies, options.lanes)
    throughput.write_rows(rows, stops.COLUMNS, options.out)
    print(throughput.table(rows, stops.COLUMNS[stops.COLUMNS.index("states") :]))
    print(options.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
