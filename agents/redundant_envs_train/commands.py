"""The command line: one function for each command, its help, and completion of its arguments."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Annotated, Any

from redundant_envs.extras import needs
from redundant_envs.values import shown

from . import COMMAND, command
from .options import Folder, Folders, Out, Overwrite, PolicyFolder, Runs, Trust, complete, presets
from .study_commands import study
from .training.interrupt import Stopped

with needs("train"):
    import pydantic  # noqa: F401 - typer imports it while it reads the words
    import typer
    import typer.core

# This module imports nothing large: a command checks its arguments before it imports torch, so that a wrong
# name is refused at once.


class Interrupted(Exception):
    """Ctrl-C inside a command, which typer would otherwise handle itself."""


class _Train(typer.core.TyperCommand):
    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """All keys of a configuration."""
        from .config.keys import help_of_keys

        self.epilog = help_of_keys()
        super().format_epilog(ctx, formatter)


class _Commands(typer.core.TyperGroup):
    def invoke(self, ctx: Any) -> Any:
        """Run a command; interrupts are passed on to the caller."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as stop:
            raise Interrupted(str(stop)) from stop


app = typer.Typer(
    help="Train, evaluate, play and report policies. --import MODULE before the command imports a module of "
    "yours first, whose arms, effects and tasks are then known.", no_args_is_help=True, rich_markup_mode=None,
    pretty_exceptions_enable=False, cls=_Commands,
)  # fmt: skip
app.add_typer(study, name="study")

PLACES = ("processes", "ray")
"""Where several runs are executed."""


def run(arguments: list[str]) -> int:
    """Run one command; a ValueError says in one line what is wrong with the command."""
    try:
        app(args=arguments, prog_name=COMMAND, standalone_mode=False)
    except Interrupted as stop:
        raise KeyboardInterrupt(*stop.args) from stop
    except Exception as error:
        if not hasattr(error, "format_message"):  # of typer, or of click in its older versions
            raise
        return _usage(error)
    return 0


def _usage(error: Any) -> int:
    """Show a usage error; without any words, the help."""
    message, context = error.format_message(), getattr(error, "ctx", None)
    if type(error).__name__ == "NoArgsIsHelpError":
        print(message, file=sys.stderr)
        return 2
    if context is None:
        raise ValueError(f"{message.rstrip('.')}; see {COMMAND} --help")
    names = context.command.list_commands(context) if hasattr(context.command, "list_commands") else []
    more = f"choose {', '.join(names)}; or " if names else ""
    raise ValueError(f"{message.rstrip('.')}; {more}see {context.command_path} --help")


@app.command(cls=_Train)
def train(
    config: Annotated[str, typer.Argument(help="YAML file, or a preset's name", autocompletion=presets)],
    overrides: Annotated[
        list[str] | None,
        typer.Argument(help="key=value, such as seed=3 ppo.gamma=0.98", autocompletion=complete),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="run folder (default runs/<config>_seed<seed>_<time>)")
    ] = None,
    seeds: Annotated[
        str | None, typer.Option(help="several runs, such as 0..9 or 1,4,7; --out is the folder of theirs")
    ] = None,
    processes: Annotated[
        int | None, typer.Option(help="runs at a time, each on its own core (default: all cores)")
    ] = None,
    on: Annotated[
        str, typer.Option(help="where several runs go: processes of this machine, or a ray cluster")
    ] = "processes",
    address: Annotated[
        str | None, typer.Option(help="of the Ray cluster, such as 10.0.0.1:6379 (default: this machine)")
    ] = None,
) -> None:
    """Train, evaluate and report."""
    check_place(on, address, seeds)
    from .config import load
    from .drawing import check_drawing
    from .new_folder import check_new
    from .start import with_start
    from .training.amount import count_of, seeds_of

    name = Path(config).stem
    stamp = time.strftime("%Y%m%d-%H%M%S")
    if seeds is not None:
        if any(override.startswith("seed=") for override in overrides or ()):
            raise ValueError("seed is given beside --seeds; leave one of them out")
        folder = out or Path("runs") / f"{name}_{stamp}"
        each = [(k, [*(overrides or ()), f"seed={k}"]) for k in seeds_of(seeds)]
        chosen = {f"seed{k}": with_start(load(config, words)) for k, words in each}
        count_of(processes)
        check_drawing()
        if on == "ray":
            from .training.on_ray import train_on_ray

            train_on_ray(chosen, folder, address, processes)
        else:
            from .training.many import train_many

            train_many(chosen, folder, processes)
        from .evidence.table import table

        print(table(sorted(p.parent for p in folder.glob("*/evaluation.json"))))
        return
    if processes is not None:
        raise ValueError("processes is for several seeds; give --seeds, such as --seeds 0..9")
    one = with_start(load(config, overrides or ()))
    folder = out or Path("runs") / f"{name}_seed{one.seed}_{stamp}"
    check_new(folder)
    check_drawing()
    from .training.train import train

    facts = train(one, folder)
    try:
        _finish(folder, facts)
    except KeyboardInterrupt:
        raise Stopped(f"stopped after the training; go on with: {command('report', folder)}") from None


