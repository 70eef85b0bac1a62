"""The command line: files, output and refusals."""

from __future__ import annotations

import csv
import json

import gymnasium as gym
import numpy as np
import pytest
import yaml

from redundant_envs import bill, listing, load_scene
from redundant_envs.__main__ import main
from redundant_envs.envs.registration import ids
from redundant_envs.numerics.tableaus import METHODS
from redundant_envs.scene import scene_names


def test_simulate_writes_numbers_and_pictures(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    assert main(["simulate", "--seconds", "0.2", "--out", str(tmp_path)]) == 0
    out, err = capsys.readouterr()
    assert out.count("relative drift") == 4
    assert err.count("simulate ") == 4
    for name in ("rprp_report_spring", "rprp_stops", "rprp_limit_springs", "four_r_free"):
        for kind in ("energies", "total"):
            assert (tmp_path / f"{name}_{kind}.png").stat().st_size > 1000
        with (tmp_path / f"{name}.csv").open(encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        arm = load_scene(name).robot
        assert list(rows[0]) == [
            "t", *arm.coordinates, *arm.rates, "kinetic", "potential", "work", "total",
        ]  # fmt: skip
        assert float(rows[-1]["t"]) == pytest.approx(0.2)
        total = np.array([float(r["total"]) for r in rows])
        kinetic = max(float(r["kinetic"]) for r in rows)
        assert np.ptp(total) < 1e-6 * kinetic


def test_simulate_takes_a_state_and_draws_a_clip(tmp_path):
    pytest.importorskip("matplotlib")
    imageio = pytest.importorskip("imageio.v3")
    clip = tmp_path / "arm.gif"
    arguments = ["simulate", "--scene", "four_r_free", "--seconds", "0.2", "--out", str(tmp_path)]
    state = ["--q", "1", "-0.5", "0", "0.25", "--qd", "0", "0", "-1", "0"]
    assert main([*arguments, *state, "--clip", str(clip)]) == 0
    with (tmp_path / "four_r_free.csv").open(encoding="utf-8") as file:
        first = list(csv.reader(file))[1]
    assert [float(x) for x in first[:9]] == [0.0, 1.0, -0.5, 0.0, 0.25, 0.0, 0.0, -1.0, 0.0]
    frames = imageio.imread(clip, index=None)
    assert frames.shape[0] == 6
    assert frames.shape[1:3] == (480, 480)


def test_simulate_takes_a_file(tmp_path):
    pytest.importorskip("matplotlib")
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(load_scene("four_r_free").to_dict()), encoding="utf-8")
    assert main(["simulate", "--scene", str(path), "--seconds", "0.1", "--out", str(tmp_path)]) == 0
    assert (tmp_path / "mine.csv").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["simulate", "--clip", "a.gif"], "exactly one --scene"),
        (["simulate", "--scene", "four_r_free", "four_r_free"], "same name twice"),
        (["simulate", "--scene", "four_r_free", "--seconds", "-1"], "seconds is -1.0"),
        (["study", "throughput", "--config", "nowhere.yaml"], "no such file"),
        (["study", "environments", "--lanes", "0"], "lanes is 0"),
    ],
)
def test_mistakes_exit_with_2(arguments, message, capsys):
    assert main(arguments) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("command", [["scene"], ["simulate", "--scene"]])
