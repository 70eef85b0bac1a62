"""Command line: python -m redundant_envs simulate | verify | study | scene | list."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

from redundant_envs import __version__
from redundant_envs.extras import MissingPackage
from redundant_envs.modules import OPTION, take_imports

# Only argparse here: each command imports what it needs, so that --help is instant.

STUDIES = ("throughput", "environments", "stops", "impacts", "intervals", "accuracy", "schematic")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command.

    Returns
    -------
    int
        0, or 1 if verify found a broken promise; 2, after a message, for a mistake in the command or a
        missing package; 130 for Ctrl-C.
    """
    try:
        words = take_imports(list(sys.argv[1:] if arguments is None else arguments))
        options = parser().parse_args(words)
        result: int | None = options.handler(options)
    except (ValueError, MissingPackage, OSError) as error:
        print(f"redundant_envs: {' '.join(str(error).splitlines())}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("redundant_envs: stopped", file=sys.stderr)
        return 130
    return result or 0


def verify(options: argparse.Namespace) -> int:
    """Check the promises about arms, scenes, effects and environments, and print the values; 1 on a miss."""
    from redundant_envs.studies.verify import command

    if options.bits:
        others = ("subject", "states", "mode", "json", "markdown")
        given = [name for name in others if getattr(options, name)]
        if given:
            raise ValueError(f"--bits looks at the record alone; leave out {', '.join(given)}")
        return command.compare_bits(options.bits == "all")
    return command.run(
        options.subject, options.states, options.mode or "standard", options.json, options.markdown
    )


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        """Report a mistake in the words of a command, in one line."""
        raise ValueError(f"{message}; see {self.prog} --help")


def parser() -> argparse.ArgumentParser:
    """All commands and their options."""
    top = _Parser(prog="python -m redundant_envs", description="Planar redundant arms.")
    top.add_argument(
        OPTION, metavar="MODULE",
        help="import a module of yours first, whose arms, effects, tasks are then known; before the command",
    )  # fmt: skip
    top.add_argument("--version", action="version", version=f"redundant-envs {__version__}")
    commands = top.add_subparsers(dest="command", required=True)

    p = commands.add_parser("simulate", help="simulate arms without motors; record and plot their energies")
    p.add_argument(
        "--scene", nargs="+", default=None, metavar="NAME_OR_PATH", help="default: the report's runs"
    )
    p.add_argument("--seconds", type=float, default=5.0)
    p.add_argument("--q", nargs="+", type=float, metavar="Q", help="coordinates at the start, rad and m")
    p.add_argument("--qd", nargs="+", type=float, metavar="QD", help="velocities, 1/s, m/s; none is rest")
    p.add_argument("--out", type=Path, default=Path("runs/simulate"), metavar="FOLDER")
    p.add_argument(
        "--clip", type=Path, metavar="FILE", help="also draw the motion: .gif or .mp4; one --scene"
    )
    p.set_defaults(handler=simulate)

    p = commands.add_parser("verify", help="check correctness: values found beside those promised")
    p.add_argument(
        "subject", nargs="*", metavar="SUBJECT",
        help="scene, file of one, id, arm, effect, task or module:object; default: all named scenes",
    )  # fmt: skip
    how = p.add_mutually_exclusive_group()
    for mode, text in (("quick", "the checks that take no time"), ("full", "all checks, and more states")):
        how.add_argument(f"--{mode}", dest="mode", action="store_const", const=mode, help=text)
    p.add_argument("--states", type=int, help="random states; default: 256, 1024, of --full 8192")
    p.add_argument("--json", type=Path, metavar="FILE", help="also write the results as JSON")
    p.add_argument("--markdown", type=Path, metavar="FILE", help="also write the tables as Markdown")
    p.add_argument(
        "--bits", nargs="?", const="short", choices=("short", "all"),
        help="instead, check that recorded motions have the same bits on this machine",
    )  # fmt: skip
    p.set_defaults(handler=verify)

    studies = commands.add_parser("study", help="measure the library").add_subparsers(
        dest="study", required=True
    )
    p = studies.add_parser("throughput", help="nanoseconds per step of the compiled core")
    p.add_argument("--config", type=Path, metavar="YAML", help="default: configs/studies/throughput.yaml")
    p.set_defaults(handler=throughput)
    _add_study_out(p)
    p = studies.add_parser("environments", help="speed of the Gymnasium environments")
    p.add_argument("--lanes", type=int, default=4096)
    p.add_argument("--rounds", type=int, default=10)
    p.set_defaults(handler=environments)
    _add_study_out(p)
    p = studies.add_parser("stops", help="cost of the hard stops of the RPRP scene")
    p.add_argument("--lanes", type=int, default=4096)
    p.set_defaults(handler=stops)
    _add_study_out(p)
    p = studies.add_parser("impacts", help="whether error control finds every impact at hard stops")
    p.add_argument("--intervals", type=int, default=100_000, help="over all families")
    p.add_argument("--families", type=int, default=12, help="number of random families beside the named ones")
    p.add_argument("--independent", type=int, default=100, help="intervals for SciPy, some 50 ms each")
    p.add_argument("--processes", type=int, default=1, help="number of processes, each with its own families")
    p.add_argument("--seed", type=int, default=0)
    p.set_defaults(handler=impacts)
    _add_study_out(p)
    p = studies.add_parser("intervals", help="whether the tolerance is kept in families of hard scenes")
    p.add_argument("--intervals", type=int, default=100_000, help="over all families")
    p.add_argument("--processes", type=int, default=1, help="number of processes, each with its own families")
    p.add_argument("--seed", type=int, default=0)
    p.set_defaults(handler=intervals)
    _add_study_out(p)
    p = studies.add_parser("accuracy", help="error against cost, beside MuJoCo and SciPy")
    p.add_argument("--config", type=Path, metavar="YAML", help="default: configs/studies/accuracy.yaml")
    p.add_argument("--out", type=Path, default=Path("runs/studies"), metavar="FOLDER")
    p.add_argument(
        "--redraw", type=Path, metavar="FOLDER",
        help="instead, draw the figures again from the tables of an earlier run, into its folder",
    )  # fmt: skip
    p.set_defaults(handler=accuracy)

    p = studies.add_parser("schematic", help="draw both arms with their angles, lengths and sliders")
    p.add_argument("--out", type=Path, default=Path("runs/studies/arms.svg"), metavar="SVG_OR_PNG")
    p.set_defaults(handler=schematic)

    p = commands.add_parser("scene", help="print a scene")
    p.add_argument("scene", metavar="NAME_OR_PATH")
    p.add_argument("--listing", action="store_true", help="print its traced program instead")
    p.add_argument("--bill", action="store_true", help="count its operations by effect instead")
    p.add_argument("--source", action="store_true", help=argparse.SUPPRESS)
    p.set_defaults(handler=show_scene)

    p = commands.add_parser("list", help="ids, scenes, effects, integrators, studies")
    p.set_defaults(handler=list_names)
    return top


def _add_study_out(p: argparse.ArgumentParser) -> None:
    p.add_argument(
        "--out", type=Path, default=Path("runs/studies"), metavar="FOLDER", help="folder, or a .csv file"
    )


def simulate(options: argparse.Namespace) -> None:
    """Write CSV and figures of one or more scenes."""
    from redundant_envs import load_scene
    from redundant_envs.envs.clips import check_clip
    from redundant_envs.studies import energy

    asked: list[str] = options.scene or list(energy.STARTS)
    if options.clip is not None and len(asked) != 1:
        raise ValueError(f"--clip draws one scene, but {len(asked)} are given; give exactly one --scene")
    if options.clip is not None:
        check_clip(options.clip)
    scenes = [(Path(name).stem, load_scene(name)) for name in asked]
    names = [name for name, _ in scenes]
    if len(set(names)) < len(names):
        raise ValueError(f"--scene gives the same name twice: {', '.join(names)}; their files would collide")
    for name, scene in scenes:
        start = energy.default_start(name, scene) if options.q is None else options.q
        energy.check_start(scene, options.seconds, start, options.qd)
    for i, (name, scene) in enumerate(scenes):
        print(f"simulate {i + 1}/{len(scenes)}: {name}, {options.seconds:g} s ...", file=sys.stderr)
        q = options.q if options.q is not None else energy.default_start(name, scene)
        run = energy.energy_run(name, scene, options.seconds, q, options.qd)
        path = options.out / f"{name}.csv"
        energy.write_csv(run, path)
        print(
            f"{name}: largest kinetic energy {run.trajectory.kinetic_energy.max():.4g} J, total "
            f"{run.total[0]:.6g} J at the start and {run.total[-1]:.6g} J at the end, relative drift "
            f"{run.drift:.1e}"
        )
        # After the numbers, so that these are written even if matplotlib is missing.
        from redundant_envs.studies import plots

        try:
            pictures = plots.save_figures(run, options.out)
            if options.clip is not None:
                plots.save_clip(run, options.clip)
                pictures.append(options.clip)
        except MissingPackage as error:
            raise MissingPackage(f"{error} ({path} is written)") from error
        print("\n".join(f"  {p}" for p in (path, *pictures)))


def throughput(options: argparse.Namespace) -> None:
    """Time the compiled core."""
    from redundant_envs.studies import common
    from redundant_envs.studies import throughput as study

    config = study.load_config(options.config or common.study_path("throughput"))
    _report(study.run(config), study.COLUMNS, "dgemm_gflops", options.out, "throughput")


def environments(options: argparse.Namespace) -> None:
    """Time the environments."""
    from redundant_envs.studies import environments as study

    rows = study.run(options.lanes, options.rounds)
    _report(rows, study.COLUMNS, "env", options.out, "environments")


def stops(options: argparse.Namespace) -> None:
    """Time intervals with and without stops, on states of random actions."""
    from redundant_envs.studies import stops as study

    if options.lanes < 8:
        raise ValueError(f"lanes is {options.lanes}; give at least 8")
    rows = study.run({"random actions": study.random_policy(0)}, options.lanes)
    _report(rows, study.COLUMNS, "states", options.out, "stops")


def impacts(options: argparse.Namespace) -> None:
    """Check intervals of random scenes with hard stops."""
    from redundant_envs.studies import hidden_impacts as study

    for name, least in (
        ("intervals", 1), ("families", 0), ("independent", 0), ("seed", 0), ("processes", 1),
    ):  # fmt: skip
        if getattr(options, name) < least:
            raise ValueError(f"{name} is {getattr(options, name)}; give at least {least}")
    rows = study.run(
        options.intervals, options.families, options.independent, options.seed, options.processes
    )
    _report(rows, study.COLUMNS, "family", options.out, "impacts")


def intervals(options: argparse.Namespace) -> None:
    """Check intervals of many families of scenes."""
    from redundant_envs.studies import intervals as study

    for name, least in (("intervals", 1), ("seed", 0), ("processes", 1)):
        if getattr(options, name) < least:
            raise ValueError(f"{name} is {getattr(options, name)}; give at least {least}")
    rows = study.run(options.intervals, options.seed, options.processes)
    _report(rows, study.COLUMNS, "family", options.out, "intervals")


def accuracy(options: argparse.Namespace) -> None:
    """Measure errors and costs; write tables, figures and a page."""
    from redundant_envs.studies import accuracy_config, accuracy_report
    from redundant_envs.studies.common import study_path

    command = "python -m redundant_envs study accuracy"
    if options.config:
        command += f" --config {options.config}"
    study = accuracy_config.load_study(options.config or study_path("accuracy"))
    if options.redraw:
        from redundant_envs.studies import accuracy_plots

        drawn = accuracy_plots.read(study, options.redraw)
        print("\n".join(str(path) for path in accuracy_plots.save_figures(drawn, study, options.redraw)))
        return
    page, *others = accuracy_report.write(study, command, options.out)
    print(page.read_text(encoding="utf-8"))
    print("\n".join(str(path) for path in (page, *others)))


def schematic(options: argparse.Namespace) -> None:
    """Draw the schematic of both arms."""
    from redundant_envs.studies.schematic import save_schematic

    if options.out.suffix not in (".svg", ".png"):
        raise ValueError(f"--out is {options.out}; give a file that ends in .svg or .png")
    try:
        print(save_schematic(options.out))
    except ImportError as error:
        raise ValueError(str(error)) from error


def _report(rows: list[dict[str, Any]], columns: Sequence[str], first: str, out: Path, name: str) -> None:
    """Write a study's rows as CSV and print them; values common to all rows are printed once, on one line."""
    from redundant_envs.studies.common import table, write_rows

    path = out if out.suffix == ".csv" else out / f"{name}.csv"
    write_rows(rows, columns, path)
    start = columns.index(first)
    if rows:
        print(", ".join(f"{c} {rows[0][c]}" for c in columns[:start] if rows[0][c]))
    print(table(rows, columns[start:]))
    print(path)


def list_names(options: argparse.Namespace) -> None:
    """Print every name that the other commands and gymnasium.make take."""
    from redundant_envs.studies.names import names

    print(names(STUDIES), end="")


def show_scene(options: argparse.Namespace) -> None:
    """Print a scene as YAML, its traced program, or the operations that it costs."""
    from redundant_envs import load_scene

    if options.source:
        raise ValueError(
            "--source is gone: simulators are traced, not written as text; use --listing or --bill"
        )
    scene = load_scene(options.scene)
    if options.listing:
        from redundant_envs.model.listing import listing

        print(listing(scene), end="")
        return
    if options.bill:
        from redundant_envs.model.listing import bill
        from redundant_envs.studies.common import table

        rows = [{"of": owner, **counts._asdict()} for owner, counts in bill(scene).items()]
        print(table(rows, list(rows[0])))
        return
    import yaml

    print(yaml.safe_dump(scene.to_dict(), sort_keys=False, default_flow_style=None), end="")


if __name__ == "__main__":
    sys.exit(main())