def _finish(folder: Path, facts: dict[str, Any]) -> None:
    """Evaluate and report a run that was trained to its end."""
    from .evaluate import evaluate, summary, write_evaluation
    from .report import report

    found = evaluate(folder)
    write_evaluation(found, folder)
    print(summary(found.result))
    print(f"{facts['env_steps']} environment steps in {facts['train_seconds']:.0f} s")
    print(f"report: {report(folder, overwrite=True)}")


def check_place(on: str, address: str | None, seeds: str | None) -> None:
    """Refuse an unknown ``--on``, and options of several runs or of Ray that have no effect."""
    if on not in PLACES:
        raise ValueError(f"on is {shown(on)}; choose {' or '.join(PLACES)}")
    if on != "processes" and seeds is None:
        raise ValueError(f"on {on} is for several seeds; give --seeds, such as --seeds 0..9")
    if address is not None and on != "ray":
        raise ValueError(f"address is {shown(address)}, which is for Ray; add --on ray")


@app.command()
def tune(
    config: Annotated[str, typer.Argument(help="YAML file, or a preset's name", autocompletion=presets)],
    overrides: Annotated[
        list[str] | None,
        typer.Argument(
            help="key=value, such as total_steps=1000000; it is not searched", autocompletion=complete
        ),
    ] = None,
    trials: Annotated[int, typer.Option(help="trainings in all")] = 30,
    out: Annotated[
        Path | None,
        typer.Option(help="folder; a stopped study in it is continued (default runs/tune/CONFIG)"),
    ] = None,
    search: Annotated[
        list[str] | None,
        typer.Option(
            help="key=low..high or key=a|b|c, instead of the learner's default search; may be repeated"
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="of the sampler")] = 0,
    processes: Annotated[
        int, typer.Option(help="trials at a time, each on its own core; 1 to 4 give the same results")
    ] = 1,
) -> None:
    """Search the learner's settings that hold most goals, with Optuna."""
    from .config import load
    from .start import with_start
    from .tuning.arguments import check_arguments
    from .tuning.search import space_of

    base = with_start(load(config, overrides or ()))
    check_arguments(base, trials, seed, processes)
    space_of(base, search or (), overrides or ())
    from .tuning.study import tune

    folder = out or Path("runs") / "tune" / Path(config).stem
    path = tune(base, folder, trials, search or (), overrides or (), seed, processes)
    print(path.read_text(encoding="utf-8"))
    print(f"best: {folder / 'best.yaml'}")


@app.command()
def resume(folder: Folder) -> None:
    """Go on with a training that was stopped or killed, from its last checkpoint, to the same bits."""
    from .drawing import check_drawing
    from .own_scene import own_config, tell_differences

    own_config(folder)
    check_drawing()
    tell_differences([folder])
    from .training.train import resume

    _finish(folder, resume(folder))


