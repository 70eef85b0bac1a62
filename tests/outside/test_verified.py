"""verify finds faults in arms, and its checks name the equation; what is right is green in all states."""

import dataclasses
import functools
import itertools
import re

import armature
import elbow
import heun
import numpy as np
import payload
import pytest
import rrp
import three_r
import track
from actuator_lag import ActuatorLag, LagChain
from arms import ARMS, STEPS, e, effects_from_outside, inertias, stops
from catalogue import assert_same_bits, motion, started
from held_command import HeldCommand
from humming_stop import HummingStop
from relative_two_r import RelativeTwoR
from tether import Tether
from three_r_by_hand import ThreeRByHand
from two_stage_spring import TwoStageSpring

import redundant_envs as rde
from redundant_envs.algebra import arguments_of, gives_of, physics, where
from redundant_envs.lane import common_step
from redundant_envs.numerics.tableaus import METHODS
from redundant_envs.robots.arm import Arm
from redundant_envs.scene import scene_names
from redundant_envs.studies.kinked_effects import KINKED
from redundant_envs.verify import (
    Mode,
    Verdict,
    accuracy,
    bits,
    conservation,
    engines,
    equations,
    evaluators,
    forces,
    hints,
    impacts,
    kinematics,
    rest,
    subject_from,
    symmetries,
    verify,
)  # fmt: skip
from redundant_envs.verify.checks import Trial, checks_of
from redundant_envs.verify.report import checks_in
from tests.fuzz.drawing import drawn_scene

EQUATIONS = checks_of(equations, kinematics)
STATES = 24
T, R = ThreeRByHand, rrp.RRP
GRAVITY = (e.Gravity(),)


# ---- arms with a wrong equation ------------------------------------------------------------------------


def changed(kind, *give, **change):
    """An arm like another, some of whose functions (by name) have their results changed."""
    own = {n: v for n, v in vars(kind).items() if n in Arm.__annotations__ and n not in kind._derived}
    functions = [f for f in own["functions"] if f.__module__ == kind.__module__]
    for name, new in change.items():
        right = next((f for f in functions if f.__name__ == name), None)
        if right is None:
            own[name] = new
            continue
        takes = right.__code__.co_varnames[: right.__code__.co_argcount]
        functions[functions.index(right)] = _wrong(right, takes, new)
    body = {**own, "functions": (*functions, *give), "kind": f"Wrong{kind.__name__}"}
    made = dataclasses.dataclass(frozen=True)(type("Wrong", (Arm,), body))
    return made((2.0, 1.5, 1.0), (0.3, 0.5, 0.4)[: kind.num_lengths])


def _wrong(right, takes, new):
    @physics(gives=" ".join(right.physics_gives), takes=" ".join(takes))
    @functools.wraps(right)
    def wrong(*values):
        return new(dict(zip(takes, values, strict=True)), *right(*values))

    return wrong


def given_by(arm, name):
    """The function of an arm that returns a quantity."""
    return next(f for f in arm.functions if name in gives_of(f))


def by_another(arm, right, new):
    """An arm like another, with one of its functions replaced."""
    wrong = _wrong(right, arguments_of(right), new)
    vars(wrong).pop("follows", None)
    if right in arm.functions:
        own = {"functions": tuple(wrong if f is right else f for f in arm.functions)}
    else:
        own = {right.__name__: staticmethod(wrong)}
    kind = dataclasses.dataclass(frozen=True)(type("Wrong", (arm,), {**own, "kind": "Wrong"}))
    return kind((2.0, 1.5, 1.0, 0.5)[: arm.num_masses], (0.3, 0.5, 0.4, 0.6)[: arm.num_lengths])


def misses(arm, checks=EQUATIONS, effects=GRAVITY, **step):
    scene = rde.Scene(arm, effects, **(step or {"tolerance": 1e-6}))
    report = verify(scene, STATES, checks=checks)
    return {o.check for o in report.outcomes if o.verdict is Verdict.MISSED}


def factor(place, by=1.0 + 1e-6):
    """One result, counted from 0, off by a millionth."""
    return lambda x, *old: (*old[:place], by * old[place], *old[place + 1 :])


def gives(names, takes, function):
    """A function of the physics dialect, from a lambda."""
    return physics(gives=names, takes=takes)(function)


