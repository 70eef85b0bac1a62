"""The command line: files, output and refusals."""

from __future__ import annotations

import csv

import gymnasium as gym
import numpy as np
import pytest
import yaml

from redundant_envs import bill, listing, load_scene
from redundant_envs.__main__ import main
from redundant_envs.envs.registration import ids
from redundant_envs.numerics.tableaus import METHODS
from redundant_envs.scene import scene_names


def rows(path):
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_simulate_writes_numbers_and_pictures(tmp_path, capsys):
    assert main(["simulate", "--seconds", "0.2", "--out", str(tmp_path)]) == 0
    out, err = capsys.readouterr()
    assert (out.count("relative drift"), err.count("simulate ")) == (4, 4)
    for name in ("rprp_report_spring", "rprp_stops", "rprp_limit_springs", "four_r_free"):
        for kind in ("energies", "total"):
            assert (tmp_path / f"{name}_{kind}.png").stat().st_size > 1000
        table, arm = rows(tmp_path / f"{name}.csv"), load_scene(name).robot
        assert [*table[0]] == ["t", *arm.coordinates, *arm.rates, "kinetic", "potential", "work", "total"]
        assert float(table[-1]["t"]) == pytest.approx(0.2)
        assert np.ptp([float(r["total"]) for r in table]) < 1e-6 * max(float(r["kinetic"]) for r in table)


def test_simulate_takes_a_file_and_a_state_and_draws_a_clip(tmp_path):
    imageio = pytest.importorskip("imageio.v3")
    path, clip = tmp_path / "mine.yaml", tmp_path / "arm.gif"
    path.write_text(yaml.safe_dump(load_scene("four_r_free").to_dict()), encoding="utf-8")
    words = f"simulate --scene {path} --out {tmp_path} --clip {clip} --seconds 0.2"
    assert main(f"{words} --q 1 -0.5 0 0.25 --qd 0 0 -1 0".split()) == 0
    first = [float(x) for x in rows(tmp_path / "mine.csv")[0].values()]
    assert first[:9] == [0.0, 1.0, -0.5, 0.0, 0.25, 0.0, 0.0, -1.0, 0.0]
    assert imageio.imread(clip, index=None).shape[:3] == (6, 480, 480)


CHAIN = "robot: {type: Chain, joint_types: RR, masses: [1, 1], lengths: [0.2, 0.2]}\n"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("simulate --clip a.gif", "exactly one --scene"),
        ("simulate --scene four_r_free four_r_free", "same name twice"),
        ("simulate --scene four_r_free --seconds -1", "seconds is -1.0"),
        ("study throughput --config nowhere.yaml", "no such file"),
        ("study environments --lanes 0", "lanes is 0"),
        ("scene four_r_free --source", "use --listing or --bill"),
        ("scene chain.yaml --drawing chain.svg", "only RPRP and FourR have a drawing"),
        ("scene nowhere", ", ".join(scene_names())),
        ("simulate --scene nowhere", ", ".join(scene_names())),
    ],
)
def test_mistakes_exit_with_2(words, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "chain.yaml").write_text(CHAIN)
    assert main(words.split()) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert message in err


def test_scene_prints_itself_its_listing_and_its_bill(capsys):
    def printed(*words):
        assert main(["scene", *words]) == 0
        return capsys.readouterr().out

    name = "rprp_limit_springs"
    assert load_scene(yaml.safe_load(printed(name))) == load_scene(name)
    text = printed("four_r_free", "--listing")
    assert text == listing(load_scene("four_r_free"))
    assert "redundant_envs/robots/four_r.py:" in text
    head, *lines = [line.split() for line in printed(name, "--bill").splitlines()]
    assert head == ["of", "additions", "products", "divisions", "roots", "sine_pairs", "bytes"]
    assert {owner: tuple(map(int, numbers)) for owner, *numbers in lines} == bill(load_scene(name))


def test_the_drawing_of_a_scene_is_the_same_every_time(tmp_path):
    for kind in ("svg", "png"):
        pictures = [tmp_path / f"{name}.{kind}" for name in ("one", "two")]
        for path in pictures:
            assert main(["scene", "rprp_reach", "--drawing", str(path)]) == 0
        assert pictures[0].read_bytes() == pictures[1].read_bytes()


def test_list_names_everything(capsys):
    assert main(["list"]) == 0
    registered = {i for i in gym.registry if i.startswith("redundant_envs/")}
    studies = {"throughput", "environments", "stops", "accuracy"}
    assert {*ids(), *registered, *scene_names(), *METHODS, *studies} <= {*capsys.readouterr().out.split()}


def test_throughput_writes_csv(tmp_path, capsys):
    config = tmp_path / "tiny.yaml"
    case = {"arm": "FourR", "integrator": "rk4", "bar_ns": 45}
    data = {"lanes": 16, "repeats": 2, "bar_gflops": 53, "cases": [case]}
    config.write_text(yaml.safe_dump(data), encoding="utf-8")
    assert main(["study", "throughput", "--config", str(config), "--out", str(tmp_path)]) == 0
    assert "ns_per_step_best" in capsys.readouterr().out
    found = [(r["arm"], r["integrator"], r["lanes"]) for r in rows(tmp_path / "throughput.csv")]
    assert found == [("FourR", "rk4", "16")]