@app.command()
def evaluate(
    folder: PolicyFolder, out: Out = None, overwrite: Overwrite = False, trust: Trust = False
) -> None:
    """Evaluate the policy of a run folder, or an exported one, in the scene that it was trained in.

    Prints the results, and writes nothing. With --out FOLDER evaluation.json and episodes.csv are written
    there; with --overwrite they replace those of the run folder.
    """
    from .drawing import EVALUATED
    from .new_folder import check_unwritten
    from .own_scene import own_config, tell_differences

    own_config(folder)
    if out is not None:
        check_unwritten(out, EVALUATED, overwrite)
    tell_differences([folder])
    from .evaluate import evaluate, summary, write_evaluation

    found = evaluate(folder, trust)
    print(summary(found.result))
    if out is not None or overwrite:
        write_evaluation(found, out or folder)
        print(f"written: {(out or folder) / EVALUATED[0]}")


@app.command()
def report(folder: PolicyFolder, out: Out = None, overwrite: Overwrite = False, trust: Trust = False) -> None:
    """Draw plots, clips and report.md of a run folder, or of an exported policy.

    A run without a report, such as one that was stopped, gets it in its folder. If files would be
    replaced, and for an exported policy, --out FOLDER or --overwrite is needed.
    """
    from .drawing import check_drawing, check_target
    from .own_scene import own_config, tell_differences

    own_config(folder)
    check_target(folder, out, overwrite)
    check_drawing()
    tell_differences([folder])
    from .report import report

    print(f"report: {report(folder, out, overwrite, trust)}")


@app.command()
def table(
    runs: Runs,
    out: Annotated[
        Path | None, typer.Option(help="write a table of runs, .csv: all numbers and settings of each run")
    ] = None,
) -> None:
    """Print evaluated runs as a Markdown table, seeds of equal settings in one row.

    With --out all runs are collected in one file, which `table`, `curves` and `study strength` read as they
    read the run folders.
    """
    from .evidence.run_table import read_groups, write_runs
    from .evidence.table import table
    from .new_folder import check_out
    from .own_scene import tell_differences

    if out is not None:
        if out.suffix.lower() != ".csv":
            raise ValueError(f"out is {out}; end its name in .csv")
        check_out(out.parent)
    text = table(runs)
    tell_differences(runs)
    print(text)
    if out is not None:
        write_runs([run for same in read_groups(runs) for run in same.runs], out)


@app.command()
def curves(
    runs: Runs,
    out: Annotated[Path, typer.Option(help="picture, .png or .svg; its numbers are saved beside it")] = Path(
        "runs/curves.png"
    ),
) -> None:
    """Draw learning curves of runs: all seeds, their interquartile mean and its interval."""
    from .evidence.curves import curves
    from .new_folder import check_out
    from .own_scene import tell_differences

    check_out(out.parent)
    curves(runs, out)
    tell_differences(runs)
    print(out)


@app.command()
def play(
    target: Annotated[
        str, typer.Argument(help="run folder, folder of an exported policy, or id such as RPRPReach-v0")
    ],
    actions: Annotated[
        str | None, typer.Option(help="actions for an id: zero, random or expert (default expert)")
    ] = None,
    clip: Annotated[
        Path | None, typer.Option(help="write a .gif or .mp4 instead of opening a window")
    ] = None,
    episodes: int = 3,
    seed: int = 0,
    trust: Trust = False,
) -> None:
    """Watch a run folder's policy, or an id without one."""
    from .play import play

    play(target, actions, clip, episodes, seed, trust)


@app.command()
def export(
    folders: Folders,
    out: Annotated[Path, typer.Option(help="folder of the policies' folders")] = Path("runs/policies"),
) -> None:
    """Write policies for others: stable-baselines3, ONNX, NumPy arrays, and a card."""
    from .evidence.runs import read_run
    from .own_scene import tell_differences

    for folder in folders:
        read_run(folder)
    tell_differences(folders)
    from .shipping.export import export_all

    for folder in export_all(folders, out):
        print(folder)


@app.command()
def schema() -> None:
    """Print the JSON schema of a training configuration, for editors."""
    import json

    from .config import Config

    print(json.dumps(Config.model_json_schema(), indent=2))
