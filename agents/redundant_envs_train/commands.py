"""The command line: one function for each command, its help, and completion of its arguments."""

import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from redundant_envs.support.disk import check_kept
from redundant_envs.support.extras import needs
from redundant_envs.support.values import check_between, say, shown

from . import COMMAND, command, run_folder
from .config import WITHOUT_EFFECT, Config, check_telemetry, load
from .config.files import is_override, page_of_keys, presets
from .evidence import curves as curve_pictures
from .evidence import table as tables
from .evidence.runs import TABLE, read_groups, read_places, write_runs
from .training.pool import Stopped, seeds_of

with needs("train"):
    import pydantic  # noqa: F401 - typer imports it while it reads the words
    import typer
    import typer.core
    from typer import Argument, Option

# Nothing large is imported here: a wrong argument is refused at once, before torch is imported.

Text = str | None  # values that may be left out
Words = list[str] | None
Place = Path | None

Training = Annotated[str, Argument(help="YAML file, preset, or env=ID without one", autocompletion=presets)]
OVERRIDES = "key=value, such as seed=3 ppo.gamma=0.98; tune does not search what has a value"
Overrides = Annotated[Words, Argument(help=OVERRIDES)]
Folder = Annotated[Path, Argument(help="run folder")]
PolicyFolder = Annotated[Path, Argument(help="run folder, or folder of an exported policy")]
Runs = Annotated[
    list[Path], Argument(help="run folders; tables of runs, or runs of a table, such as runs.jsonl/*_sac/*")
]
Out = Annotated[Place, Option(help="folder to write to")]
Force = Annotated[bool, Option("--force", help="replace files that exist")]
Overwrite = Annotated[
    bool, Option("--force", "--overwrite", help="write into the run folder, or replace files in --out")
]
Trust = Annotated[
    bool,
    Option("--trust", help="unpickle policy.zip, as stable-baselines3 does: runs any code its author put in"),
]
Seeds = Annotated[Text, Option(help="several runs, such as 0..9 or 1,4,7; --out is the folder of theirs")]
Where = Annotated[str, Option(help="where several runs go: processes of this machine, or a ray cluster")]
Address = Annotated[Text, Option(help="of the Ray cluster, such as 10.0.0.1:6379 (default: this machine)")]
Harmless = Annotated[Words, Argument(help=f"{' or '.join(WITHOUT_EFFECT)}, such as telemetry=[csv]")]
Table = Annotated[Place, Option(help="write a table of runs, .jsonl: all numbers and settings of each run")]
Picture = Annotated[Path, Option(help="picture, .png or .svg; its numbers are saved beside it")]
Source = Annotated[
    str, Argument(help="expert, near, random, or folder of a run or an exported policy", metavar="SOURCE")
]
Env = Annotated[Text, Option(help="id such as RPRPReach-v0, or a configuration; a policy has its own")]


