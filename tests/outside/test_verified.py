"""verify finds faults in arms, and its checks name the equation; what is right is green in all states."""

import dataclasses
import functools

import heun
import numpy as np
import pytest
import rrp
import three_r
from arms import ARMS, STEPS, e
from fuzz.drawing import drawn_scene
from relative_two_r import RelativeTwoR

import redundant_envs as rde
from redundant_envs.algebra import arguments_of, gives_of, physics, where
from redundant_envs.scenes.tableaus import METHODS
from redundant_envs.simulator.lane import common_step
from redundant_envs.verify import Mode, Verdict, subject_from
from redundant_envs.verify.checks import Sample
from redundant_envs.verify.report import checks_in


def checks(*wanted):
    """Checks of some families or names."""
    return tuple(c for c in checks_in(Mode.FULL) if {c.family, c.name} & {*wanted})


EQUATIONS = checks("equations", "kinematics")
F, S, T, R = rde.FourR, rde.RPRP, three_r.ThreeR, rrp.RRP
GRAVITY = (e.Gravity(),)


def misses(thing, checks=EQUATIONS, effects=GRAVITY, states=24, seed=0, **step):
    """The checks that an arm or a scene does not pass."""
    if isinstance(thing, rde.Arm):
        thing = rde.Scene(thing, effects, **(step or {"tolerance": 1e-6}))
    trial = Sample(subject_from("it", thing), states, seed)
    return {c.name for c in checks if c.run(trial).verdict is Verdict.MISSED}


# ---- arms with a wrong equation ------------------------------------------------------------------------


def wrong(kind, name, new=None):
    """An arm like another with a wrong function, which gives a quantity or has this name in the class.

    ``new`` makes wrong values of its arguments and right ones; without it one is off by a millionth.
    """
    right = next((f for f in kind.functions if name in gives_of(f)), None) or getattr(kind, name)
    takes, gives = arguments_of(right), gives_of(right)
    one = "" if len(gives) > 1 else gives[0]

    @physics(gives=" ".join(gives), takes=" ".join(takes))
    @functools.wraps(right)
    def function(*values):
        old = (right(*values),) if one else right(*values)
        if new is None:
            found = [value * (1.0 + 1e-6 * (give == name)) for give, value in zip(gives, old, strict=True)]
        else:
            found = new(dict(zip(takes, values, strict=True)), *old)
        return found[0] if one else tuple(found)

    vars(function).pop("follows", None)
    if right in kind.functions:
        return saying(kind, functions=tuple(function if f is right else f for f in kind.functions))
    return saying(kind, **{name: staticmethod(function)})


def saying(kind, **own):
    """An arm like another whose class says something else of itself."""
    body = {"functions": kind.functions, **own, "kind": "Wrong"}
    made = dataclasses.dataclass(frozen=True)(type("Wrong", (kind,), body))
    return made((2.0, 1.5, 1.0, 0.5)[: kind.num_masses], (0.3, 0.5, 0.4, 0.6)[: kind.num_lengths])


def gyroscopic(x, h1, h2, h3):
    """A force that does no work, and that no mass causes."""
    return h1 + 1e-3 * (x["w2"] - x["w1"]), h2 - 1e-3 * x["w1"], h3


def turned(x, *C):
    """Another C with the same C qd and C + C^T, which is not that of Christoffel's symbols."""
    w1, w2, w3 = x["w1"], x["w2"], x["w3"]
    by = 0.0, -w3, w2, w3, 0.0, -w1, -w2, w1, 0.0
    return tuple(c + 0.01 * b for c, b in zip(C, by, strict=True))


def without_sideways_field(x, *qdd):
    right = next(f for f in F.functions if "qdd1" in gives_of(f))
    return right(**{**x, "ax": 0.0 * x["ax"]})


def wrong_if_one_is_held(x, *results):
    both = where(x["held2"] > 0.0, where(x["held4"] > 0.0, 1.0, 1.001), 1.0)
    return both * results[0], *results[1:]