def test_unknown_scene_lists_the_names(command, capsys):
    assert main([*command, "nowhere"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert all(name in err for name in scene_names())


def test_scene_prints_itself(capsys):
    assert main(["scene", "rprp_limit_springs"]) == 0
    printed = yaml.safe_load(capsys.readouterr().out)
    assert load_scene(printed) == load_scene("rprp_limit_springs")


def test_scene_prints_its_listing(capsys):
    assert main(["scene", "four_r_free", "--listing"]) == 0
    text = capsys.readouterr().out
    assert text == listing(load_scene("four_r_free"))
    assert "redundant_envs/robots/four_r.py:" in text


def test_scene_prints_its_bill(capsys):
    assert main(["scene", "rprp_limit_springs", "--bill"]) == 0
    head, *rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert head == ["of", "additions", "products", "divisions", "roots", "sine_pairs", "bytes"]
    counted = bill(load_scene("rprp_limit_springs"))
    assert {owner: tuple(map(int, numbers)) for owner, *numbers in rows} == counted


def test_the_option_of_the_first_core_says_what_took_its_place(capsys):
    assert main(["scene", "four_r_free", "--source"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "use --listing or --bill" in err


def test_list_names_everything(capsys):
    assert main(["list"]) == 0
    words = capsys.readouterr().out.split()
    assert set(ids()) <= set(words)
    assert {i for i in gym.registry if i.startswith("redundant_envs/")} <= set(words)
    assert set(scene_names()) | set(METHODS) | {"throughput", "environments", "stops", "accuracy"} <= set(
        words
    )


def test_throughput_writes_csv(tmp_path, capsys):
    config = tmp_path / "tiny.yaml"
    case = {"arm": "FourR", "integrator": "rk4", "bar_ns": 45}
    data = {"lanes": 16, "repeats": 2, "bar_gflops": 53, "cases": [case]}
    config.write_text(yaml.safe_dump(data), encoding="utf-8")
    assert main(["study", "throughput", "--config", str(config), "--out", str(tmp_path)]) == 0
    assert "ns_per_step_best" in capsys.readouterr().out
    with (tmp_path / "throughput.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(r["arm"], r["integrator"], r["lanes"]) for r in rows] == [("FourR", "rk4", "16")]


def test_verify_counts_what_error_control_misses(tmp_path):
    """Nothing in a smooth scene and at hard stops, next to nothing at a kink of stiffness."""
    data = load_scene("rprp_reach").to_dict()
    springs = [
        {"type": "LimitSpring", "coordinate": r, "lower": 0.0, "upper": 0.25, "stiffness": 1e5}
        for r in ("r1", "r2")
    ]
    data["effects"] = [x for x in data["effects"] if x["type"] != "PrismaticStop"] + springs
    stiff = tmp_path / "stiff.yaml"
    stiff.write_text(yaml.safe_dump(data), encoding="utf-8")
    found = tmp_path / "found.json"
    words = ["verify", "--quick", "--states", "4000", "--json", str(found)]
    assert main([*words, "four_r_reach", "rprp_reach", str(stiff)]) == 0
    subjects = json.loads(found.read_text(encoding="utf-8"))["subjects"]
    shares = [o["found"] for x in subjects for o in x["outcomes"] if o["check"] == "tolerance kept"]
    assert shares[0] == 0.0
    assert max(shares[1:]) <= 0.001


def test_verify_measures_a_scenes_own_step(capsys, tmp_path):
    assert main(["verify", "--quick", "four_r_reach"]) == 0
    fine = capsys.readouterr().out
    assert "four_r_reach" in fine
    assert "more substeps" not in fine
    coarse = tmp_path / "coarse.yaml"
    coarse.write_text(
        "robot: {type: FourR, masses: [1, 1, 1, 1], lengths: [0.2, 0.2, 0.2, 0.2]}\n"
        "effects: [{type: Gravity}]\nintegrator: euler\ncontrol_dt: 0.1\n"
    )
    assert main(["verify", str(coarse)]) == 0
    assert "take more substeps" in capsys.readouterr().out


def test_the_drawing_of_a_scene_is_the_same_every_time(tmp_path):
    for kind in ("svg", "png"):
        pictures = [tmp_path / f"{name}.{kind}" for name in ("one", "two")]
        for path in pictures:
            assert main(["scene", "rprp_reach", "--drawing", str(path)]) == 0
        first, second = (path.read_bytes() for path in pictures)
        assert first == second


def test_a_drawing_shows_an_arm_that_it_knows(tmp_path, capsys):
    chain = tmp_path / "chain.yaml"
    chain.write_text("robot: {type: Chain, joint_types: RR, masses: [1, 1], lengths: [0.2, 0.2]}\n")
    assert main(["scene", str(chain), "--drawing", str(tmp_path / "chain.svg")]) == 2
    assert "only RPRP and FourR have a drawing" in capsys.readouterr().err