M_DIAGONAL = "M11 M22 M33"
POINTS = " ".join(f"{n}{k}" for k in (1, 2, 3) for n in ("m", "x", "y", "vx", "vy"))
WRONG = {  # functions in place of the derived ones
    "U": gives("U", "m1 m2 y1 y2 y3 ay", lambda m1, m2, y1, y2, y3, ay: ay * (m1 * y1 + m2 * (y2 + y3))),
    "T": gives(
        "T", f"{M_DIAGONAL} w1 w2 w3",
        lambda *x: 0.5 * sum(m * w * w for m, w in zip(x[:3], x[3:], strict=True)),
    ),
    "qdd": gives(
        "qdd1 qdd2 qdd3", f"{M_DIAGONAL} h1 h2 h3 G1 G2 G3 Q1 Q2 Q3",
        lambda *x: tuple((x[9 + k] - x[3 + k] - x[6 + k]) / x[k] for k in range(3)),
    ),
    "C": gives(
        "C11 C12 C13 C21 C22 C23 C31 C32 C33", "h1 h2 h3 w1 w2 w3",
        lambda h1, h2, h3, w1, w2, w3: (h1 / w1, 0.0, 0.0, 0.0, h2 / w2, 0.0, 0.0, 0.0, h3 / w3),
    ),
    "Lz": gives(
        "Lz", POINTS,
        lambda *v: sum(
            by * v[k] * (v[k + 1] * v[k + 4] - v[k + 2] * v[k + 3])
            for k, by in ((0, 1.0), (5, 1.0), (10, 1.001))
        ),
    ),
    "manipulability": gives("manipulability", "J11 J12 J21 J22", lambda a, b, c, d: abs(a * d - b * c)),
    "velocity": gives(
        "vx2 vy2", "l1 l2 s1 c1 s2 c2 w1 w2",
        lambda l1, l2, s1, c1, s2, c2, w1, w2: (-l1 * s1 * w1 - l2 * s2 * w2, l1 * c1 * w1 - l2 * c2 * w2),
    ),
    "slope": gives("X21 Y21", "l1 s1 c1", lambda l1, s1, c1: (-l1 * s1, 1.001 * l1 * c1)),
    "acceleration": gives(
        "Xdqd1 Ydqd1", "l1 s1 c1 w1", lambda l1, s1, c1, w1: (-l1 * c1 * w1, -l1 * s1 * w1)
    ),
    "mobility": gives(
        "W1 W2 W3", "m1 m2 m3 l1 l2 l3",
        lambda m1, m2, m3, l1, l2, l3: (0.1 / (m1 * l1 * l1), 1.0 / (m2 * l2 * l2), 1.0 / (m3 * l3 * l3)),
    ),
    "slider": gives("W13 W23 W33", "m3", lambda m3: (0.0, 0.0, 1.0 / m3)),
    "way back": gives("theta1 theta2 theta3", "phi1 phi2 phi3", lambda a, b, c: (a, a + b, b + c)),
    "norms": gives("n1 n2 n3", "l1 l2 l3", lambda l1, l2, l3: (l1, 1e-3 * l2, l3)),
}  # fmt: skip


def gyroscopic(x, h1, h2, h3):
    """A force that does no work, and that no mass causes."""
    return h1 + 1e-3 * x["w2"], h2 - 1e-3 * x["w1"], h3


def turned(x, *C):
    """Another C with the same C qd and C + C^T, which is not that of Christoffel's symbols."""
    w1, w2, w3 = x["w1"], x["w2"], x["w3"]
    by = 0.0, -w3, w2, w3, 0.0, -w1, -w2, w1, 0.0
    return tuple(c + 0.01 * b for c, b in zip(C, by, strict=True))


def without_sideways_field(x, *qdd):
    return given_by(rde.FourR, "qdd1")(**{**x, "ax": 0.0 * x["ax"]})


def wrong_if_one_is_held(x, *results):
    both = where(x["held2"] > 0.0, where(x["held4"] > 0.0, 1.0, 1.001), 1.0)
    return both * results[0], *results[1:]


class Chain3R(Arm):
    joint_types = "RRR"


