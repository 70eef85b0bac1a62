"""The policy study: pairs, intervals, and small studies from YAML to report."""

import csv
import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from run_folders import write_scene

from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.scene import load_scene
from redundant_envs_train.__main__ import main
from redundant_envs_train.config import load
from redundant_envs_train.learners.build import make_model
from redundant_envs_train.rollout import (
    EVALUATION_SEED,
    SELECTION_SEED,
    STUDY_SEED,
    Outcome,
    expert_act,
    random_act,
)
from redundant_envs_train.statistics import bootstrap, middle_95, permutation_test, sign_test
from redundant_envs_train.studies.policy.episodes import (
    compare,
    compare_groups,
    evaluate_under,
    half_from,
    held,
)
from redundant_envs_train.studies.policy.run import describe
from redundant_envs_train.studies.policy.settings import Physics, Study, load_study

PRESET = "configs/training/rprp_reach_ppo.yaml"
SHIPPED = "configs/studies/policy.yaml"
STUDY = Study(
    physics={"exact": Physics(accuracy="exact"), "rk4": Physics(integrator="rk4")},
    arms={"A": {"preset": PRESET}},
    train_seeds=0,
)

# ---- configuration -------------------------------------------------------------------------------


def test_the_shipped_study_loads_and_survives_a_round_trip(tmp_path):
    study = load_study(SHIPPED)
    assert list(study.physics) == [
        "euler 20 ms", "euler 5 ms", "euler 1 ms", "rk4 20 ms", "rk8 20 ms", "standard", "exact",
    ]  # fmt: skip
    assert study.episodes >= 1000
    path = tmp_path / "again.yaml"
    path.write_text(yaml.safe_dump(study.to_dict()))
    assert load_study(path) == study
    for name, physics in study.physics.items():
        if name.endswith("ms"):  # a name says what it is
            integrator, step, _ = name.split()
            interval = 1000 * load_scene("rprp_reach").control_dt
            assert (physics.integrator, interval / physics.substeps) == (integrator, float(step))


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["episods=3"], ["episods", "valid:", "episodes", "train_seeds"]),
        (["physics.exact.acuracy=exact"], ["physics.exact.acuracy", "physics.exact.accuracy"]),
        (["arms.4R.run=x", "arms.4R.runs=x"], ["arms.4R.runs", "arms.4R.preset"]),
        (["physics.standard.accuracy=exakt"], ["physics.standard", "exakt", "exact"]),
        (["physics.standard.integrator=rk8"], ["physics.standard", "exactly one"]),
        (["physics.x.integrator=rk5"], ["physics.x", "rk5", "rk4"]),
        (["physics.x.integrator=rk4", "physics.x.substeps=0"], ["physics.x", "substeps", "0"]),
        (["physics.x.substeps=2"], ["physics.x", "exactly one"]),
        (["physics.EXACT.accuracy=exact"], ["physics", "EXACT", "different"]),
        (["reference=rk4"], ["reference", "rk4", "exact"]),
        (["seed=5"], ["seed", "5", str(STUDY_SEED)]),
        (["episodes=1"], ["episodes", "1", "2"]),
        (["train_seeds=1"], ["train_seeds", "1", "0"]),
        (["train_overrides=3"], ["train_overrides", "3", "list"]),
        (["arms.4R.cheap=euler"], ["arms.4R.cheap", "euler 20 ms", "train_seeds"]),
        (["arms.4R=3"], ["arms.4R", "3", "mapping"]),
        (["narrow_hold=0"], ["narrow_hold", "0"]),
    ],
)
def test_mistakes_name_the_key_and_what_is_valid(overrides, words):
    with pytest.raises(ValueError) as error:
        load_study(SHIPPED, overrides)
    for word in words:
        assert word in str(error.value)


def test_selection_goals_stay_below_those_of_the_study():
    assert EVALUATION_SEED + 1_000_000 <= SELECTION_SEED
    assert SELECTION_SEED + 1_000_000 <= STUDY_SEED
    with pytest.raises(ValueError, match="curve_episodes"):
        load(PRESET, ["curve_episodes=1000001"])


@pytest.mark.parametrize(
    "physics", [Physics(integrator="euler", substeps=4), Physics(accuracy="exact"), Physics(accuracy=1e-5)]
)
def test_only_the_stepping_of_a_scene_changes(physics):
    config = load(PRESET, ["env_kwargs.accuracy=1e-4", "env_kwargs.max_episode_steps=7"])
    env = make_sb3(config.env, 1, **physics.env_kwargs(config))
    own, scene = load_scene("rprp_reach"), env.core.scene
    back = dataclasses.replace(
        scene, integrator=own.integrator, substeps=own.substeps, tolerance=own.tolerance
    )
    assert back == own
    assert env.core.memory.read(("limit",))[0, 0] == 7
    if physics.integrator:
        assert (scene.integrator, scene.substeps, scene.tolerance) == ("euler", 4, None)
    else:
        assert scene.tolerance == {"exact": 1e-12}.get(physics.accuracy, 1e-5)


