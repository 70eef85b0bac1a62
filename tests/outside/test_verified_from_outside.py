"""verify takes arms of 1 to 10 joints, effects and tasks from outside, and finds them right."""

import dataclasses
import itertools

import actuator_lag
import armature
import elbow
import held_command
import heun
import payload
import pytest
import sensors
import tether
import track
from arms import ARMS

import redundant_envs as rde
from redundant_envs.algebra import numbered, physics
from redundant_envs.verify import (
    Mode,
    Verdict,
    accuracy,
    bits,
    conservation,
    engines,
    equations,
    impacts,
    kinematics,
    verify,
)
from redundant_envs.verify.checks import checks_of

e = rde.effects


def chain(n):
    """An arm of n revolute joints, in absolute angles; functions of any number of arguments."""
    m, l, s, c, w, theta = (numbered(form, n) for form in ("m{}", "l{}", "s{}", "c{}", "w{}", "theta{}"))
    phi, t = numbered("phi{}", n), numbered("t{}", n)

    def function(gives, takes):
        return physics(gives=" ".join(gives), takes=" ".join(takes))

    def parts(values):
        return [values[k * n : (k + 1) * n] for k in range(len(values) // n)]

    def difference(*x):
        return tuple(b - a for a, b in itertools.pairwise((0.0, *x)))

    @function([f"{axis}{k + 1}" for k in range(n) for axis in "xy"], (*l, *s, *c))
    def points(*values):
        lengths, sines, cosines = parts(values)
        x = itertools.accumulate(a * b for a, b in zip(lengths, cosines, strict=True))
        y = itertools.accumulate(a * b for a, b in zip(lengths, sines, strict=True))
        return tuple(itertools.chain.from_iterable(zip(x, y, strict=True)))

    @function([f"J{i}{k + 1}" for i in (1, 2) for k in range(n)], (*l, *s, *c))
    def jacobian(*values):
        lengths, sines, cosines = parts(values)
        return (
            *(-a * b for a, b in zip(lengths, sines, strict=True)),
            *(a * b for a, b in zip(lengths, cosines, strict=True)),
        )

    @function(("Jdqd1", "Jdqd2"), (*l, *s, *c, *w))
    def jacobian_dot_qd(*values):
        lengths, sines, cosines, rates = parts(values)
        squares = [a * x * x for a, x in zip(lengths, rates, strict=True)]
        return tuple(-sum(a * b for a, b in zip(squares, x, strict=True)) for x in (cosines, sines))

    @function([f"M{i + 1}{j + 1}" for i in range(n) for j in range(n)], (*m, *l, *s, *c))
    def mass_matrix(*values):
        masses, lengths, sines, cosines = parts(values)
        return tuple(
            sum(masses[max(i, j) :]) * lengths[i] * lengths[j]
            * (cosines[i] * cosines[j] + sines[i] * sines[j])
            for i in range(n) for j in range(n)
        )  # fmt: skip

    @function(numbered("h{}", n), (*m, *l, *s, *c, *w))
    def bias_forces(*values):
        masses, lengths, sines, cosines, rates = parts(values)
        return tuple(
            sum(
                sum(masses[max(i, j) :]) * lengths[i] * lengths[j] * rates[j] * rates[j]
                * (sines[i] * cosines[j] - cosines[i] * sines[j])
                for j in range(n)
            )
            for i in range(n)
        )  # fmt: skip

    @function(numbered("G{}", n), (*m, *l, *s, *c, "ax", "ay"))
    def gravity_forces(*values):
        (masses, lengths, sines, cosines), (ax, ay) = parts(values[:-2]), values[-2:]
        return tuple(sum(masses[i:]) * lengths[i] * (ay * cosines[i] - ax * sines[i]) for i in range(n))

    @function(numbered("Q{}", n), t)
    def motor_map(*efforts):
        return tuple(a - b for a, b in itertools.pairwise((*efforts, 0.0)))

    @function(theta, phi)
    def coordinates_of_joints(*positions):
        return tuple(itertools.accumulate(positions)) if n > 1 else positions[0]

    body = {
        "num_lengths": n, "coordinates": tuple(theta), "rates": tuple(w),
        "joints": tuple(numbered("joint{}", n)), "prismatic": (False,) * n,
        "sincos": {a: (b, d) for a, b, d in zip(theta, s, c, strict=True)},
        "functions": (
            function(phi, theta)(difference), function(numbered("phid{}", n), w)(lambda *x: difference(*x)),
            points, jacobian, jacobian_dot_qd, mass_matrix, bias_forces, gravity_forces, motor_map,
        ),
        "coordinates_of_joints": coordinates_of_joints, "kind": f"Chain{n}",
    }  # fmt: skip
    kind = dataclasses.dataclass(frozen=True)(type(f"Chain{n}", (rde.Arm,), body))
    return kind(tuple(0.5 + 0.3 * (k % 3) for k in range(n)), tuple(0.2 + 0.1 * (k % 4) for k in range(n)))


STOP = e.PrismaticStop((0.0,), (0.3,), 0.7)
FULL = (
    e.Gravity(), actuator_lag.ActuatorLag(0.05), held_command.HeldCommand(), payload.Payload(0.7),
    armature.Armature(0.1), tether.Tether(2, 0.3, 0.2, 50.0, 1.0), e.ViscousFriction(0.1), STOP,
)  # fmt: skip
SUBJECTS = {
    "all effects": rde.Scene(ARMS["RRP"], FULL, "rk4"),
    "its own method": rde.Scene(ARMS["3R"], (e.Gravity(),), "heun", 0.002),
    "sensors": sensors.SensorBias(0.01, 0.02),
    "link inertia": armature.LinkInertia((0.1, 0.05)),
}
TASKS = {"track": track.TrackTask(period=4.0), "elbow": elbow.ElbowReachTask}


def good(thing, states, mode):
    report = verify(thing, states, mode)
    assert report.misses == ()
    return {o.check: o for o in report.outcomes}


def test_right_equations_of_chains_are_green():
    for n in (1, 2, 10):
        found = verify(chain(n), 16, checks=checks_of(equations, kinematics))
        assert found.misses == ()


@pytest.mark.parametrize("joints", [1, pytest.param(10, marks=pytest.mark.long)])
def test_a_chain_is_verified(joints):
    found = good(chain(joints), 64, Mode.STANDARD)
    assert found["momentum"].verdict is Verdict.KEPT
    assert found["scaling of masses"].verdict is Verdict.KEPT


@pytest.mark.parametrize(
    "name", [pytest.param("all effects", marks=pytest.mark.long), "its own method", "sensors"]
)
def test_scenes_and_effects_are_verified_in_a_short_time(name):
    good(SUBJECTS[name], 64, Mode.QUICK)


def test_energy_momentum_impacts_and_states_of_all_effects_together():
    checks = [
        *checks_of(equations, kinematics), conservation.energy_book, conservation.momentum,
        impacts.velocities, bits.snapshots,
    ]  # fmt: skip
    found = verify(SUBJECTS["all effects"], 64, checks=checks)
    assert {o.verdict for o in found.outcomes if o.check != "Coriolis matrix"} == {Verdict.KEPT}


@pytest.mark.long
@pytest.mark.parametrize("thing", [*SUBJECTS.values(), ARMS["3R"], ARMS["RRP"]])
def test_arms_scenes_and_effects_are_verified(thing):
    good(thing, 256, Mode.STANDARD)


@pytest.mark.parametrize(
    "thing", [TASKS["track"], pytest.param(TASKS["elbow"], marks=pytest.mark.long)], ids=TASKS
)
def test_tasks_are_verified_in_their_environments(thing):
    found = good(thing, 32, Mode.QUICK)
    assert found["environment: rules of vectors"].verdict is Verdict.KEPT


def test_the_order_of_a_method_from_outside_is_seen():
    scene = SUBJECTS["its own method"]
    assert scene.integrator == heun.HEUN.name
    found = verify(scene, 32, checks=[accuracy.order]).outcomes[0].finding.found
    assert abs(found - heun.HEUN.order) < 0.1


def test_a_joint_that_moves_masses_against_each_other_is_no_joint_of_mujoco():
    """A motor that turns a link and leaves the directions of those after it, by a parallelogram."""
    right = type(chain(2))
    functions = [
        f for f in right.functions
        if not {"phi1", "phid1", "Q1", "qdd1", "T", "U", "tip_x", "tip_vx"} & {*f.physics_gives}
        and f.physics_gives != ("manipulability",)
    ]  # fmt: skip
    body = {
        n: getattr(right, n) for n in ("num_lengths", "coordinates", "rates", "joints", "prismatic", "sincos")
    }
    kind = type("Parallel", (rde.Arm,), {**body, "functions": tuple(functions), "kind": "Parallel"})
    arm = dataclasses.dataclass(frozen=True)(kind)((1.0, 2.0), (0.3, 0.4))
    report = verify(
        arm, 16, checks=[*checks_of(equations, kinematics), conservation.momentum, *checks_of(engines)]
    )
    assert report.misses == ()
    told = {o.check: o.finding.words for o in report.outcomes if o.verdict is Verdict.NOT_APPLICABLE}
    assert "against each other" in told["momentum"]
    if "mujoco" not in told["MuJoCo: accelerations"]:
        assert "joint1 moves masses against each other" in told["MuJoCo: accelerations"]


@physics(gives="x1 y1")
def on_rail(l1, r):
    return l1 + r, 0.0


@physics(gives="J11 J21 Jdqd1 Jdqd2 h1")
def along_rail():
    return 1.0, 0.0, 0.0, 0.0, 0.0


@physics(gives="M11 G1")
def on_slider(m1, ax):
    return m1, m1 * ax


@dataclasses.dataclass(frozen=True)
class Rail(rde.Arm):
    """A mass on a rail: one slider, and nothing that turns."""

    num_lengths = 1
    coordinates, rates, joints, prismatic, sincos = ("r",), ("v",), ("slide",), (True,), {}
    functions = (on_rail, along_rail, on_slider)


def test_equations_of_an_arm_that_only_slides_are_green():
    assert verify(Rail((1.3,), (0.4,)), 16, checks=checks_of(equations, kinematics)).misses == ()


def test_an_arm_that_only_slides_moves_with_error_control():
    scene = rde.Scene(Rail((1.3,), (0.4,)), (), tolerance=1e-6)
    batch = rde.BatchSimulator(scene)
    batch.set_state([0.1], [1.0])
    batch.advance()
    assert abs(batch.q[0, 0] - 0.12) < 1e-12
