"""A command line refuses mistakes with one line and status 2, before anything large is imported."""

import json
import subprocess
import sys

import pytest

from redundant_envs import __main__ as library
from redundant_envs_train.__main__ import main

WRONG = {
    "nope": "choose train, tune",
    "--nope": "No such option",
    "--import": "names no module",
    "--import nope train x": "give the name of a module",
    "train": "Missing argument",
    "train nope": "the presets are",
    "train rprp_reach_ppo sed=1": "sed is unknown; valid:",
    "train rprp_reach_ppo seed": "write key=value",
    "train rprp_reach_ppo seed=x": "seed is 'x'; give a whole number",
    "train rprp_reach_ppo ppo.gamma=5": "ppo.gamma is 5.0; give a number from 0 to 1",
    "train rprp_reach_ppo --seeds x": "seeds is 'x'; write such as 0..9",
    "train rprp_reach_ppo --seeds 3..1": "write the lower one first",
    "train rprp_reach_ppo --seeds 0..1 seed=1": "leave one of them out",
    "train rprp_reach_ppo --seeds 0..1 --processes 0": "processes is 0",
    "train rprp_reach_ppo --processes 2": "give --seeds",
    "train rprp_reach_ppo --processes x": "valid integer",
    "train rprp_reach_ppo --on moon": "on is 'moon'; choose processes or ray",
    "train rprp_reach_ppo --address a:1": "add --on ray",
    "train rprp_reach_ppo --nope": "No such option",
    "train rprp_reach_ppo --seeds": "requires an argument",
    "train rprp_reach_ppo --out configs": "run folder configs is not empty",
    "tune nope": "the presets are",
    "tune rprp_reach_ppo sed=1": "sed is unknown",
    "tune rprp_reach_ppo --trials x": "valid integer",
    "tune rprp_reach_ppo --trials 0": "trials is 0",
    "tune rprp_reach_ppo --processes 0": "processes is 0",
    "tune rprp_reach_ppo --search x": "write key=low..high",
    "tune rprp_reach_ppo --search ppo.nope=0..1": "search key 'ppo.nope' is unknown",
    "train rprp_reach_ppo start_from=nope": "there is no nope",
    "train rprp_reach_sac start_from=policies/RPRPReach-v0-ppo": "start_from is a policy of ppo",
    "resume nope": "give a run folder",
    "evaluate": "Missing argument 'folder'",
    "evaluate nope": "give a run folder",
    "evaluate nope more": "unexpected extra argument",
    "report nope": "give a run folder",
    "table nope": "give a run folder",
    "table nope --out a.txt": "end its name in .csv",
    "curves nope": "give a run folder",
    "export nope": "give a run folder",
    "play nope": "give a run folder or one of redundant_envs/RPRPReach-v0",
    "play RPRPReach-v0 --actions foo": "--actions is 'foo'; choose zero, random, expert",
    "play policies/RPRPReach-v0-ppo --actions zero": "a run folder plays its policy",
    "play RPRPReach-v0 --episodes x": "valid integer",
    "play RPRPReach-v0 --episodes 0": "episodes is 0; give at least 1",
    "play RPRPReach-v0 --seed -1": "seed is -1; give at least 0",
    "play RPRPReach-v0 --clip a.txt": "end its name in .gif or .mp4",
    "schema x": "unexpected extra argument",
    "study nope": "choose stops, policy, strength",
    "study stops nope": "give a run folder",
    "study policy nope": "write key=value",
    "study policy --config nope.yaml": "nope.yaml",
    "study strength --seeds x": "seeds is 'x'",
    "study strength --factors 0": "factors is '0'",
}
"""Words of a command, and its message."""
LARGE = ("torch", "stable_baselines3", "onnx")
CALLS = f"""
import contextlib, io, json, sys
from redundant_envs_train.__main__ import main
found = {{}}
for words in json.loads(sys.argv[1]):
    said, out = io.StringIO(), io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(out):
        try:
            code = main(words.split())
        except BaseException as error:
            code = repr(error)
    large = [name for name in {LARGE} if name in sys.modules]
    found[words] = [code, out.getvalue(), said.getvalue(), large]
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def answers():
    """Results of every command: status, stdout, stderr and the large packages imported so far."""
    done = subprocess.run(
        [sys.executable, "-c", CALLS, json.dumps(list(WRONG))], capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout)


@pytest.mark.parametrize("words", WRONG)
def test_a_mistake_is_one_line_and_status_2_before_anything_large_is_imported(words, answers):
    code, out, err, large = answers[words]
    assert (code, out, large) == (2, "", []), err
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert WRONG[words] in err


def test_a_wrong_name_is_refused_before_the_parser_is_imported():
    """Its packages alone take longer than the rest."""
    program = (
        "import sys; from redundant_envs_train.__main__ import main; assert main(['train', 'nope']) == 2; "
        "assert not {'torch', 'pydantic', 'typer', 'stable_baselines3'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)


def test_a_command_without_words_shows_its_help(capsys):
    for words in ([], ["study"]):
        assert main(words) == 2
        assert "Commands:" in capsys.readouterr().err


def test_the_help_of_train_has_all_keys(capsys):
    assert main(["train", "--help"]) == 0
    assert "ppo.gamma: discount per control step" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    "words",
    [
        "nope", "", "simulate --seconds x", "simulate --nope", "simulate --scene", "simulate --scene nope",
        "simulate --clip a.txt --scene rprp_reach", "simulate --seconds nan --scene rprp_reach",
        "simulate --scene rprp_reach --q 1", "verify nope", "verify --quick --full", "verify --states x",
        "verify rprp_reach --states 0", "verify --bits rprp_reach", "verify --bits short --quick", "study",
        "study nope", "study throughput --config nope.yaml", "study impacts --intervals 0",
        "study intervals --processes 0", "study stops --lanes 1", "study environments --rounds 0",
        "scene rprp_reach --drawing a.gif", "study accuracy --config nope.yaml", "scene", "scene nope",
        "scene rprp_reach --listing x", "list x", "--import", "--import nope list",
    ],
)  # fmt: skip
def test_a_mistake_in_a_command_of_the_library_is_one_line_and_status_2(words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert library.main(words.split()) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("redundant_envs: ")
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())