# ---- pairs and intervals -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def evaluations():
    config = load("configs/training/four_r_reach_ppo.yaml")
    return {
        name: evaluate_under(config.env, expert_act(), 9, STUDY_SEED, repeats=1, **physics.env_kwargs(config))
        for name, physics in {
            "euler": Physics(integrator="euler", substeps=1), "exact": Physics(accuracy="exact"),
        }.items()
    }  # fmt: skip


def test_episodes_are_pairs(evaluations):
    euler, exact = evaluations["euler"], evaluations["exact"]
    np.testing.assert_array_equal(euler.start, exact.start)
    np.testing.assert_array_equal(euler.goal, exact.goal)
    assert len({tuple(g) for g in exact.goal.tolist()}) == 9
    assert (euler.returns != exact.returns).all()
    assert exact.hold.all()
    result = compare(euler, exact, 200)
    assert result["return_difference"] == pytest.approx((euler.returns - exact.returns).mean())
    other = dataclasses.replace(euler, goal=euler.goal[::-1])
    with pytest.raises(ValueError, match="no pairs"):
        compare(other, exact, 200)


def test_costs_are_told(evaluations):
    euler, exact = evaluations["euler"], evaluations["exact"]
    assert (euler.evaluations == euler.steps).all()
    assert (exact.evaluations >= 12 * exact.steps).all()
    # Times are reported, not judged: tests share their machine.
    assert all(0.0 < x.ns_per_step < np.inf for x in (euler, exact))
    assert exact.flags == {}


def test_flips_are_counted_each_way(evaluations):
    exact = evaluations["exact"]
    a = np.array([1, 1, 1, 0, 0, 0, 1, 1, 0], dtype=bool)
    b = np.array([1, 0, 0, 1, 0, 0, 1, 0, 0], dtype=bool)
    here, there = (dataclasses.replace(exact, hold=x, returns=10.0 * x) for x in (a, b))
    result = compare(here, there, 1000)
    assert (result["won"], result["lost"], result["sign_test_p"]) == (3, 1, 0.625)
    assert result["hold_difference"] == pytest.approx(2 / 9)
    # the same episodes are drawn for both measures
    assert result["return_difference_low"] == pytest.approx(10 * result["hold_difference_low"])
    assert result["median_abs_return_difference"] == 0.0


def test_episodes_that_numerics_end_are_told_and_not_held():
    config = load("configs/training/four_r_reach_ppo.yaml", ["env_kwargs.task.speed_bound=20"])
    kwargs = Physics(integrator="euler", substeps=1).env_kwargs(config)
    result = evaluate_under(config.env, random_act(0), 20, STUDY_SEED, repeats=1, **kwargs)
    assert len(set(result.steps.tolist())) > 3
    assert result.ended.sum() > 5
    # the replay meets the same flags, each episode's up to its end
    assert result.flags == {"SPEED_BOUND": result.ended.sum()}
    n = np.zeros(2)
    outcome = Outcome(
        hold=np.array([True, True]), touch=n > 0, distance=n, returns=n, numerics=n.astype(int),
        ended=np.array([True, False]), steps=n.astype(int), evaluations=n.astype(int),
        time_to_hold=n, effort=n, smoothness=n,
    )  # fmt: skip
    assert held(outcome).tolist() == [False, True]


@pytest.mark.long
def test_a_tolerance_that_is_not_reached_is_counted():
    """The stiffness of a limit spring jumps at its limit: no error control reaches 1e-13 m there."""
    spring = {"type": "LimitSpring", "lower": 0.0, "upper": 0.25, "stiffness": 2000.0, "damping": 1000.0}
    scene = {
        "robot": {"type": "RPRP", "masses": [0.5] * 4, "lengths": [0.25] * 2},
        "effects": [
            {"type": "Gravity"}, {"type": "ViscousFriction", "coefficients": [0.2] * 4},
            {"type": "EffortLimits", "limits": [20.0, 32.0, 8.0, 16.0]},
            {**spring, "coordinate": "r1"}, {**spring, "coordinate": "r2"},
        ],
    }  # fmt: skip
    fine, coarse = (
        evaluate_under("RPRPReach-v0", random_act(0), 8, STUDY_SEED, 1, scene=scene, accuracy=a).flags
        for a in (1e-13, 1e-3)
    )
    assert fine["TOLERANCE_NOT_REACHED"] > 0
    assert "TOLERANCE_NOT_REACHED" not in coarse


