"""The compiled core: bits that depend on the lane alone, sines, draws, the cache."""

import dataclasses
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs import algebra
from redundant_envs.algebra import sqrt, where
from redundant_envs.effects.hooks import Effect, Field
from redundant_envs.evaluators import arrays, cpu
from redundant_envs.evaluators.assemble import assemble, source
from redundant_envs.tasks.reach import ReachTask

FOUR_R = rde.FourR(masses=(2, 1.5, 1, 0.5), lengths=(0.3, 0.5, 0.4, 0.6))
RPRP = rde.RPRP(masses=(2, 1.5, 1, 0.5), lengths=(0.3, 0.5))
e = rde.effects
SCENES = {
    f"{arm.kind}-{method}": rde.Scene(
        arm,
        (
            e.Gravity(),
            e.ViscousFriction((0.1, 0.2, 0.3, 0.05)),
            e.LimitSpring(arm.joints[1], -0.4, 0.4, 800.0, 100.0),
            e.EffortLimits((5.0, 4.0, 3.0, 2.0)),
        ),
        integrator=method,
        control_dt=0.01,
        substeps=2,
    )
    for arm in (FOUR_R, RPRP)
    for method in ("euler", "rk4", "rk8")
}
every_scene = pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)


def states(n, seed=0):
    rng = np.random.default_rng(seed)
    q = rng.uniform(-0.4, 0.4, (n, 4))
    return q, rng.normal(0, 2, (n, 4)), rng.uniform(-6, 6, (n, 4))


def run(scene, q, qd, u, steps=5, **kwargs):
    batch = rde.BatchSimulator(scene, len(q), **kwargs)
    batch.set_state(q, qd)
    for _ in range(steps):
        status = batch.advance(u)
    return np.concatenate([batch.q, batch.qd], axis=1), status


@every_scene
def test_single_is_a_batch_of_one_bit_for_bit(scene):
    q, qd, u = states(37)
    whole, status = run(scene, q, qd, u)
    assert status.finite.all()
    for lane in (0, 7, 8, 15, 16, 36):
        alone, _ = run(scene, q[lane : lane + 1], qd[lane : lane + 1], u[lane : lane + 1])
        np.testing.assert_array_equal(alone[0], whole[lane])


@every_scene
def test_result_is_independent_of_the_place_in_the_batch(scene):
    q, qd, u = states(50)
    order = np.random.default_rng(1).permutation(50)
    whole, _ = run(scene, q, qd, u)
    mixed, _ = run(scene, q[order], qd[order], u[order])
    np.testing.assert_array_equal(mixed, whole[order])


@every_scene
def test_threads_change_nothing(scene):
    q, qd, u = states(100)
    one, _ = run(scene, q, qd, u)
    for threads in (2, 3, 7):
        many, status = run(scene, q, qd, u, threads=threads)
        np.testing.assert_array_equal(many, one)
        assert status.finite.all()


@every_scene
def test_a_neighbours_nan_changes_nothing(scene):
    q, qd, u = states(20)
    clean, _ = run(scene, q, qd, u)
    q[5, 2] = np.nan
    dirty, status = run(scene, q, qd, u)
    others = np.arange(20) != 5
    np.testing.assert_array_equal(dirty[others], clean[others])
    assert (status.finite == others).all()
    assert status.numerics[5] == rde.Numerics.NON_FINITE


@every_scene
def test_tracking_the_work_hardly_changes_the_motion(scene):
    q, qd, u = states(20)
    without, _ = run(scene, q, qd, u)
    with_work, _ = run(scene, q, qd, u, track_work=True)
    np.testing.assert_allclose(with_work, without, rtol=1e-10, atol=1e-12)


@every_scene
def test_save_and_restore_continue_to_the_last_bit(scene):
    q, qd, u = states(9)
    batch = rde.BatchSimulator(scene, 9)
    batch.set_state(q, qd)
    batch.advance(u)
    snapshot = batch.save()
    batch.advance(u)
    first = batch.q
    batch.restore(snapshot)
    batch.advance(u)
    np.testing.assert_array_equal(batch.q, first)