OF_M = ("mass matrix", "bias forces", "passivity", "kinetic energy", "forward dynamics", "mobility bounds")
SINES = dict.fromkeys(("s1", "s2", "s3"), "sine")
FAULTS = {
    "M of one link": (changed(T, inertia_products=factor(5)), {"mass matrix", "kinetic energy"}),
    "M of two links": (
        changed(T, mass_matrix=lambda x, *M: (M[0], 1.001 * M[1], *M[2:])), {*OF_M, "Coriolis matrix"},
    ),
    "M not positive": (
        changed(T, mass_matrix=lambda x, *M: (*M[:8], -M[8])),
        {"mass matrix", "mass matrix is positive", "kinetic energy"},
    ),
    "h": (changed(T, bias_forces=factor(1)), {"bias forces", "passivity", "Coriolis matrix"}),
    "h that does no work": (changed(T, bias_forces=gyroscopic), {"bias forces", "Coriolis matrix"}),
    "C": (changed(T, WRONG["C"]), {"Coriolis matrix"}),
    "G": (changed(T, gravity_forces=factor(2)), {"gravity forces"}),
    "U": (changed(T, WRONG["U"]), {"gravity forces"}),
    "T": (changed(T, WRONG["T"]), {"kinetic energy"}),
    "J": (
        changed(T, jacobian=factor(2)),
        {"Jacobian", "gravity forces", "rate of the Jacobian", "column norms", "manipulability"},
    ),
    "Jdqd": (changed(T, jacobian_dot_qd=factor(0)), {"rate of the Jacobian"}),
    "rates of joints": (changed(T, joint_rates=factor(2)), {"joints"}),
    "motors": (changed(T, motor_map=lambda x, *Q: (x["t1"], *Q[1:])), {"joints"}),
    "way back": (changed(T, coordinates_of_joints=WRONG["way back"]), {"joints"}),
    "accelerations": (changed(T, WRONG["qdd"]), {"forward dynamics"}),
    "C that is not Christoffel's": (
        by_another(Chain3R, given_by(Chain3R, "C11"), turned), {"Coriolis matrix"},
    ),
    "angular momentum": (changed(T, WRONG["Lz"]), {"angular momentum"}),
    "manipulability": (changed(T, WRONG["manipulability"]), {"manipulability"}),
    "velocity of a point": (changed(T, WRONG["velocity"]), {"motions of points", "angular momentum"}),
    "derivative of a point": (changed(T, WRONG["slope"]), {"motions of points", "Coriolis matrix"}),
    "acceleration of a point": (changed(T, WRONG["acceleration"]), {"motions of points"}),
    "column norms": (changed(T, column_norms=WRONG["norms"]), {"column norms"}),
    "reach": (changed(T, extent=("l1", "l2")), {"reach"}),
    "posture of sines alone": (changed(T, posture=SINES), {"posture"}),
    "posture beyond 1": (
        changed(T, posture=dict.fromkeys(("theta1", "s2", "c2", "s3", "c3"), "")), {"posture"},
    ),
    "an angle that is said to slide": (changed(R, prismatic=(True, False, True)), {"kinds of joints"}),
    "a slider that is said to turn": (
        changed(R, prismatic=(False, False, False)), {"kinds of joints", "posture", "reach"},
    ),
    "J of one side": (
        changed(R, jacobian=lambda x, *J: (*J[:5], where(x["b"] < 0.5, -J[5], J[5]))),
        {"Jacobian", "rate of the Jacobian", "manipulability"},
    ),
    "accelerations in a field": (
        by_another(rde.FourR, given_by(rde.FourR, "qdd1"), without_sideways_field), {"forward dynamics"},
    ),
    "one slider held": (
        by_another(rde.RPRP, rde.RPRP.held_dynamics, wrong_if_one_is_held), {"sliders held and struck"},
    ),
    "mobility bounds": (changed(T, mobility_bounds=WRONG["mobility"]), {"mobility bounds"}),
    "mobility of a slider": (changed(R, slider_mobility=WRONG["slider"]), {"sliders held and struck"}),
}  # fmt: skip


@pytest.mark.parametrize(("arm", "red"), FAULTS.values(), ids=FAULTS)
def test_a_wrong_equation_is_red_and_named(arm, red):
    assert misses(arm) == red


@pytest.mark.parametrize("kind", [T, R])
def test_right_equations_are_green(kind):
    assert misses(changed(kind)) == set()


def test_every_check_of_equations_is_seen_red():
    assert {c.name for c in EQUATIONS} == set().union(*(red for _, red in FAULTS.values()))


