"""Command line: python -m redundant_envs simulate | verify | scene | export | wasm | page | list | cache."""

from __future__ import annotations

import argparse
import dataclasses
import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from redundant_envs import __version__
from redundant_envs.support.disk import add_force, check_kept, write_text
from redundant_envs.support.extras import MissingPackage
from redundant_envs.support.modules import OPTION, status_of, take_imports
from redundant_envs.support.values import say

# Only argparse here: each command imports what it needs, so that --help is instant.


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command: 0, or 1 if verify found a broken promise; 2, after a message, for a mistake in the
    command or a missing package; 130 for Ctrl-C; 141 if the reader of a pipe is gone."""

    def run() -> int | None:
        words = take_imports(list(sys.argv[1:] if arguments is None else arguments))
        if not words:
            parser().print_help(sys.stderr)
            return 2
        options = parser().parse_args(words)
        return options.handler(options)  # type: ignore[no-any-return]

    return status_of(run, "redundant_envs")


def verify(options: argparse.Namespace) -> int:
    """Check the promises about arms, scenes, effects and environments, and print the values; 1 on a miss."""
    from redundant_envs.verify import report

    if options.bits:
        conflicts = [name for name in ("subject", "states", "mode", "json") if getattr(options, name)]
        if conflicts:
            raise ValueError(f"--bits looks at the record alone; leave out {', '.join(conflicts)}")
        return report.compare_bits(options.bits == "all")
    modules = [Path(f"{word.partition(':')[0].replace('.', '/')}.py") for word in options.subject]
    check_kept(filter(None, [options.json]), options.force, [*map(Path, options.subject), *modules])
    return report.run(options.subject, options.states, options.mode or "standard", options.json)


class Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        """Report a mistake in the words of a command, in one line."""
        raise ValueError(f"{message}; see {self.prog} --help")


def parser() -> argparse.ArgumentParser:
    """All commands and their options."""
    top = Parser(prog="python -m redundant_envs", description="Planar redundant arms.")
    top.add_argument(
        OPTION, metavar="MODULE",
        help="import a module of yours first, whose arms, effects, tasks are then known; before the command",
    )  # fmt: skip
    top.add_argument("--version", action="version", version=f"redundant-envs {__version__}")
    commands = top.add_subparsers(dest="command", required=True)

    def command(handler: Callable[[Any], Any], name: str, text: str) -> argparse.ArgumentParser:
        p: argparse.ArgumentParser = commands.add_parser(name, help=text)
        p.set_defaults(handler=handler)
        return p

    def of_scene(handler: Callable[[Any], Any], name: str, text: str) -> argparse.ArgumentParser:
        p = command(handler, name, text)
        p.add_argument("scene", metavar="NAME_OR_PATH")
        add_force(p)
        return p

    p = command(simulate, "simulate", "simulate arms without motors; record and plot their energies")
    p.add_argument("--scene", nargs="+", metavar="NAME_OR_PATH", help="default: the report's runs")
    p.add_argument("--seconds", type=float, default=5.0)
    p.add_argument("--q", nargs="+", type=float, metavar="Q", help="coordinates at the start, rad and m")
    p.add_argument("--qd", nargs="+", type=float, metavar="QD", help="velocities, 1/s, m/s; none is rest")
    p.add_argument("--out", type=Path, default=Path("runs/simulate"), metavar="FOLDER")
    p.add_argument("--clip", type=Path, metavar="FILE", help="draw one --scene, too: .gif or .mp4")
    add_force(p)

    p = command(verify, "verify", "check correctness: values found beside those promised")
    p.add_argument(
        "subject", nargs="*", metavar="SUBJECT",
        help="scene, file of one, id, arm, effect, task or module:object; default: all named scenes",
    )  # fmt: skip
    how = p.add_mutually_exclusive_group()
    for mode, text in (("quick", "the checks that take no time"), ("full", "all checks, and more states")):
        how.add_argument(f"--{mode}", dest="mode", action="store_const", const=mode, help=text)
    p.add_argument("--states", type=int, help="random states; default: 256, 1024, of --full 8192")
    p.add_argument("--json", type=Path, metavar="FILE", help="also write the results as JSON")
    p.add_argument(
        "--bits", nargs="?", const="short", choices=("short", "all"),
        help="instead, check that recorded motions have the same bits on this machine",
    )  # fmt: skip
    add_force(p)

    p = command(no_studies, "study", "say where the studies are")
    p.add_argument("study", nargs=argparse.REMAINDER)

    p = of_scene(show_scene, "scene", "print or draw a scene")
    p.add_argument("--listing", action="store_true", help="print its traced program instead")
    p.add_argument("--bill", action="store_true", help="count its operations by effect instead")
    p.add_argument("--cost", action="store_true", help="time it, its bare arm and each effect alone instead")
    p.add_argument("--drawing", type=Path, metavar="SVG_OR_PNG", help="draw its arm instead")

    text = "write a scene as MJCF or URDF, or its accelerations for CasADi or as C"
    p = of_scene(export, "export", text)
    p.add_argument("--format", required=True, metavar="mjcf|urdf|casadi|c")
    p.add_argument("--out", type=Path, required=True, metavar="FILE")
    text = "leave out what the format cannot express, or write the nearest equivalent, and say so"
    p.add_argument("--approximate", action="store_true", help=text)

    p = of_scene(write_wasm, "wasm", "write the Reach environment of a scene for JavaScript")
    p.add_argument("--out", type=Path, default=Path("runs/wasm"), metavar="FOLDER")

    p = command(write_page, "page", "write a page in which the arms move, to be opened as a file")
    p.add_argument("--out", type=Path, default=Path("runs/page"), metavar="FOLDER")
    text = "with policies as agents export writes them; default: those of the source tree"
    p.add_argument("--policies", type=Path, metavar="FOLDER", help=text)
    add_force(p)

    command(list_names, "list", "ids, scenes, effects, integrators")
    p = command(show_cache, "cache", "where the compiled simulators are kept, and how large they are")
    p.add_argument("--clear", action="store_true", help="delete them; they are compiled again when needed")
    return top


def simulate(options: argparse.Namespace) -> None:
    """Write CSV and figures of one or more scenes."""
    from redundant_envs import load_scene
    from redundant_envs.envs.animation import FIGURES, animate, save_figures
    from redundant_envs.model import trajectory as energy
    from redundant_envs.support.figures import check_clip

    asked: list[str] = options.scene or list(energy.STARTS)
    if options.clip is not None:
        if len(asked) != 1:
            raise ValueError(f"--clip draws one scene, but {len(asked)} are given; give exactly one --scene")
        check_clip(options.clip)
    scenes = [(Path(name).stem, load_scene(name)) for name in asked]
    starts = [energy.default_start(*named) if options.q is None else options.q for named in scenes]
    endings = (".csv", *(f"_{kind}.png" for kind in FIGURES))
    files = [options.out / f"{name}{ending}" for name, _ in scenes for ending in endings]
    check_kept([*files, *filter(None, [options.clip])], options.force)
    for i, ((name, scene), q) in enumerate(zip(scenes, starts, strict=True)):
        say(f"simulate {i + 1}/{len(scenes)}: {name}, {options.seconds:g} s ...", file=sys.stderr)
        run = energy.energy_run(scene, options.seconds, q, options.qd)
        path = options.out / f"{name}.csv"
        energy.write_csv(run, path)
        say(
            f"{name}: largest kinetic energy {run.kinetic_energy.max():.4g} J, total "
            f"{run.total[0]:.6g} J at the start and {run.total[-1]:.6g} J at the end, relative drift "
            f"{run.drift:.1e}"
        )
        try:  # after the numbers, so that these are written even if matplotlib is missing
            pictures = save_figures(run, name, options.out)
            if options.clip is not None:
                animate(run).save(options.clip)
                pictures.append(options.clip)
        except MissingPackage as error:
            raise MissingPackage(f"{error} ({path} is written)") from error
        say("\n".join(f"  {p}" for p in (path, *pictures)))


def no_studies(options: argparse.Namespace) -> None:
    command = shlex.join(("python", "-m", "studies", *options.study))
    raise ValueError(f"the studies are in the source tree, not in the wheel; run there: {command}")


def list_names(options: argparse.Namespace) -> None:
    """Print every name that the other commands and gymnasium.make take."""
    from redundant_envs import effects
    from redundant_envs.envs.registration import ids
    from redundant_envs.scenes.scene import scene_names
    from redundant_envs.scenes.tableaus import METHODS

    def numbers(effect: type[Any]) -> list[str]:
        fields = {f.name: f.default for f in dataclasses.fields(effect) if f.init}
        return [n if value is dataclasses.MISSING else f"{n}={value}" for n, value in fields.items()]

    groups = {
        "environments": ids(),
        "scenes": scene_names(),
        "effects": [f"{name}({', '.join(numbers(kind))})" for name, kind in sorted(effects.REGISTRY.items())],
        "integrators": list(METHODS),
    }
    say("\n\n".join("\n  ".join((kind, *names)) for kind, names in groups.items()))


def show_cache(options: argparse.Namespace) -> None:
    """Print the size of the folder of compiled simulators, or empty it."""
    from redundant_envs.compiler.backends import cache

    say(cache.usage(options.clear))


def show_scene(options: argparse.Namespace) -> None:
    """Print a scene as YAML, its traced program or its costs, or draw its arm."""
    from redundant_envs import bill, listing, load_scene
    from redundant_envs.support.tables import table

    scene = load_scene(options.scene)
    if options.listing:
        say(listing(scene), end="")
    elif options.bill:
        counts_by_owner = bill(scene)
        head = ("of", *next(iter(counts_by_owner.values()))._fields)
        say(table(head, ((owner, *counts) for owner, counts in counts_by_owner.items())))
    elif options.cost:
        from redundant_envs.envs import cost

        say(table(cost.COLUMNS, (row.values() for row in cost.costs(cost.parts(scene)))))
    elif options.drawing is not None:
        from redundant_envs.envs.rendering import stated_limits
        from redundant_envs.robots.drawn import schematic
        from redundant_envs.support.figures import of_lines, save_figure

        if (ending := options.drawing.suffix) not in (".svg", ".png"):
            raise ValueError(f"--drawing is {options.drawing}; give a file that ends in .svg or .png")
        check_kept([options.drawing], options.force, [Path(options.scene)])
        drawing = schematic(scene.robot, stated_limits(scene))
        if ending == ".png":
            save_figure(of_lines(drawing), options.drawing)
        else:
            write_text(options.drawing, drawing)
        say(options.drawing)
    else:
        import yaml

        say(yaml.safe_dump(scene.to_dict(), sort_keys=False, default_flow_style=None), end="")


def export(options: argparse.Namespace) -> None:
    """Write a scene in a format of other programs, and say what the file leaves out."""
    from redundant_envs import load_scene
    from redundant_envs.exports import files

    check_kept([options.out], options.force, [Path(options.scene)])
    notes = files.write(
        load_scene(options.scene), options.format, options.out, options.approximate, Path(options.scene).stem
    )
    say(f"{options.out} ({options.out.stat().st_size} bytes)")
    if notes:
        say("\n".join(["approximate:", *(f"  {note}" for note in notes)]))


def write_wasm(options: argparse.Namespace) -> None:
    """Write an environment as a WebAssembly module, its description and its host."""
    from redundant_envs import ReachTask, load_scene
    from redundant_envs.web import module

    scene, name = load_scene(options.scene), Path(options.scene).stem
    check_kept(module.files(name, options.out), options.force, [Path(options.scene)])
    for path in module.write(scene, ReachTask(), name, options.out):
        say(f"{path} ({path.stat().st_size} bytes)")


def write_page(options: argparse.Namespace) -> None:
    from redundant_envs.web import page

    check_kept(page.files(options.out), options.force)
    written, learners = page.write(options.out, options.policies)
    for path in written:
        say(f"{path} ({path.stat().st_size} bytes)")
    say(f"learners: {', '.join(learners) or 'none, because no policies were found'}")


if __name__ == "__main__":
    sys.exit(main())