@every_scene
def test_a_lanes_own_parameters_equal_those_of_its_own_scene(scene):
    q, qd, u = states(3)
    batch = rde.BatchSimulator(scene, 3)
    batch.set_state(q, qd)
    batch.set_parameters({"masses": (1.0, 0.7, 0.6, 0.9), "gravity.g": 3.7}, index=[1])
    batch.advance(u)
    kind = type(scene.robot)
    other = rde.Scene(
        kind((1.0, 0.7, 0.6, 0.9), scene.robot.lengths),
        (e.Gravity(3.7), *scene.effects[1:]),
        scene.integrator,
        scene.control_dt,
        scene.substeps,
    )
    expected, _ = run(other, q, qd, u, steps=1)
    plain, _ = run(scene, q, qd, u, steps=1)
    np.testing.assert_array_equal(np.concatenate([batch.q, batch.qd], 1)[1], expected[1])
    np.testing.assert_array_equal(np.concatenate([batch.q, batch.qd], 1)[[0, 2]], plain[[0, 2]])


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (2.0, [[2, 2, 2, 2]] * 3),
        ((1, 2, 3, 4), [[1, 2, 3, 4]] * 3),
        (np.arange(1, 13).reshape(3, 4), np.arange(1, 13).reshape(3, 4)),
    ],
)
def test_shapes_of_parameters(value, expected):
    batch = rde.BatchSimulator(SCENES["FourR-rk4"], 3)
    batch.set_parameters({"effort_limits.limits": value, "masses": value})
    names = tuple(f"effort_limits_limits_{k}" for k in range(4))
    np.testing.assert_array_equal(batch._memory.read(names), expected)
    np.testing.assert_array_equal(batch._memory.read(("m1", "m2", "m3", "m4")), expected)
    batch.set_parameters({"gravity.g": (1.0, 2.0, 3.0)})
    np.testing.assert_array_equal(batch._memory.read(("gravity_g",))[:, 0], (1, 2, 3))


@every_scene
@pytest.mark.parametrize(("count", "threads"), [(1, 1), (7, 1), (9, 2), (17, 3)])
def test_status_of_a_partly_filled_block(scene, count, threads):
    q, qd, u = states(24)
    qd[count - 1, 2] = np.nan
    _, whole = run(scene, q, qd, u, steps=1)
    _, part = run(scene, q[:count], qd[:count], u[:count], steps=1, threads=threads)
    for name in ("finite", "numerics", "error_estimate", "evaluations"):
        assert getattr(part, name).shape == (count,)
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[:count])
    assert not part.finite[-1]
    assert part.finite[:-1].all()


def test_status_of_each_method():
    q, qd, u = states(4)
    for scene in SCENES.values():
        _, status = run(scene, q, qd, u, steps=1)
        stages = {"euler": 1, "rk4": 4, "rk8": 12}[scene.integrator]
        assert (status.evaluations == 2 * stages).all()
        assert np.isnan(status.error_estimate).all() == (scene.integrator != "rk8")
        assert (status.events == 0).all()


def test_error_estimate_follows_the_error():
    scene = rde.Scene(FOUR_R, (e.Gravity(),), control_dt=0.05)
    q, qd, u = states(200)
    one, status = run(scene, q, 2 * qd, 0 * u, steps=1)
    fine = rde.Scene(FOUR_R, (e.Gravity(),), control_dt=0.05, substeps=16)
    exact, _ = run(fine, q, 2 * qd, 0 * u, steps=1)
    error = np.linalg.norm(
        FOUR_R.forward_kinematics(one[:, :4]) - FOUR_R.forward_kinematics(exact[:, :4]), axis=1
    )
    assert (status.error_estimate > error).mean() > 0.95
    assert np.corrcoef(np.log(error + 1e-16), np.log(status.error_estimate))[0, 1] > 0.7


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda b: b.set_state(np.zeros(3), np.zeros(4)), ["q", "(3,)"]),
        (lambda b: b.set_state(np.zeros(4), np.zeros(4), index=[9]), ["index", "0..3"]),
        (lambda b: b.set_parameters({"payload.mass": 1.0}), ["payload.mass", "masses", "gravity.g"]),
        (lambda b: b.set_parameters({"masses": (1, 2, -1, 1)}), ["masses", "-1"]),
        (lambda b: b.set_parameters({"gravity.g": np.nan}), ["gravity.g", "finite"]),
        (lambda b: b.advance(np.zeros((4, 3))), ["efforts", "(4, 3)"]),
        (lambda b: b.restore(np.zeros(5)), ["snapshot", "(5,)"]),
        (
            lambda b: b.restore({**b.save(), "numbers": b.save()["numbers"].astype(np.float32)}),
            ["snapshot", "float32"],
        ),
        (lambda b: b.restore(rde.BatchSimulator(b.scene, 5).save()), ["snapshot", "num_envs 4"]),
        (lambda b: b.work, ["track_work"]),
    ],
)
def test_bad_calls_name_the_field(call, words):
    batch = rde.BatchSimulator(SCENES["FourR-rk4"], 4)
    with pytest.raises(ValueError) as error:
        call(batch)
    for word in words:
        assert word in str(error.value)