# ---- wrong motions -------------------------------------------------------------------------------------


def test_a_motor_without_its_reaction_changes_the_momentum():
    assert misses(FAULTS["motors"][0], (conservation.momentum,)) == {"momentum"}


def test_a_force_that_turns_with_the_velocities_is_not_reversible():
    arm = FAULTS["h that does no work"][0]
    assert misses(arm, (conservation.energy_book, symmetries.time_reversal)) == {"time reversal"}


def test_a_term_without_its_mass_or_length_does_not_scale():
    """An inertia that is a number, and one that is a mass: the equations that follow are consistent."""
    numbers = changed(T, inertia_products=lambda x, *K: (*K[:5], K[5] + 0.01))
    masses = changed(T, inertia_products=lambda x, *K: (*K[:5], K[5] + 0.01 * x["m3"]))
    scaling = symmetries.scaling_of_masses, symmetries.scaling_of_lengths
    assert misses(numbers, scaling) == {"scaling of masses", "scaling of lengths and time"}
    assert misses(masses, scaling) == {"scaling of lengths and time"}


def test_impulses_that_are_not_those_of_the_mass_matrix_are_red():
    stop = e.PrismaticStop((0.0,), (0.3,), 0.5)
    found = misses(FAULTS["mobility of a slider"][0], checks_of(impacts)[:3], (e.Gravity(), stop))
    assert found == {"impacts: velocities", "impacts: momentum", "impacts: energy"}


def test_mujoco_knows_masses_and_joints_of_its_own():
    pytest.importorskip("mujoco", reason="MuJoCo is in the extra 'verify'")
    checks = checks_of(engines)
    assert misses(changed(R), checks) == set()
    assert misses(FAULTS["M of two links"][0], checks) == {"MuJoCo: mass matrix and tip"}
    assert misses(FAULTS["accelerations"][0], checks) == {"MuJoCo: accelerations"}


def test_a_method_of_another_order_than_it_says_is_red(monkeypatch):
    arm = ThreeRByHand((2.0, 1.5, 1.0), (0.3, 0.5, 0.4))
    for order, red in ((3, {"order of convergence"}), (2, set())):
        said = dataclasses.replace(heun.HEUN, name=f"said_{order}", order=order)
        monkeypatch.setitem(METHODS, said.name, said)
        assert misses(arm, (accuracy.order,), integrator=said.name) == red


def test_a_tolerance_that_is_not_kept_is_red(monkeypatch):
    """The estimate of a step is a millionth of the right one."""
    arm = ThreeRByHand((2.0, 1.5, 1.0), (0.3, 0.5, 0.4))
    step = {"tolerance": 1e-9, "control_dt": 0.3}
    assert misses(arm, (accuracy.tolerance_kept,), **step) == set()
    right = common_step.step_error

    def small(dynamics, *known):
        return (1e-6 if dynamics.scene.tolerance else 1.0) * right(dynamics, *known)

    monkeypatch.setattr(common_step, "step_error", small)
    assert misses(arm, (accuracy.tolerance_kept,), **step) == {"tolerance kept"}


# ---- what is right -------------------------------------------------------------------------------------


def chain(types):
    n = len(types)
    lengths = tuple(0.2 + 0.1 * (k % 4) for k in range(types.count("R")))
    return rde.Chain(types, tuple(0.5 + 0.3 * (k % 3) for k in range(n)), lengths)


def alarms(thing, seed, checks):
    trial = Trial(subject_from("it", thing), 64, Mode.FULL, seed)
    return [(c.name, o.finding) for c in checks if (o := c.run(trial)).verdict is Verdict.MISSED]