HELD = "sliders held and struck"
FAULTS = {
    "M of one link": (wrong(F, "K44"), {"mass matrix", "angular momentum", "forward dynamics"}),
    "M of two links": (
        wrong(F, "M12", lambda x, *M: (M[0], 1.001 * M[1], *M[2:])),
        {"mass matrix", "bias forces", "forward dynamics", "mobility bounds", "Coriolis matrix"},
    ),
    "M not positive": (
        wrong(F, "M44", lambda x, *M: (*M[:-1], -M[-1])),
        {"mass matrix", "mass matrix is positive", "forward dynamics"},
    ),
    "h that does no work": (wrong(R, "h1", gyroscopic), {"bias forces", "Coriolis matrix"}),
    "C that is not Christoffel's": (wrong(T, "C11", turned), {"Coriolis matrix"}),
    "G": (wrong(R, "G3"), {"gravity forces"}),
    "T": (wrong(F, "T"), {"kinetic energy"}),
    "J": (wrong(F, "J13"), {"Jacobian", "rate of the Jacobian"}),
    "motors": (wrong(F, "Q1", lambda x, *Q: (x["t1"], *Q[1:])), {"joints"}),
    "accelerations": (wrong(F, "qdd2"), {"forward dynamics"}),
    "accelerations in a field": (wrong(F, "qdd1", without_sideways_field), {"forward dynamics"}),
    "manipulability": (wrong(F, "manipulability"), {"manipulability"}),
    "velocity of a point": (wrong(F, "vy2"), {"motions of points"}),
    "column norms": (
        wrong(F, "column_norms", lambda x, *n: (n[0], 1e-3 * n[1], *n[2:])), {"column norms"},
    ),
    "reach": (saying(F, extent=("l1", "l2")), {"reach"}),
    "posture": (saying(T, posture=dict.fromkeys(("theta1", "s2", "c2", "s3", "c3"), "")), {"posture"}),
    "an angle that is said to slide": (saying(R, prismatic=(True, False, True)), {"kinds of joints"}),
    "one slider held": (wrong(S, "held_dynamics", wrong_if_one_is_held), {HELD}),
    "mobility bounds": (
        wrong(F, "mobility_bounds", lambda x, *W: (0.1 * W[0], *W[1:])), {"mobility bounds"},
    ),
    "an inertia that is a number": (
        wrong(R, "I", lambda x, b, sigma, I: (b, sigma, I + 0.01)), {"mass matrix", "kinetic energy"},
    ),
    "mobility of a slider": (wrong(R, "slider_mobility", lambda x, *W: (*W[:2], 1.1 * W[2])), {HELD}),
}  # fmt: skip


@pytest.mark.quick("M of one link")
@pytest.mark.parametrize(("arm", "red"), FAULTS.values(), ids=FAULTS)
def test_a_wrong_equation_is_red_and_named(arm, red):
    assert misses(arm) == red


def test_every_check_of_equations_is_seen_red():
    assert {c.name for c in EQUATIONS} == set().union(*(red for _, red in FAULTS.values()))


# ---- wrong motions -------------------------------------------------------------------------------------

MOTIONS = {
    "a motor without its reaction": ("motors", checks("momentum"), {"momentum"}),
    "a force that turns with the velocities": (
        "h that does no work", checks("energy balance", "time reversal"), {"time reversal"},
    ),
    "no scaling": (
        "an inertia that is a number", checks("scaling of masses", "scaling of lengths and time"),
        {"scaling of masses", "scaling of lengths and time"},
    ),
    "impulses of another mobility": ("mobility of a slider", checks("impacts"), {"impacts: velocities"}),
}  # fmt: skip
"""Arms of :data:`FAULTS`, and the checks of motions that see them."""


@pytest.mark.quick("a motor without its reaction")
@pytest.mark.parametrize(("fault", "checks", "red"), MOTIONS.values(), ids=MOTIONS)
def test_a_wrong_motion_is_red_and_named(fault, checks, red):
    stop = e.PrismaticStop((0.0,), (0.3,), 0.5)
    effects = (*GRAVITY, stop) if "impacts: velocities" in red else GRAVITY
    assert misses(FAULTS[fault][0], checks, effects) == red