@algebra.physics(gives="ax ay")
def choosing_field(g):
    return where(g > 0.0, sqrt(g), 0.0), where(g == 0.0, 0.0, 1.0 / g)


@dataclasses.dataclass(frozen=True)
class Weightless(Effect):
    """A field of a parameter alone, one side of whose choices is no number."""

    g: float = 1.0

    def hooks(self, arm):
        return (Field(choosing_field, {"g": ".g"}),)


def test_sines_and_cosines_to_the_last_places():
    probe = rde.Scene(FOUR_R, (), integrator="euler", control_dt=1.0)
    text = assemble(probe).text
    namespace = {"CACHE": False}
    code = """

def table(x, s, c, row):
    for n in range(x.size):
        row[n % LANES] = x[n]
        pair(row, 0)
        s[n] = row[LANES + n % LANES]
        c[n] = row[2 * LANES + n % LANES]

pair = straight_line(lambda x: sincos(x), reads=(0,), writes=(1, 2))
SIGNATURES = {"table": "void(float64[::1], float64[::1], float64[::1], float64[::1])"}
"""
    exec(compile(text.split("SIGNATURES")[0] + code + cpu.KERNELS, "probe", "exec"), namespace)
    rng = np.random.default_rng(0)
    x = np.concatenate(
        [rng.uniform(-1e6, 1e6, 200_000), rng.uniform(-10, 10, 200_000), np.arange(-8, 9) * np.pi / 4]
    )
    s, c, row = np.empty_like(x), np.empty_like(x), np.zeros(3 * 8)
    namespace["table"](x, s, c, row)
    assert np.abs(s - np.sin(x)).max() <= 2.3e-16
    assert np.abs(c - np.cos(x)).max() <= 2.3e-16
    namespace["table"](np.array([np.nan, np.inf]), s[:2], c[:2], row)
    assert np.isnan(s[:2]).all()


def test_kernels_count_no_references():
    """A locked instruction for every block waits for all that was written before."""
    made = rde.load_scene(
        {**rde.load_scene("four_r_reach").to_dict(), "integrator": "euler", "tolerance": None}
    )
    kernels = cpu.compiled_in_memory(assemble(made, ReachTask()).text, "a probe")
    for name, kernel in kernels.items():
        (text,) = kernel.inspect_llvm().values()
        body = re.search(rf"define [^\n]*{name}[^\n]* {{\n.*?\n}}", text, re.DOTALL)
        assert "NRT" not in body[0]


def test_primitives_agree_in_every_evaluator_on_ties_zeros_and_nan():
    """minimum, maximum: the first of two equal numbers and of a pair with a NaN, bit for bit."""
    cases = [0.0, -0.0, 1.0, -2.5, np.inf, -np.inf, np.nan]
    pairs = np.array([(a, b) for a in cases for b in cases])
    code = """
both = straight_line(lambda a, b: (minimum(a, b), maximum(a, b)), reads=(0, 1), writes=(2, 3))


def table(rows):
    both(rows, 0)


SIGNATURES = {"table": "void(float64[::1])"}
"""
    text = assemble(rde.Scene(FOUR_R, (), integrator="euler")).text
    namespace = {"CACHE": False}
    exec(compile(text.split("SIGNATURES")[0] + code + cpu.KERNELS, "probe", "exec"), namespace)
    lanes = namespace["LANES"]
    for first in range(0, len(pairs), lanes):
        some = pairs[first : first + lanes]
        rows = np.zeros((4, lanes))
        rows[:2, : len(some)] = some.T
        namespace["table"](rows.reshape(-1))
        for row, name in ((2, "minimum"), (3, "maximum")):
            plain = np.array([getattr(algebra, name)(*pair) for pair in some])
            vector = arrays.PRIMITIVES[name](some[:, 0], some[:, 1])
            for got in (rows[row, : len(some)], vector):
                np.testing.assert_array_equal(got, plain)
                np.testing.assert_array_equal(np.signbit(got), np.signbit(plain))