def test_bootstrap_agrees_with_the_normal_interval():
    sample = np.random.default_rng(1).normal(3.0, 2.0, 1000)
    low, high = middle_95(bootstrap(sample, 10_000, 0))
    half = 1.96 * sample.std() / np.sqrt(1000)
    assert low == pytest.approx(sample.mean() - half, abs=0.01)
    assert high == pytest.approx(sample.mean() + half, abs=0.01)


def test_bootstrap_is_seeded_and_keeps_columns_together():
    sample = np.random.default_rng(2).normal(size=50)
    pairs = np.column_stack([sample, -2 * sample])
    means = bootstrap(pairs, 300, 7)
    assert means.shape == (300, 2)
    np.testing.assert_allclose(means[:, 1], -2 * means[:, 0], atol=1e-12)
    np.testing.assert_array_equal(means, bootstrap(pairs, 300, 7))
    assert (means != bootstrap(pairs, 300, 8)).all()
    with pytest.raises(ValueError, match="1 samples"):
        bootstrap([1.0], 10, 0)


@pytest.mark.parametrize(
    ("differences", "count"), [([0, 0], 0), ([0, -9, 1, 1], 1), ([1, -1, 1, -1], 2), ([3, 3, 3], 2)]
)
def test_how_few_make_half_of_the_difference(differences, count):
    assert half_from(np.array(differences, float)) == count


@pytest.mark.parametrize(
    ("a", "b", "p"), [(0, 0, 1.0), (5, 0, 0.0625), (0, 6, 0.03125), (1, 5, 0.21875), (4, 4, 1.0)]
)
def test_sign_test(a, b, p):
    assert sign_test(a, b) == p


def test_two_values_give_the_binomial():
    """Means of two draws from {0, 1}: 0, 1/2, 1 with 1/4, 1/2, 1/4."""
    means = bootstrap([0.0, 1.0], 40_000, 0)
    shares = [np.mean(means == m) for m in (0.0, 0.5, 1.0)]
    assert shares == pytest.approx([0.25, 0.5, 0.25], abs=0.01)


def test_groups_are_resampled_apart():
    result = compare_groups(np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 3.0]), 2000)
    assert result["difference"] == 0.0
    assert result["low"] < -0.5 < 0.5 < result["high"]
    assert result["permutation_p"] == 1.0
    apart = compare_groups(np.arange(5.0), np.arange(5.0) + 10.0, 2000)
    assert apart["permutation_p"] == 2 / 252
    assert apart["high"] < 0.0
    with pytest.raises(ValueError, match="splits"):
        permutation_test(np.zeros(30), np.ones(30))


# ---- from YAML to report -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run folder with an untrained policy."""
    folder = tmp_path_factory.mktemp("run")
    config = load(PRESET, ["ppo.net_arch=[8]", "num_envs=4", "ppo.batch_size=128"])
    (folder / "config.yaml").write_text(yaml.safe_dump(config.to_dict()))
    write_scene(folder)
    make_model(config, make_sb3(config.env, 4)).save(folder / "policy.zip")
    return folder


@pytest.mark.long
def test_stops_study_times_the_states_of_a_policy(tmp_path, run, capsys):
    out = tmp_path / "stops.csv"
    assert main(["study", "stops", str(run), "--lanes", "64", "--out", str(out)]) == 0
    table = rows(out)
    assert [r["states"] for r in table] == ["policy"] * 3 + ["random actions"] * 3
    assert all(float(r["ratio"]) > 0.0 for r in table)
    other = yaml.safe_load((run / "config.yaml").read_text())
    (tmp_path / "config.yaml").write_text(yaml.safe_dump({**other, "env": "redundant_envs/FourRReach-v0"}))
    write_scene(tmp_path)
    assert main(["study", "stops", str(tmp_path), "--out", str(out)]) == 2
    assert "the study is of redundant_envs/RPRPReach-v0" in capsys.readouterr().err


