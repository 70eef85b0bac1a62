"""The command line: files, output and refusals."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import yaml
from published_runs import rows

from redundant_envs import bill, listing, load_scene
from redundant_envs.__main__ import main
from redundant_envs.scenes.scene import scene_names
from redundant_envs.scenes.tableaus import METHODS

CHAIN = "robot: {type: Chain, joint_types: RR, masses: [1, 1], lengths: [0.2, 0.2]}\n"
SCENES = ", ".join(scene_names())
NEEDS_UNIX = pytest.mark.skipif(sys.platform == "win32", reason="Windows has other pipes and terminals")


@pytest.mark.long
def test_simulate_writes_numbers_and_pictures_of_all_presets(tmp_path):
    assert main(["simulate", "--seconds", "0.2", "--out", str(tmp_path)]) == 0
    for name in ("rprp_report_spring", "rprp_stops", "rprp_limit_springs", "four_r_free"):
        for kind in ("energies", "total"):
            assert (tmp_path / f"{name}_{kind}.png").stat().st_size > 1000
        table, arm = rows(tmp_path / f"{name}.csv"), load_scene(name).robot
        assert [*table[0]] == ["t", *arm.coordinates, *arm.rates, "kinetic", "potential", "work", "total"]
        assert float(table[-1]["t"]) == pytest.approx(0.2)
        assert np.ptp([float(r["total"]) for r in table]) < 1e-6 * max(float(r["kinetic"]) for r in table)


@pytest.mark.long
def test_simulate_takes_a_file_and_a_state(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(load_scene("four_r_free").to_dict()), encoding="utf-8")
    words = f"simulate --scene {path} --out {tmp_path} --seconds 0.2 --q 1 -0.5 0 0.25 --qd 0 0 -1 0"
    assert main(words.split()) == 0
    first = [float(x) for x in rows(tmp_path / "mine.csv")[0].values()]
    assert first[:9] == [0.0, 1.0, -0.5, 0.0, 0.25, 0.0, 0.0, -1.0, 0.0]


def test_export_writes_a_file_and_says_what_it_lacks(tmp_path, capsys):
    path = tmp_path / "new" / "arm.xml"
    words = ["--format", "mjcf", "--out", str(path)]
    assert main(["export", "four_r_reach", *words]) == 0
    assert "from the scene four_r_reach." in path.read_text(encoding="utf-8")
    assert capsys.readouterr().out == f"{path} ({path.stat().st_size} bytes)\n"
    assert main(["export", "rprp_reach", "--approximate", "--force", *words]) == 0
    assert "  PrismaticStop: " in capsys.readouterr().out
    assert "PrismaticStop: " in path.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("nope", "invalid choice: 'nope'"), ("--import", "names no module"),
        ("simulate --nope", "unrecognized arguments: --nope"), ("verify --states x", "invalid int value"),
        ("simulate --clip a.gif", "exactly one --scene"),
        ("simulate --scene four_r_free four_r_free", "four_r_free.csv would be written twice"),
        ("simulate --scene four_r_free --seconds -1", "seconds is -1.0"),
        ("study effects Wind --help", "not in the wheel; run there: python -m studies effects Wind --help"),
        ("scene nowhere", SCENES),
        ("scene chain.yaml --drawing chain.pdf", "chain.pdf; give a file that ends in .svg or .png"),
        ("verify --quick four_r_reach --json broken/a", "is broken, which is a broken link; choose"),
        ("verify --quick mine:arm --json ./mine.py --force", "mine.py would be replaced, and is what"),
        ("cache", "relative cannot be used (it is not an absolute path); set REDUNDANT_"),
        ("wasm four_r_free", "scene has no EffortLimits"),
        ("export four_r_reach --format sdf --out a", "format is 'sdf'; choose mjcf, urdf, casadi, c"),
        ("export rprp_reach --format mjcf --out a", "PrismaticStop (stops are only soft there"),
        ("page --policies nowhere", "nowhere, which is no folder"),
        ("verify four_r_free nowhere", "'nowhere' is nothing that verify knows"),
        ("verify four_r_free --json .", "is a folder"),
        ("verify four_r_free --states 0", "states is 0; give at least 1"),
        ("verify four_r_free --json /dev/null/found.json", "which is a file; choose another place"),
        ("verify four_r_free --bits", "leave out subject"),
        ("verify --bits all --quick", "leave out mode"),
        ("verify --quick --full", "not allowed with argument"),
    ],
)  # fmt: skip
def test_mistakes_exit_with_2_and_write_nothing(words, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if words == "cache":
        monkeypatch.setenv("REDUNDANT_ENVS_CACHE", "relative")
    Path("chain.yaml").write_text(CHAIN)
    Path("mine.py").write_text("import redundant_envs as rde\narm = rde.FourR\n")
    Path("broken").symlink_to("nowhere")
    before = {path.name: path.read_bytes() for path in tmp_path.glob("*.*")}
    assert main(words.split()) == 2
    out, err = capsys.readouterr()
    (told,) = (line for line in err.splitlines() if not line.startswith("simulate 1/1"))  # no progress
    assert (out, told[:16]) == ("", "redundant_envs: ")
    assert message in told
    assert {path.name: path.read_bytes() for path in tmp_path.glob("*.*")} == before


def test_scene_prints_itself_its_listing_and_its_bill(capsys):
    def printed(*words):
        assert main(["scene", *words]) == 0
        return capsys.readouterr().out

    name = "rprp_limit_springs"
    assert load_scene(yaml.safe_load(printed(name))) == load_scene(name)
    assert printed("four_r_free", "--listing") == listing(load_scene("four_r_free"))
    head, *lines = [line.split() for line in printed(name, "--bill").splitlines()]
    assert (head[0], head[-1]) == ("of", "bytes")
    assert {owner: tuple(map(int, numbers)) for owner, *numbers in lines} == bill(load_scene(name))


@pytest.mark.parametrize("kept", ["module://matplotlib_inline.backend_inline", "pdf"])
def test_a_command_of_a_notebook_does_not_take_its_back_end_for_figures(kept, monkeypatch):
    monkeypatch.setenv("MPLBACKEND", kept)
    assert main(["list"]) == 0
    assert os.environ.get("MPLBACKEND") == (kept if kept == "pdf" else None)


def test_list_names_everything(capsys):
    assert main(["list"]) == 0
    registered = {i for i in gym.registry if i.startswith("redundant_envs/")}
    assert {*registered, *scene_names(), *METHODS} <= {*capsys.readouterr().out.split()}


@pytest.mark.quick("list")
@NEEDS_UNIX
@pytest.mark.parametrize(
    "words",
    ["redundant_envs list", "redundant_envs verify --quick rprp_reach", "agents schema"],
    ids=lambda words: words.split()[1],
)
def test_a_command_ends_in_silence_where_nobody_reads_on(words):
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", *words.split()]
    done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True)
    os.close(writer)
    progress = ("redundant-envs: compiling", "verify ")
    said = [line for line in done.stderr.splitlines() if not line.startswith(progress)]
    assert (done.returncode, said) == (141, [])


@NEEDS_UNIX
@pytest.mark.parametrize(
    ("words", "streams", "status", "said"),
    [
        ("list", ">&-", 0, ""),
        ("scene nope", "2>&-", 2, ""),
        ("list", ">/dev/full", 2, "redundant_envs: [Errno 28] No space left on device\n"),
    ],
    ids=["list", "scene", "full"],
)
def test_a_command_whose_streams_are_closed_does_its_work_and_with_full_ones_says_so(
    words, streams, status, said
):
    if "full" in streams and not os.path.exists("/dev/full"):
        pytest.skip("this system has no full device")
    command = f"{shlex.quote(sys.executable)} -m redundant_envs {words} {streams}"
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (status, "", said)