def test_mujoco_knows_masses_and_joints_of_its_own():
    pytest.importorskip("mujoco", reason="MuJoCo is in the extra 'verify'")
    for fault, red in (("M of two links", "mass matrix and tip"), ("accelerations", "accelerations")):
        assert misses(FAULTS[fault][0], checks("engines")) == {f"MuJoCo: {red}"}


def test_a_method_of_another_order_than_it_says_is_red(monkeypatch):
    for order, red in ((3, {"order of convergence"}), (2, set())):
        said = dataclasses.replace(heun.HEUN, name=f"said_{order}", order=order)
        monkeypatch.setitem(METHODS, said.name, said)
        assert misses(ARMS["3R"], checks("order of convergence"), integrator=said.name) == red


@pytest.mark.long
def test_a_tolerance_that_is_not_kept_is_red(monkeypatch):
    """The estimate of a step is a millionth of the right one."""
    step = {"tolerance": 1e-9, "control_dt": 0.3}
    assert misses(ARMS["3R"], checks("tolerance kept"), **step) == set()
    right = common_step.step_error

    def small(dynamics, *known):
        return (1e-6 if dynamics.scene.tolerance else 1.0) * right(dynamics, *known)

    monkeypatch.setattr(common_step, "step_error", small)
    assert misses(ARMS["3R"], checks("tolerance kept"), **step) == {"tolerance kept"}


# ---- what is right -------------------------------------------------------------------------------------


def chain(types):
    n = len(types)
    lengths = tuple(0.2 + 0.1 * (k % 4) for k in range(types.count("R")))
    return rde.Chain(types, tuple(0.5 + 0.3 * (k % 3) for k in range(n)), lengths)


def test_intervals_that_magnify_rounding_make_no_evaluator_red():
    """Steps too long for stiff springs end at 1e13 rad/s, where last bits are 1e-9 of everything."""
    spring = e.TwoStageSpring("joint3", -0.1, 0.05, 20.0, 4e3)
    scene = rde.Scene(ARMS["3R"], (*GRAVITY, e.ViscousFriction(0.1), spring), **STEPS["rk8"])
    assert misses(scene, checks("evaluators: NumPy"), states=64) == set()


def test_an_arm_of_sliders_alone_falls_along_them_and_is_drawn():
    arm = rde.Chain("PP", masses=(1.0, 0.5))
    scene = rde.Scene(arm, (e.Gravity(9.81, (1.0, 0.0)),), control_dt=0.1, tolerance=1e-6)
    batch = rde.BatchSimulator(scene, 2)
    assert not batch.advance(np.zeros((2, 2))).numerics.any()
    # The first mass falls freely, and the second beside it.
    np.testing.assert_allclose(batch.q, [[0.5 * 9.81 * 0.1**2, 0.0]] * 2, rtol=0.0, atol=1e-13)
    still = rde.simulate(scene, np.zeros(2), np.zeros(2), [0.0, 0.1])
    assert rde.animate(still).frame(0).shape == (480, 480, 3)


RIGHT = {
    **ARMS,
    **{types: chain(types) for types in ("R", "P", "PR", "PP", "PRP", "RPR", "RRPP", "R" * 10)},
    "relative": RelativeTwoR,
    "a micrometre": rde.RPRP((1e-6,) * 4, (1e-6, 1e-6)),
}


@pytest.mark.long
def test_what_is_right_is_green_whatever_the_states():
    rng = np.random.default_rng(0)
    of_states = checks("equations", "kinematics", "forces", "hints")
    things = RIGHT | {f"drawn {k}": drawn_scene(rng, calm=True) for k in range(12)}
    found = {name: misses(thing, of_states, states=64) for name, thing in things.items()}
    assert {name: red for name, red in found.items() if red} == {}
