"""Commands of the README and the manual: their arguments parse, and the quick ones run."""

import importlib
import re
import runpy
import shlex
import shutil
import sys

import pytest
from markdown import MANUAL, ROOT, commands
from published_runs import RESULTS, published_run

typer = pytest.importorskip("typer", reason="commands of agents need the extra 'train'")

RUN = "runs/rprp_reach_sac/seed100"
FOUND = {command for page in MANUAL for command in commands(page)}
QUICK = (
    "python -m redundant_envs list",
    "python -m redundant_envs scene four_r_free --bill",
    "python -m redundant_envs verify --quick four_r_reach",
    "python -m redundant_envs scene rprp_reach --drawing runs/arm.svg",
    "python -m agents table docs/results/runs.jsonl",
    "python docs/examples/play_with_numpy.py policies/RPRPReach-v0-sac",
)
SLOWER = (
    "python -m redundant_envs scene rprp_reach --cost",
    "python -m redundant_envs verify --bits",
    "python -m redundant_envs simulate --scene four_r_free --seconds 3 --clip runs/falls.gif",
    "python -m agents curves docs/results/runs.jsonl --out runs/curves.png",
    "python -m agents evaluate RUN",
    "python -m agents report RUN",
    "python -m agents export RUN",
    "python -m agents dataset RUN --out runs/datasets/mine-v0",
    "python -m agents play policies/FourRReach-v0-sac --clip four_r.gif",
)
"""Of under a minute each. The others train, measure for minutes, open a window or need a reader's files."""


def words_of(command):
    """The words of a command; patterns become files, placeholders something that exists."""
    found = []
    for word in shlex.split(re.sub(r"\$\(.*\)", "", command)):
        word = {"RUN": RUN, "FILE": "some.json"}.get(word, word)
        paths = ROOT.glob(word) if "*" in word and "{" not in word else ()
        found += sorted(str(path.relative_to(ROOT)) for path in paths) or [word]
    return found


def parse(command):
    """Parse the arguments of a command."""
    _, _, module, *words = words_of(command)
    if module in ("redundant_envs", "studies"):
        if words[:1] == ["--import"]:
            words = words[2:]
        importlib.import_module(f"{module}.__main__").parser().parse_args(words)
    elif module == "agents" and "--help" not in words:
        from redundant_envs_train.commands import app
        from redundant_envs_train.config import load

        step, name = typer.main.get_command(app), words[0]
        while hasattr(step, "commands"):
            step = step.commands[words.pop(0)]
        given = step.make_context("command", words).params
        if name in ("train", "tune") and not given["config"].startswith("runs/"):
            load(given["config"], given["overrides"] or ())


@pytest.mark.parametrize("page", MANUAL, ids=lambda page: page.stem)
def test_every_command_of_a_block_takes_its_arguments(page):
    for command, in_block in commands(page).items():
        if command.startswith("python docs/examples"):
            assert (ROOT / command.split()[1]).is_file()
        elif in_block:
            try:
                parse(command)
            except (SystemExit, Exception) as error:
                pytest.fail(f"{command}: {error!r}")


@pytest.mark.parametrize("command", [*QUICK, *(pytest.param(c, marks=pytest.mark.long) for c in SLOWER)])
def test_commands_run(command, tmp_path, monkeypatch, capsys):
    """In a separate folder, with copies of the files that they may write to."""
    assert command in FOUND, f"{command} is on no page any more"
    for name in ("policies", "configs", "docs/examples"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).symlink_to(ROOT / name)
    if "RUN" in command.split():
        published_run("rprp_reach_sac/seed100", tmp_path / RUN)
        if "report" in command:
            (tmp_path / RUN / "evaluation.json").unlink()  # as where a training has just ended
    else:
        (tmp_path / "docs" / "results").mkdir()
        shutil.copy(RESULTS / "runs.jsonl", tmp_path / "docs" / "results")
    words = words_of(command)
    monkeypatch.chdir(tmp_path)
    if words[1] == "-m":
        assert importlib.import_module(f"{words[2]}.__main__").main(words[3:]) == 0
    else:
        monkeypatch.setattr(sys, "argv", words[1:])
        runpy.run_path(words[1], run_name="__main__")
    assert capsys.readouterr().out