def rows(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


def small(path, **more):
    data = {
        "episodes": 20, "resamples": 200,
        "physics": {
            "euler 20 ms": {"integrator": "euler", "substeps": 1},
            "standard": {"accuracy": "standard"}, "exact": {"accuracy": "exact"},
        },
        **more,
    }  # fmt: skip
    path.write_text(yaml.safe_dump(data, sort_keys=False))
    return ["study", "policy", "--config", str(path)]


def test_a_study_explains_itself(tmp_path, run, capsys):
    out = tmp_path / "out"
    arms = {"RPRP": {"preset": PRESET, "run": str(run)}}
    command = small(tmp_path / "study.yaml", arms=arms)
    assert main([*command, "--out", str(out), "train_seeds=0"]) == 0
    report = (out / "report.md").read_text()
    assert report in capsys.readouterr().out
    for text in ("# What the physics costs a policy", "20 episodes", "euler 20 ms", "machine", "llvmlite"):
        assert text in report
    for name in ("figures/rprp.png", "figures/rprp.svg", "scenes/rprp_euler_20_ms.yaml", "study.yaml"):
        assert (out / name).stat().st_size > 100
    table = rows(out / "physics.csv")
    assert [r["physics"] for r in table] == ["euler 20 ms", "standard", "exact"]
    for r in table:
        assert r["machine"]
        assert r["date"]
        assert r["torch"]
        assert r["episodes"] == "20"
    assert float(table[2]["hold_difference"]) == float(table[2]["return_difference"]) == 0.0
    episodes = rows(out / "episodes_rprp.csv")
    assert [int(e["seed"]) for e in episodes] == list(range(STUDY_SEED, STUDY_SEED + 20))
    mean = np.mean([float(e["standard_return"]) for e in episodes])
    assert mean == pytest.approx(float(table[1]["mean_return"]), abs=1e-6)
    assert not (out / "training.csv").exists()
    assert str(tmp_path) not in report
    again = tmp_path / "again"
    assert main(["study", "policy", "--config", str(out / "study.yaml"), "--out", str(again)]) == 0
    for name in ("episodes_rprp.csv", "figures/rprp.svg"):
        assert (again / name).read_bytes() == (out / name).read_bytes()


def test_a_policy_of_another_simulator_is_called_so(run):
    assert describe(run) == "PPO, seed 0, trained under rk8 to 1e-06 m"
    facts = {"env_steps": 5, "train_seconds": 1.0, "simulator": "0123456789abcdef"}
    (run / "training.json").write_text(json.dumps(facts))
    try:
        assert "another simulator" in describe(run)
    finally:
        (run / "training.json").unlink()


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.long
def test_training_under_cheap_physics(tmp_path, run, capsys):
    out = tmp_path / "out"
    arms = {"RPRP": {"preset": PRESET, "run": str(run), "cheap": "euler 20 ms"}}
    tiny = [
        "num_envs=32", "ppo.n_steps=16", "ppo.batch_size=512", "total_steps=1024", "curve_episodes=4",
    ]  # fmt: skip
    command = [*small(tmp_path / "s.yaml", arms=arms, train_seeds=2, train_overrides=tiny), "--out", str(out)]
    assert main(command) == 0
    table = rows(out / "training.csv")
    assert [(r["trained_under"], r["train_seed"]) for r in table] == [
        ("euler 20 ms", "0"), ("preset", "0"), ("euler 20 ms", "1"), ("preset", "1"),
    ]  # fmt: skip
    assert {r["stepping"] for r in table} == {"euler 20 ms", "rk8 to 1e-06 m"}
    assert [r["measure"] for r in rows(out / "training_differences.csv")] == ["hold_success", "mean_return"]
    report = (out / "report.md").read_text()
    assert "2 policies against 2 are few" in report
    folder = out / "runs" / "rprp_euler_20_ms_seed1"
    before = (folder / "policy.zip").stat().st_mtime_ns
    capsys.readouterr()
    assert main(command) == 0  # what is trained stays
    assert (folder / "policy.zip").stat().st_mtime_ns == before
    assert main([*command, "train_overrides=[total_steps=2048]"]) == 2
    assert "another configuration" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arm", "word"),
    [
        ({"run": "nowhere"}, "config.yaml"),
        ({"run": "bare"}, "policy.zip"),
        ({"preset": "nowhere.yaml"}, "nowhere.yaml"),
    ],
)
def test_mistakes_end_with_a_message(tmp_path, arm, word, capsys):
    if arm.get("run") == "bare":  # a configuration alone
        (tmp_path / "bare").mkdir()
        (tmp_path / "bare" / "config.yaml").write_text(Path(PRESET).read_text())
        arm = {"run": str(tmp_path / "bare")}
    command = small(tmp_path / "s.yaml", arms={"A": {"preset": PRESET, **arm}}, train_seeds=0)
    assert main([*command, "--out", str(tmp_path / "out")]) == 2
    assert word in capsys.readouterr().err


def test_a_run_of_another_environment_is_refused(tmp_path, run, capsys):
    arms = {"A": {"preset": "configs/training/four_r_reach_ppo.yaml", "run": str(run)}}
    command = small(tmp_path / "s.yaml", arms=arms, train_seeds=0)
    assert main([*command, "--out", str(tmp_path / "out")]) == 2
    assert "RPRPReach" in capsys.readouterr().err
