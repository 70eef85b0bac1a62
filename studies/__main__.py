"""Our measurements: ``python -m studies NAME``, in the source tree only; each imports what it needs."""

from __future__ import annotations

import argparse
import importlib
import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from redundant_envs.__main__ import Parser
from redundant_envs.scenes import config_folder
from redundant_envs.support.disk import add_force, check_kept, check_plain
from redundant_envs.support.modules import status_of, take_imports
from redundant_envs.support.tables import table, write_rows
from redundant_envs.support.values import say

OUT = Path("runs/studies")
Row = dict[str, Any]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a study to the exit status of :func:`status_of`."""
    return status_of(lambda: _run(list(sys.argv[1:] if arguments is None else arguments)), "studies")


def _run(arguments: list[str]) -> None:
    options = parser().parse_args(take_imports(arguments))
    options.handler(options)


def parser() -> argparse.ArgumentParser:
    """All studies and their options."""
    top = Parser(prog="python -m studies", description="Measure the library and policies.")
    studies = top.add_subparsers(dest="study", required=True)

    def study(handler: Callable[[Any], Any], name: str, text: str) -> argparse.ArgumentParser:
        p: argparse.ArgumentParser = studies.add_parser(name, help=text)
        p.set_defaults(handler=handler)
        return p

    def configured(p: argparse.ArgumentParser, name: str) -> None:
        p.add_argument("--config", type=Path, metavar="YAML", help=f"default: configs/studies/{name}.yaml")

    def written(p: argparse.ArgumentParser) -> None:
        p.add_argument("--out", type=Path, default=OUT, metavar="FOLDER", help="folder, or a .csv file")
        add_force(p)

    def trusted(p: argparse.ArgumentParser) -> None:
        text = "unpickle policy.zip, as stable-baselines3 does: runs any code its author put in"
        p.add_argument("--trust", action="store_true", help=text)

    def continued(p: argparse.ArgumentParser, name: str) -> None:
        text = "a stopped study in it is continued"
        p.add_argument("--out", type=Path, default=OUT / name, metavar="FOLDER", help=text)

    p = study(measure, "throughput", "nanoseconds per step of the compiled core")
    configured(p, "throughput")
    written(p)
    p = study(measure, "environments", "speed of the Gymnasium environments")
    p.add_argument("ids", nargs="*", metavar="ID", help="default: the reach environments")
    p.add_argument("--lanes", type=int, default=4096)
    p.add_argument("--rounds", type=int, default=10)
    written(p)
    p = study(measure, "modes", "cost of the modes of actions")
    p.add_argument("--lanes", type=int, default=1024)
    p.add_argument("--rounds", type=int, default=16)
    written(p)
    p = study(measure, "effects", "cost of every effect and scene, and whether ceilings hold")
    p.add_argument("name", nargs="*", metavar="NAME", help="effect or scene; default: all")
    configured(p, "effects")
    written(p)
    p = study(measure, "stops", "cost of the hard stops of the RPRP scene")
    p.add_argument("run", nargs="?", type=Path, metavar="RUN", help="also on the states of this policy")
    p.add_argument("--lanes", type=int, default=4096)
    trusted(p)
    written(p)
    for name, text in (
        ("impacts", "whether error control finds every impact at hard stops"),
        ("intervals", "whether the tolerance is kept in families of hard scenes"),
    ):
        p = study(measure, name, text)
        p.add_argument("--intervals", type=int, default=100_000, help="over all families")
        p.add_argument("--processes", type=int, default=1, help="number of processes, each with its families")
        p.add_argument("--seed", type=int, default=0)
        p.add_argument(
            "--tolerances", type=float, nargs="+", default=(), metavar="M",
            help="judge the same intervals at each of these, m (default: each family at its own)",
        )  # fmt: skip
        written(p)
    p = study(measure, "ilqr", "what any controller reached: motions that iLQR improved, under weak motors")
    p.add_argument("arms", nargs="*", metavar="ARM", help="4R or RPRP; default: both")
    p.add_argument("--goals", type=int, default=100, help="of the strength study, from its first")
    written(p)
    p = study(
        measure, "redundancy", "what experts hold that use the null space, and what the nearest pose holds"
    )
    p.add_argument("--episodes", type=int, default=500)
    written(p)
    p = study(measure, "poses", "what policies have learned: whether they end in poses like the expert's")
    p.add_argument("folders", nargs="+", type=Path, metavar="RUN", help="run folder or exported policy")
    p.add_argument("--episodes", type=int, default=500)
    trusted(p)
    written(p)
    p = study(accuracy, "accuracy", "error against cost, beside MuJoCo and SciPy")
    configured(p, "accuracy")
    p.add_argument("--out", type=Path, default=OUT, metavar="FOLDER")
    p.add_argument(
        "--redraw", type=Path, metavar="FOLDER",
        help="instead, draw the figures again from the tables of an earlier run, into its folder",
    )  # fmt: skip
    add_force(p)
    p = study(policy, "policy", "effect of the physics on a policy, and training under the cheapest")
    p.add_argument("overrides", nargs="*", metavar="KEY=VALUE", help="such as train_seeds=0")
    configured(p, "policy")
    p.add_argument(
        "--redraw", type=Path, metavar="FOLDER",
        help="instead, write the figures and the page of an earlier run again, from its tables",
    )  # fmt: skip
    trusted(p)
    continued(p, "policy")
    p = study(strength, "strength", "where learning pays: hold success over the strength of the motors")
    p.add_argument("--seeds", default="0..2", help="of the learners, such as 0..2; none: no training")
    p.add_argument("--factors", default="", help="effort limits, times those of the reach scenes")
    p.add_argument("--episodes", type=int, default=1000, help="goals")
    p.add_argument(
        "--runs", type=Path, action="append", default=[], metavar="PLACE",
        help="run folder or table of runs, taken beside those trained; may be given again",
    )  # fmt: skip
    p.add_argument("--processes", type=int, help="trainings at a time (default: all cores)")
    continued(p, "strength")
    return top


def _families(of: Any, o: Any) -> list[Row]:
    rows: list[Row] = of.run(o.study, o.intervals, o.seed, o.processes, o.tolerances)
    return rows


MEASURED: dict[str, tuple[str, Callable[[Any, Any], list[Row]]]] = {
    "throughput": ("dgemm_gflops", lambda of, o: of.run(of.load_study(_config(o)))),
    "environments": ("env", lambda of, o: of.run(o.ids or of.IDS, o.lanes, o.rounds)),
    "modes": ("env", lambda of, o: of.run(o.lanes, o.rounds)),
    "effects": ("at", lambda of, o: of.run(of.load_study(_config(o)), o.name)),
    "ilqr": ("arm", lambda of, o: of.run(o.arms, o.goals)),
    "redundancy": ("task", lambda of, o: of.run(o.episodes)),
    "poses": ("run", lambda of, o: of.run(o.folders, o.episodes, o.trust)),
    "stops": ("states", lambda of, o: of.run(of.policies(o), o.lanes)),
    "impacts": ("family", _families),
    "intervals": ("family", _families),
}
"""Studies whose result is a table: the first column that is printed for each row, and how they are run."""
LEAST = {"intervals": 1, "seed": 0, "processes": 1, "lanes": 8, "rounds": 1, "goals": 2, "episodes": 1}
"""Least values of options."""


def measure(options: argparse.Namespace) -> None:
    """Write the rows of a study as CSV and print them; what is common to all is printed once."""
    for name, least in LEAST.items():
        if getattr(options, name, least) < least:
            raise ValueError(f"{name} is {getattr(options, name)}; give at least {least}")
    of = importlib.import_module(f"studies.{'intervals' if options.study == 'impacts' else options.study}")
    path: Path = options.out if options.out.suffix == ".csv" else options.out / f"{options.study}.csv"
    read = [getattr(options, name, None) for name in ("config", "run")]
    check_kept([path], options.force, [*filter(None, read)])
    first, run = MEASURED[options.study]
    rows, start = run(of, options), of.COLUMNS.index(first)
    write_rows(rows, of.COLUMNS, path)
    if rows:
        say(", ".join(f"{c} {rows[0][c]}" for c in of.COLUMNS[:start] if rows[0][c]))
    say(table(of.COLUMNS[start:], ([row[c] for c in of.COLUMNS[start:]] for row in rows)))
    if hasattr(of, "verdict"):
        say(of.verdict(rows))
    say(path)


def accuracy(options: argparse.Namespace) -> None:
    """Measure errors and costs; write tables, figures and a page."""
    from studies import accuracy_config, accuracy_plots, accuracy_report

    study = accuracy_config.load_study(_config(options))
    if options.redraw:
        check_plain(options.redraw)
        drawn = accuracy_plots.read(study, options.redraw)
        say(*accuracy_plots.save_figures(drawn, study, options.redraw), sep="\n")
        return
    configs = [options.config] if options.config else []
    check_kept(accuracy_report.files(options.out), options.force, configs)
    command = shlex.join(["python", "-m", "studies", "accuracy", *(f"--config={path}" for path in configs)])
    page, *others = accuracy_report.write(study, command, options.out)
    say(page.read_text(encoding="utf-8"))
    say(page, *others, sep="\n")


def policy(options: argparse.Namespace) -> None:
    """Evaluate policies under several physics, and train under the cheapest."""
    from redundant_envs_train.training.pool import Stopped
    from studies.policy.settings import load_study

    study = load_study(_config(options), options.overrides)
    from studies.policy.report import rewrite_report, write_report
    from studies.policy.run import run_study

    if options.redraw:
        check_plain(options.redraw)
        say(rewrite_report(options.redraw))
        return
    try:
        results = run_study(study, options.out, options.trust)
    except KeyboardInterrupt:
        raise Stopped("stopped; the same command goes on after the last finished training") from None
    path = write_report(study, results, options.out)
    say(path.read_text(encoding="utf-8"))
    say(path)


def strength(options: argparse.Namespace) -> None:
    """Compare learners with computed torque under weaker and weaker motors."""
    from redundant_envs_train.training.pool import seeds_of
    from studies import strength as study

    seeds = [] if options.seeds == "none" else seeds_of(options.seeds)
    factors = study.factors_of(options.factors) if options.factors else study.FACTORS
    say(study.run_study(factors, seeds, options.episodes, options.runs, options.processes, options.out))


def _config(options: argparse.Namespace) -> Path:
    return options.config or config_folder("studies") / f"{options.study}.yaml"


if __name__ == "__main__":
    sys.exit(main())