OF_SCENES = [c for c in checks_in(Mode.FULL) if c.family != "environments" and c.name != "record of bits"]
KINDS = list(effects_from_outside(ARMS["3R"]))
QUICK = {  # each kind of effect, each arm and each method once
    ("states and links", "3R", "heun"), ("inertias", "4R", "rk4"), ("inertias", "RPRP", "rk4"),
    ("a load", "RRP", "1e-6"), ("a force at a point", "3R", "dop853"), ("a law that changes", "4R", "1e-6"),
    ("states and links", "RRP", "1e-6"), ("sensors", "3R", "rk8"),
}  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "name", "steps"),
    [
        pytest.param(*case, marks=[] if case in QUICK else [pytest.mark.long])
        for case in itertools.product(KINDS, ARMS, STEPS)
    ],
)
def test_scenes_from_outside_keep_every_promise(kind, name, steps):
    """Those of the quick ones all; the work that is tracked changes no bit of a motion."""
    arm = ARMS[name]
    effects = (e.Gravity(), e.ViscousFriction(0.1), *stops(arm, 0.0), *effects_from_outside(arm)[kind])
    scene = rde.Scene(arm, effects, **STEPS[steps])
    quick = (kind, name, steps) in QUICK
    assert alarms(scene, 0, OF_SCENES if quick else checks_of(evaluators)) == []
    assert_same_bits(motion(started(scene, track_work=True)), motion(started(scene)))


@physics(gives="x1 y1")
def of_rail(l1, r):
    return l1 + r, 0.0


@dataclasses.dataclass(frozen=True)
class Rail(rde.Arm):
    """A mass on a rail: one slider, and nothing that turns."""

    num_lengths = 1
    coordinates, rates, joints, prismatic, sincos = ("r",), ("v",), ("slide",), (True,), {}
    functions = (of_rail,)


@physics(gives="x1 y1 x2 y2")
def two_points(l1, l2, s1, c1, s2, c2):
    return l1 * c1, l1 * s1, l1 * c1 + l2 * c2, l1 * s1 + l2 * s2


@dataclasses.dataclass(frozen=True)
class Parallel(rde.Arm):
    """Motors that turn a link and leave the directions of those after it, by parallelograms."""

    num_lengths = 2
    coordinates, rates, joints, prismatic = ("theta1", "theta2"), ("w1", "w2"), ("a", "b"), (False, False)
    sincos = {"theta1": ("s1", "c1"), "theta2": ("s2", "c2")}
    functions = (two_points,)


@physics(gives="x1 y1 x2 y2 x3 y3")
def points_elsewhere(l1, l2, l3, s1, c1, s2, c2, s3, c3):
    return 2.0 * l1 * c1, 2.0 * l1 * s1, l2 * c2, l2 * s2, l3 * c3, l3 * s3


class PointsElsewhere(three_r.ThreeR):
    """An arm whose points are not those of the class that it is derived from."""

    functions = tuple(points_elsewhere if f is three_r.points else f for f in three_r.ThreeR.functions)


FULL = (
    e.Gravity(), ActuatorLag(0.05), HeldCommand(), payload.Payload(0.7), armature.Armature(0.1),
    Tether(2, 0.3, 0.2, 50.0, 1.0), e.ViscousFriction(0.1), e.PrismaticStop((0.0,), (0.3,), 0.7),
)  # fmt: skip
ALL_EFFECTS = *EQUATIONS, conservation.energy_book, conservation.momentum, impacts.velocities, bits.snapshots
ROTORS = armature.Armature((9.0, 9.0, 0.2)), armature.LinkInertia((0.1,))
SUBJECTS = {  # the checks that apply, if they are told
    "all effects": (rde.Scene(ARMS["RRP"], FULL, "rk4"), {c.name for c in ALL_EFFECTS} - {"Coriolis matrix"}),
    "its own method": (rde.Scene(ARMS["3R"], (e.Gravity(),), "heun", 0.002), ()),
    "link inertia": (armature.LinkInertia((0.1, 0.05)), ()),
    "inertias of a cart": (rde.Scene(chain("PPR"), (e.Gravity(), *ROTORS)), ("momentum", "angular momentum")),
    "inertias without weight": (rde.Scene(ARMS["4R"], inertias(ARMS["4R"]), "dop853"), ("momentum",)),
    "stops that are elastic": (
        rde.Scene(ARMS["RPRP"], (e.Gravity(), *inertias(ARMS["RPRP"]), *stops(ARMS["RPRP"], 1.0))),
        ("impacts: energy",),
    ),
    "one joint": (chain("R"), ("momentum", "scaling of masses")),
    "parallel": (Parallel((1.0, 2.0), (0.3, 0.4)), ()),
    "track": (track.TrackTask(period=4.0), ("environment: rules of vectors",)),
    "elbow": (elbow.ElbowReachTask, ("environment: rules of vectors",)),
    "ten joints": (chain("R" * 10), ("momentum", "scaling of masses")),
    "3R": (ARMS["3R"], ()),
    "RRP": (ARMS["RRP"], ()),
}
LONG = ("its own method", "link inertia", "elbow", "ten joints", "3R", "RRP")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.long] * (name in LONG)) for name in SUBJECTS]
)
def test_what_is_right_is_verified(name):
    thing, apply = SUBJECTS[name]
    found = verify(thing, 64, Mode.QUICK if name in ("track", "elbow") else Mode.STANDARD)
    assert found.misses == ()
    assert {found.of(check).verdict for check in apply} <= {Verdict.KEPT}
    if name == "parallel":  # a joint that moves masses against each other is no joint of MuJoCo
        assert "against each other" in found.of("momentum").finding.words
        assert re.search("mujoco|a moves masses against", found.of("MuJoCo: accelerations").finding.words)