class _Commands(typer.core.TyperGroup):
    def invoke(self, ctx: Any) -> Any:
        """Run a command; Ctrl-C, which typer would otherwise handle itself, is passed on to the caller."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as stop:
            raise typer.Abort from stop


app = typer.Typer(
    help="Train, evaluate, play and report policies. --import MODULE before the command imports a module of "
    "yours first, whose arms, effects and tasks are then known.", no_args_is_help=True, rich_markup_mode=None,
    pretty_exceptions_enable=False, cls=_Commands,
)  # fmt: skip


def run(arguments: list[str]) -> int:
    """Run one command; a ValueError says in one line what is wrong with the command."""
    try:
        app(args=arguments, prog_name=COMMAND, standalone_mode=False)
    except typer.Abort as abort:
        raise abort.__cause__ or abort from None
    except Exception as error:
        if not hasattr(error, "format_message"):  # of typer, or of click in its older versions
            raise
        message, context = error.format_message(), getattr(error, "ctx", None)
        if type(error).__name__ == "NoArgsIsHelpError":
            say(message, file=sys.stderr)
            return 2
        names = getattr(context and context.command, "commands", {})
        more = f"choose {', '.join(names)}; or " if names else ""
        path = context.command_path if context else COMMAND
        raise ValueError(f"{message.rstrip('.')}; {more}see {path} --help") from None
    return 0


@app.command(
    epilog=f"Presets: {', '.join(presets())}.\n\nKeys: {', '.join(Config.model_fields)}, and settings of the "
    f"learner, such as ppo.gamma. {command('schema', '--markdown')} explains each key."
)
def train(
    config: Training,
    overrides: Overrides = None,
    out: Annotated[Place, Option(help="run folder (default runs/<preset>_seed<seed>_<time>)")] = None,
    seeds: Seeds = None,
    processes: Annotated[int | None, Option(help="runs at a time, each on one core (default: all)")] = None,
    on: Where = "processes",
    address: Address = None,
) -> None:
    """Train, evaluate and report."""
    if on not in ("processes", "ray"):
        raise ValueError(f"on is {shown(on)}; choose processes or ray")
    if on != "processes" and seeds is None:
        raise ValueError(f"on {on} is for several seeds; give --seeds, such as --seeds 0..9")
    if address is not None and on != "ray":
        raise ValueError(f"address is {shown(address)}, which is for Ray; add --on ray")
    if processes is not None and seeds is None:
        raise ValueError("processes is for several seeds; give --seeds, such as --seeds 0..9")
    stamp = time.strftime("%Y%m%d-%H%M%S")
    if seeds is not None:
        if any(override.startswith("seed=") for override in overrides or ()):
            raise ValueError("seed is given beside --seeds; leave one of them out")
        chosen = {f"seed{k}": to_train(config, [*(overrides or ()), f"seed={k}"]) for k in seeds_of(seeds)}
        folder = out or Path("runs") / f"{name_of(config, next(iter(chosen.values())))}_{stamp}"
        if on == "ray":
            from .training.on_ray import train_on_ray

            train_on_ray(chosen, folder, address, processes)
        else:
            from .training.many import train_many

            train_many(chosen, folder, processes)
        say(tables.results_table(sorted(p.parent for p in folder.glob("*/evaluation.json"))))
        return
    one = to_train(config, overrides or ())
    folder = out or Path("runs") / f"{name_of(config, one)}_seed{one.seed}_{stamp}"
    run_folder.check_new(folder)
    from .training.train import train

    facts = train(one, folder)
    try:
        _finish(folder, facts)
    except KeyboardInterrupt:
        raise Stopped(f"stopped after the training; go on with: {command('report', folder)}") from None


def to_train(source: str, overrides: Sequence[str]) -> Config:
    config = load(source, overrides)
    check_telemetry(config, overrides)
    return config


def name_of(source: str, config: Config) -> str:
    """What a run is named after: its file or preset; for the file of a run, or none, its task and learner."""
    path = Path(source)
    if not is_override(source) and path.name != "config.yaml":
        return path.stem
    return f"{config.env.rpartition('/')[2]}_{config.algo}"


def _finish(folder: Path, facts: dict[str, Any]) -> None:
    from .report import evaluate, report, summary, write_evaluation

    evaluation = evaluate(folder)
    write_evaluation(evaluation, folder)
    say(summary(evaluation.result))
    shares = ", ".join(f"{name} {100 * share:.0f} %" for name, share in facts["split"].items())
    say(f"{facts['env_steps']} environment steps in {facts['train_seconds']:.0f} s: {shares}")
    say(report(folder))


@app.command()
def tune(
    config: Training,
    overrides: Overrides = None,
    trials: Annotated[int, Option(help="trainings in all")] = 30,
    out: Annotated[
        Place, Option(help="folder; a stopped study in it is continued (default runs/tune/<preset>)")
    ] = None,
    search: Annotated[
        Words,
        Option(help="key=low..high or key=a|b|c, instead of the learner's default search; may be repeated"),
    ] = None,
    seed: Annotated[int, Option(help="of the sampler")] = 0,
    processes: Annotated[int, Option(help="trials at a time; their number changes the settings tried")] = 1,
    storage: Annotated[
        Text,
        Option(help="share the study with other machines: URL of a database, or file of Optuna's journal"),
    ] = None,
) -> None:
    """Search the learner's settings that hold most goals, with Optuna."""
    base = to_train(config, overrides or ())
    from .tune import tune

    folder = out or Path("runs") / "tune" / name_of(config, base)
    check_kept([folder / name for name in ("best.yaml", "trials.csv", "tune.md")], True, [Path(config)])
    path = tune(base, folder, trials, search or (), overrides or (), seed, processes, storage)
    say(path.read_text(encoding="utf-8"))
    say("written:", *(folder / name for name in ("best.yaml", "trials.csv", "tune.md")), sep="\n  ")


@app.command()
def resume(folder: Folder, overrides: Harmless = None) -> None:
    """Go on with a training that was stopped or killed, from its last checkpoint, to the same bits."""
    run_folder.tell_differences([folder])
    from .training.train import resume

    _finish(folder, resume(folder, overrides=overrides or ()))