@pytest.mark.parametrize(
    ("key", "counter", "words"),
    [  # Random123's known-answer vectors of philox4x32-10
        ((0, 0), (0, 0, 0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
        ((2**32 - 1,) * 2, (2**32 - 1,) * 4, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
        (
            (0xA4093822, 0x299F31D0),
            (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
            (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
        ),
    ],
)
def test_philox_known_answers(key, counter, words):
    from redundant_envs.evaluators.prelude import philox

    got = philox(*(np.uint64(k) for k in (*key, *counter)))
    assert tuple(int(w) for w in got) == words


def test_source_is_the_whole_simulator_and_holds_only_what_the_scene_names():
    bare = rde.evaluators.source(rde.Scene(FOUR_R, ()))
    assert "def four_r__forward_dynamics" in bare
    for word in ("gravity__", "viscous", "limit_spring", "rprp__", "work"):
        assert word not in bare
    assert "viscous_friction__force" in source(rde.Scene(FOUR_R, (e.ViscousFriction(0.1),)))


PROGRAM = """
import sys
sys.path.insert(0, {path!r})
import numpy as np
import redundant_envs as rde
assert rde.__file__.startswith({path!r}), rde.__file__
scene = rde.Scene(rde.FourR((1, 1, 1, 1), (1, 1, 1, 1)), (rde.effects.ViscousFriction(0.5),), "euler")
batch = rde.BatchSimulator(scene)
batch.set_state((0.1, 0.2, 0.3, 0.4), (1.0, 2.0, 3.0, 4.0))
batch.advance()
print(repr(float(batch.qd[0, 3])))
"""


def program(path, cache, **environment):
    env = {**os.environ, "REDUNDANT_ENVS_CACHE": str(cache), **environment}
    command = [sys.executable, "-c", PROGRAM.format(path=str(path))]
    done = subprocess.run(command, env=env, capture_output=True, text=True, cwd=path)
    assert done.returncode == 0, done.stderr
    return done


@pytest.fixture
def copied(tmp_path):
    package = Path(rde.__file__).parent
    target = tmp_path / "copy"
    shutil.copytree(package, target / "redundant_envs", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(package.parent / "configs", target / "configs")
    return target


def test_a_stale_kernel_is_impossible(copied, tmp_path):
    cache = tmp_path / "cache"
    first = program(copied, cache)
    assert "compiling FourR euler with ViscousFriction" in first.stderr
    again = program(copied, cache)
    assert again.stdout == first.stdout
    assert "compiling" not in again.stderr
    file = copied / "redundant_envs" / "effects" / "viscous_friction.py"
    file.write_text(
        file.read_text().replace("return -coefficient * rate", "return -2.0 * coefficient * rate")
    )
    changed = program(copied, cache)
    assert "compiling" in changed.stderr
    assert changed.stdout != first.stdout


def test_a_cache_that_cannot_be_written_warns_once_and_works(copied, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    done = program(copied, blocked / "cache")
    assert done.stderr.count("kept in memory only") == 1
    assert float(done.stdout) != 0.0


def test_eight_processes_starting_at_once(copied, tmp_path):
    cache = tmp_path / "cache"
    env = {**os.environ, "REDUNDANT_ENVS_CACHE": str(cache)}
    command = [sys.executable, "-c", PROGRAM.format(path=str(copied))]
    processes = [
        subprocess.Popen(command, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for _ in range(8)
    ]
    results = [p.communicate() for p in processes]
    assert len({out for out, _ in results}) == 1
    assert sum("compiling" in err for _, err in results) == 1
    assert all(p.returncode == 0 for p in processes)


def test_only_the_newest_modules_are_kept_and_nothing_else_is_touched(tmp_path, monkeypatch):
    monkeypatch.setattr(cpu, "KEPT_MODULES", 2)
    names = [c * 32 for c in "abcd"]
    for i, name in enumerate(names):
        (tmp_path / name).mkdir()
        (tmp_path / name / cpu.MODULE).write_text("")
        os.utime(tmp_path / name, (i, i))
    for i in range(5):
        (tmp_path / f"project_{i}").mkdir()
        os.utime(tmp_path / f"project_{i}", (0, 0))
    (tmp_path / ("e" * 32)).mkdir()  # named like a module, but not one
    cpu._prune(tmp_path)
    left = sorted(p.name for p in tmp_path.iterdir())
    assert left == sorted([*names[2:], "e" * 32, *(f"project_{i}" for i in range(5))])


def test_changing_numbers_compiles_nothing():
    one = rde.Scene(FOUR_R, (e.Gravity(9.81),), control_dt=0.01, substeps=2)
    other = rde.Scene(rde.FourR((1,) * 4, (1,) * 4), (e.Gravity(1.6),), control_dt=0.02, substeps=5)
    assert assemble(one).text == assemble(other).text
    assert assemble(one).text != assemble(rde.Scene(FOUR_R, ())).text


def test_one_rk8_step_of_a_control_interval_is_far_below_a_micrometre():
    """What the README says of calm, smooth motion: rates of 4 rad/s, 20 ms, one step."""
    arm = rde.FourR((0.5,) * 4, (0.25,) * 4)
    rng = np.random.default_rng(0)
    q, qd = rng.uniform(-np.pi, np.pi, (4096, 4)), rng.normal(0, 4, (4096, 4))
    ends = []
    for substeps in (1, 16):
        scene = rde.Scene(arm, (e.Gravity(),), "rk8", 0.02, substeps)
        ends.append(arm.forward_kinematics(run(scene, q, qd, np.zeros((4096, 4)), steps=1)[0][:, :4]))
    error = np.linalg.norm(ends[0] - ends[1], axis=1)
    assert np.quantile(error, 0.99) < 1e-7


@pytest.mark.parametrize("integrator", ["euler", "rk4", "rk8", "dop853"])
def test_an_effort_that_is_no_number_is_reported(integrator):
    batch = rde.BatchSimulator(rde.Scene(FOUR_R, (e.Gravity(),), integrator=integrator), 9)
    efforts = np.zeros((9, 4))
    efforts[5, 1] = np.nan
    status = batch.advance(efforts)
    assert np.flatnonzero(~status.finite).tolist() == [5]
    assert status.numerics[5] == rde.Numerics.NON_FINITE


def test_an_effort_that_is_no_number_is_reported_of_a_slider_at_rest_too():
    arm = rde.RPRP((1.0, 0.8, 0.6, 0.4), (0.5, 0.4))
    stops = e.PrismaticStop((0.0, 0.0), (0.3, 0.3), restitution=0.0)
    batch = rde.BatchSimulator(rde.Scene(arm, (e.Gravity(), stops), tolerance=1e-6), 1)
    batch.set_state([[-1.5, 0.3, -1.5, 0.3]], np.zeros((1, 4)))
    batch.advance()
    assert batch._memory.read(("mode_a",))[0, 0] == 1.0
    assert not batch.advance([[np.nan, 0.0, 0.0, 0.0]]).finite[0]


def test_what_is_the_same_in_every_interval_is_read_only():
    """One array serves all calls: adding to it in place must not change later ones."""
    batch = rde.BatchSimulator(rde.Scene(FOUR_R, (), integrator="rk4"), 5)
    status = batch.advance()
    for shared in (status.evaluations, status.events, status.error_estimate):
        with pytest.raises(ValueError, match="read-only"):
            shared += 1
    assert batch.advance().evaluations.tolist() == [4] * 5


def test_prepared_numbers_warn_no_more_than_compiled_ones(recwarn):
    arm = rde.FourR((1.0,) * 4, (0.5,) * 4)
    batch = rde.BatchSimulator(rde.Scene(arm, (Weightless(),), integrator="rk4"), 2)
    batch.set_parameters({"weightless.g": [0.0, -2.0]})
    assert batch.advance().finite.all()
    assert not recwarn.list