def test_the_order_of_a_method_from_outside_is_seen():
    found = verify(SUBJECTS["its own method"][0], 32, checks=[accuracy.order]).outcomes[0].finding.found
    assert abs(found - heun.HEUN.order) < 0.1


@pytest.mark.parametrize("steps", [{"tolerance": 1e-6}, {"integrator": "rk8"}, {"integrator": "dop853"}])
def test_an_arm_of_sliders_alone_falls_along_them(steps):
    arm = rde.Chain("PP", masses=(1.0, 0.5))
    scene = rde.Scene(arm, (e.Gravity(9.81, (1.0, 0.0)),), control_dt=0.1, **steps)
    batch = rde.BatchSimulator(scene, 2)
    assert not batch.advance(np.zeros((2, 2))).numerics.any()
    # The first mass falls freely, and the second beside it.
    np.testing.assert_allclose(batch.q, [[0.5 * 9.81 * 0.1**2, 0.0]] * 2, rtol=0.0, atol=1e-13)


# ---- no false alarms: many arms, effects and scenes, in states of three seeds --------------------------

SEEDS = (0, 1, 2)
OF_STATES = checks_of(equations, kinematics, forces, hints, rest)


def scenes_of(arm):
    """An arm with everything that a check of effects examines."""
    last = len(arm.joints) - 1
    yield rde.Scene(
        arm, (e.Gravity(3.0, (0.6, -0.8)), armature.Armature(0.1), Tether(1, 0.1, 0.2, 500.0, 7.0))
    )
    springs = TwoStageSpring(last, -0.3, 0.4, 5.0, 100.0), e.LimitSpring(arm.joints[0], -0.2, 0.3, 50.0, 2e4)
    yield rde.Scene(arm, (e.Gravity(), *springs, ActuatorLag(0.1)))
    yield rde.Scene(arm, (e.Gravity(), HummingStop(last, -0.3, 0.4, 500.0, 30.0), LagChain(0.01, 6)))
    for kinked in KINKED:
        yield rde.Scene(arm, (e.Gravity(), kinked.effect, e.ViscousFriction(0.2)))


RIGHT = {
    **{name: rde.load_scene(name) for name in scene_names()},
    **ARMS,
    **{types: chain(types) for types in ("R", "P", "PR", "PP", "PRP", "RPR", "RRPP", "R" * 10)},
    "3R by hand": ThreeRByHand((2.0, 1.5, 1.0), (0.3, 0.5, 0.4)),
    "3R of other points": PointsElsewhere((1.0,) * 3, (1.0,) * 3),
    "rail": Rail((1.3,), (0.4,)),
    "relative": RelativeTwoR,
    "a micrometre": rde.RPRP((1e-6,) * 4, (1e-6, 1e-6)),
    **{f"{name} {k}": s for name, arm in ARMS.items() for k, s in enumerate(scenes_of(arm))},
    **{f"cart {k}": s for k, s in enumerate(scenes_of(chain("PRR")))},
}


@pytest.mark.parametrize("thing", RIGHT.values(), ids=RIGHT)
def test_what_is_right_is_green_whatever_the_states(thing):
    assert [alarms(thing, seed, OF_STATES) for seed in SEEDS] == [[], [], []]


@pytest.mark.parametrize("seed", SEEDS)
def test_drawn_scenes_are_green(seed):
    rng = np.random.default_rng(seed)
    for _ in range(12):
        scene = drawn_scene(rng, calm=True)
        assert alarms(scene, seed, OF_STATES) == [], scene