@app.command()
def evaluate(folder: PolicyFolder, out: Out = None, force: Overwrite = False, trust: Trust = False) -> None:
    """Evaluate the policy of a run folder, or an exported one, in the scene that it was trained in.

    Prints the results, and writes nothing. With --out FOLDER evaluation.json and episodes.csv are written
    there; with --force they replace those of the run folder.
    """
    if out is not None:
        run_folder.check_unwritten(out, run_folder.EVALUATED, force)
    run_folder.tell_differences([folder])
    from .report import evaluate, summary, table_of, write_evaluation

    evaluation = evaluate(folder, trust)
    say(summary(evaluation.result), table_of(evaluation.result), sep="\n\n")
    if out is not None or force:
        write_evaluation(evaluation, out or folder)
        say(f"written: {', '.join(run_folder.EVALUATED)} in {out or folder}")


@app.command()
def report(folder: PolicyFolder, out: Out = None, force: Overwrite = False, trust: Trust = False) -> None:
    """Draw plots, clips and report.md of a run folder, or of an exported policy.

    A run without a report, such as one that was stopped, gets it in its folder. If files would be
    replaced, and for an exported policy, --out FOLDER or --force is needed.
    """
    run_folder.check_target(folder, out, force)
    run_folder.tell_differences([folder])
    from .report import report

    say(report(folder, out, trust))


@app.command()
def table(runs: Runs, out: Table = None, force: Force = False) -> None:
    """Print evaluated runs as a Markdown table, seeds of equal settings in one row.

    With --out all runs are collected in one file, which `table`, `curves` and the study of strength read
    as they read the run folders.
    """
    if out is not None:
        if out.suffix != TABLE:
            raise ValueError(f"out is {out}; end its name in {TABLE}")
        check_kept([out], force, read_places(runs))
    text = tables.results_table(runs)
    run_folder.tell_differences(runs)
    say(text)
    if out is not None:
        write_runs([run for same in read_groups(runs) for run in same.runs], out)


@app.command()
def curves(runs: Runs, out: Picture = Path("runs/curves.png"), force: Force = False) -> None:
    """Draw learning curves of runs: all seeds, their interquartile mean and its interval."""
    check_kept([out, out.with_suffix(".csv")], force, read_places(runs))
    numbers = curve_pictures.curves(runs, out)
    run_folder.tell_differences(runs)
    say(out, numbers, sep="\n")


@app.command()
def play(
    target: Annotated[str, Argument(help="folder of a run or exported policy, or id such as RPRPReach-v0")],
    actions: Annotated[Text, Option(help="for an id: zero, random, expert or near (default expert)")] = None,
    clip: Annotated[Place, Option(help="write a .gif or .mp4 instead of opening a window")] = None,
    episodes: int = 3,
    seed: int = 0,
    trust: Trust = False,
    force: Force = False,
) -> None:
    """Watch a run folder's policy, or an id without one.

    In the window space pauses, the right arrow makes one step, and up and down double and halve the speed.
    """
    if clip is not None:
        check_kept([clip], force, [Path(target)])
    from .play import play

    play(target, actions, clip, episodes, seed, trust)


@app.command()
def export(
    folders: Annotated[list[Path], Argument(help="run folders")],
    out: Annotated[Path, Option(help="folder of the policies' folders")] = Path("runs/policies"),
) -> None:
    """Write policies for others: stable-baselines3, ONNX, NumPy arrays, and a card."""
    run_folder.tell_differences(folders)
    from .shipping.export import export

    for folder in folders:
        say(export(folder, out))


@app.command()
def dataset(
    source: Source,
    out: Annotated[Path, Option(help="folder of the dataset, which must not exist")],
    env: Env = None,
    episodes: int = 1000,
    seed: Annotated[int, Option(help="of the first episode; episode k has SEED + k")] = 0,
    trust: Trust = False,
) -> None:
    """Write episodes as a Minari dataset, from which each one is replayed to the last bit."""
    check_between("episodes", episodes, 1, 1_000_000)
    check_between("seed", seed, 0, 2**32 - 1)
    from .shipping.dataset import write_dataset

    steps = write_dataset(source, env, episodes, seed, out, trust)
    say(f"written: {out}, {episodes} episodes of {steps} steps in all")


@app.command()
def schema(
    markdown: Annotated[bool, Option("--markdown", help="print it as a page for readers instead")] = False,
) -> None:
    """Print the JSON schema of a training configuration, for editors."""
    say(page_of_keys() if markdown else json.dumps(Config.model_json_schema(), indent=2) + "\n", end="")
