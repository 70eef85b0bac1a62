"""verify finds faults in an arm, and its check names the equation."""

import dataclasses
import functools

import numpy as np
import pytest
import rrp
from three_r_by_hand import ThreeRByHand

import redundant_envs as rde
from redundant_envs.algebra import arguments_of, gives_of, physics, where
from redundant_envs.lane import common_step
from redundant_envs.robots.arm import Arm
from redundant_envs.verify import (
    accuracy,
    conservation,
    engines,
    equations,
    impacts,
    kinematics,
    symmetries,
    verify,
)
from redundant_envs.verify.checks import checks_of

e = rde.effects
EQUATIONS = checks_of(equations, kinematics)
STATES = 24


def changed(kind, give=(), **change):
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


GRAVITY = (e.Gravity(),)


def misses(arm, checks=EQUATIONS, effects=GRAVITY, **step):
    scene = rde.Scene(arm, effects, **(step or {"tolerance": 1e-6}))
    report = verify(scene, STATES, checks=checks)
    return {o.check for o in report.outcomes if o.verdict.value == "MISSED"}


def factor(place, by=1.0 + 1e-6):
    """One result, counted from 0, off by a millionth."""
    return lambda x, *old: (*old[:place], by * old[place], *old[place + 1 :])


@physics(gives="U")
def wrong_potential(m1, m2, m3, y1, y2, y3, ay):
    return ay * (m1 * y1 + m2 * y2 + m2 * y3)


@physics(gives="T", takes="M11 M22 M33 w1 w2 w3")
def wrong_energy(M11, M22, M33, w1, w2, w3):
    return 0.5 * (M11 * w1 * w1 + M22 * w2 * w2 + M33 * w3 * w3)


@physics(gives="qdd1 qdd2 qdd3", takes="M11 M22 M33 h1 h2 h3 G1 G2 G3 Q1 Q2 Q3")
def wrong_dynamics(M11, M22, M33, h1, h2, h3, G1, G2, G3, Q1, Q2, Q3):
    return (Q1 - h1 - G1) / M11, (Q2 - h2 - G2) / M22, (Q3 - h3 - G3) / M33


@physics(gives="C11 C12 C13 C21 C22 C23 C31 C32 C33", takes="h1 h2 h3 w1 w2 w3")
def wrong_coriolis(h1, h2, h3, w1, w2, w3):
    return h1 / w1, 0.0, 0.0, 0.0, h2 / w2, 0.0, 0.0, 0.0, h3 / w3


@physics(gives="W1 W2 W3")
def too_small(m1, m2, m3, l1, l2, l3):
    return 0.1 / (m1 * l1 * l1), 1.0 / (m2 * l2 * l2), 1.0 / (m3 * l3 * l3)


@physics(gives="W13 W23 W33")
def wrong_mobility(m3):
    return 0.0, 0.0, 1.0 / m3


@physics(gives="theta1 theta2 theta3")
def wrong_way_back(phi1, phi2, phi3):
    return phi1, phi1 + phi2, phi2 + phi3


def gyroscopic(x, h1, h2, h3):
    """A force that does no work, and that no mass causes."""
    return h1 + 1e-3 * x["w2"], h2 - 1e-3 * x["w1"], h3


@physics(gives="Lz")
def wrong_angular_momentum(m1, m2, m3, x1, y1, vx1, vy1, x2, y2, vx2, vy2, x3, y3, vx3, vy3):
    return m1 * (x1 * vy1 - y1 * vx1) + m2 * (x2 * vy2 - y2 * vx2) + 1.001 * m3 * (x3 * vy3 - y3 * vx3)


@physics(gives="manipulability")
def wrong_manipulability(J11, J12, J21, J22):
    return abs(J11 * J22 - J12 * J21)


@physics(gives="vx2 vy2")
def wrong_velocity(l1, l2, s1, c1, s2, c2, w1, w2):
    return -l1 * s1 * w1 - l2 * s2 * w2, l1 * c1 * w1 - l2 * c2 * w2


@physics(gives="X21 Y21")
def wrong_slope(l1, s1, c1):
    return -l1 * s1, 1.001 * l1 * c1


@physics(gives="Xdqd1 Ydqd1")
def wrong_acceleration(l1, s1, c1, w1):
    return -l1 * c1 * w1, -l1 * s1 * w1


@physics(gives="n1 n2 n3")
def wrong_norms(l1, l2, l3):
    return l1, 1e-3 * l2, l3


def turned(x, *C):
    """Another C with the same C qd and C + C^T, which is not that of Christoffel's symbols."""
    w1, w2, w3 = x["w1"], x["w2"], x["w3"]
    by = 0.0, -w3, w2, w3, 0.0, -w1, -w2, w1, 0.0
    return tuple(c + 0.01 * b for c, b in zip(C, by, strict=True))


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


def without_sideways_field(x, *qdd):
    return given_by(rde.FourR, "qdd1")(**{**x, "ax": 0.0 * x["ax"]})


def wrong_if_one_is_held(x, *results):
    both = where(x["held2"] > 0.0, where(x["held4"] > 0.0, 1.0, 1.001), 1.0)
    return both * results[0], *results[1:]


T, R = ThreeRByHand, rrp.RRP


class Chain3R(Arm):
    joint_types = "RRR"


FAULTS = {
    "M of one link": (changed(T, inertia_products=factor(5)), {"mass matrix", "kinetic energy"}),
    "M of two links": (
        changed(T, mass_matrix=lambda x, *M: (M[0], 1.001 * M[1], *M[2:])),
        {
            "mass matrix",
            "bias forces",
            "passivity",
            "kinetic energy",
            "forward dynamics",
            "mobility bounds",
            "Coriolis matrix",
        },
    ),
    "M not positive": (
        changed(T, mass_matrix=lambda x, *M: (*M[:8], -M[8])),
        {"mass matrix", "mass matrix is positive", "kinetic energy"},
    ),
    "h": (changed(T, bias_forces=factor(1)), {"bias forces", "passivity", "Coriolis matrix"}),
    "h that does no work": (changed(T, bias_forces=gyroscopic), {"bias forces", "Coriolis matrix"}),
    "C": (changed(T, give=(wrong_coriolis,)), {"Coriolis matrix"}),
    "G": (changed(T, gravity_forces=factor(2)), {"gravity forces"}),
    "U": (changed(T, give=(wrong_potential,)), {"gravity forces"}),
    "T": (changed(T, give=(wrong_energy,)), {"kinetic energy"}),
    "J": (
        changed(T, jacobian=factor(2)),
        {"Jacobian", "gravity forces", "rate of the Jacobian", "column norms", "manipulability"},
    ),
    "Jdqd": (changed(T, jacobian_dot_qd=factor(0)), {"rate of the Jacobian"}),
    "rates of joints": (changed(T, joint_rates=factor(2)), {"joints"}),
    "motors": (changed(T, motor_map=lambda x, *Q: (x["t1"], *Q[1:])), {"joints"}),
    "way back": (changed(T, coordinates_of_joints=wrong_way_back), {"joints"}),
    "accelerations": (changed(T, give=(wrong_dynamics,)), {"forward dynamics"}),
    "C that is not Christoffel's": (
        by_another(Chain3R, given_by(Chain3R, "C11"), turned),
        {"Coriolis matrix"},
    ),
    "angular momentum": (changed(T, give=(wrong_angular_momentum,)), {"angular momentum"}),
    "manipulability": (changed(T, give=(wrong_manipulability,)), {"manipulability"}),
    "velocity of a point": (changed(T, give=(wrong_velocity,)), {"motions of points", "angular momentum"}),
    "derivative of a point": (changed(T, give=(wrong_slope,)), {"motions of points", "Coriolis matrix"}),
    "acceleration of a point": (changed(T, give=(wrong_acceleration,)), {"motions of points"}),
    "column norms": (changed(T, column_norms=wrong_norms), {"column norms"}),
    "reach": (changed(T, extent=("l1", "l2")), {"reach"}),
    "posture of sines alone": (changed(T, posture=dict.fromkeys(("s1", "s2", "s3"), "sine")), {"posture"}),
    "posture beyond 1": (
        changed(T, posture={"theta1": "", "s2": "", "c2": "", "s3": "", "c3": ""}),
        {"posture"},
    ),
    "an angle that is said to slide": (changed(R, prismatic=(True, False, True)), {"kinds of joints"}),
    "a slider that is said to turn": (
        changed(R, prismatic=(False, False, False)),
        {"kinds of joints", "posture", "reach"},
    ),
    "J of one side": (
        changed(R, jacobian=lambda x, *J: (*J[:5], where(x["b"] < 0.5, -J[5], J[5]))),
        {"Jacobian", "rate of the Jacobian", "manipulability"},
    ),
    "accelerations in a field": (
        by_another(rde.FourR, given_by(rde.FourR, "qdd1"), without_sideways_field),
        {"forward dynamics"},
    ),
    "one slider held": (
        by_another(rde.RPRP, rde.RPRP.held_dynamics, wrong_if_one_is_held),
        {"sliders held and struck"},
    ),
    "mobility bounds": (changed(T, mobility_bounds=too_small), {"mobility bounds"}),
    "mobility of a slider": (changed(R, slider_mobility=wrong_mobility), {"sliders held and struck"}),
}


@pytest.mark.parametrize(("arm", "red"), FAULTS.values(), ids=FAULTS)
def test_a_wrong_equation_is_red_and_named(arm, red):
    assert misses(arm) == red


@pytest.mark.parametrize("kind", [T, R])
def test_right_equations_are_green(kind):
    assert misses(changed(kind)) == set()


def test_every_check_of_equations_is_seen_red():
    assert {c.name for c in EQUATIONS} == set().union(*(red for _, red in FAULTS.values()))


# ---- motions -------------------------------------------------------------------------------------------


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
    from redundant_envs.numerics.tableaus import METHODS

    heun = rde.Tableau("said_three", 3, ((), (1.0,)), (0.5, 0.5), (0.0, 1.0))
    monkeypatch.setitem(METHODS, heun.name, heun)
    right = dataclasses.replace(heun, name="said_two", order=2)
    monkeypatch.setitem(METHODS, right.name, right)
    arm = ThreeRByHand((2.0, 1.5, 1.0), (0.3, 0.5, 0.4))
    assert misses(arm, (accuracy.order,), integrator="said_three") == {"order of convergence"}
    assert misses(arm, (accuracy.order,), integrator="said_two") == set()


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


@pytest.mark.parametrize("steps", [{"tolerance": 1e-6}, {"integrator": "rk8"}, {"integrator": "dop853"}])
def test_an_arm_of_sliders_alone_falls_along_them(steps):
    arm = rde.Chain("PP", masses=(1.0, 0.5))
    sideways = rde.effects.Gravity(9.81, (1.0, 0.0))
    batch = rde.BatchSimulator(rde.Scene(arm, (sideways,), control_dt=0.1, **steps), 2)
    status = batch.advance(np.zeros((2, 2)))
    assert not status.numerics.any()
    # The first mass falls freely, and the second beside it.
    np.testing.assert_allclose(batch.q, [[0.5 * 9.81 * 0.1**2, 0.0]] * 2, rtol=0.0, atol=1e-13)
