"""verify: potentials, declarations and laws of effects against their forces; a wrong one fails by name."""

import dataclasses
from dataclasses import dataclass

import numpy as np
import pytest
from catalogue import SCENES

import redundant_envs as rde
from redundant_envs.effects.hooks import Actuation, Effect, Force, Obstacle, Point, State
from redundant_envs.language.algebra import exp, maximum, physics, where
from redundant_envs.scenes.scene import LONGEST_INTERVAL, SHORTEST_INTERVAL, scene_names
from redundant_envs.verify import Mode, Verdict, conservation, evaluators, hints, impacts, symmetries, verify
from redundant_envs.verify.accuracy import flagged, order
from redundant_envs.verify.checks import Sample, checks_of
from redundant_envs.verify.conservation import energy_book
from redundant_envs.verify.forces import forces_at_switches, potentials
from redundant_envs.verify.subjects import Subject, subject_of
from studies.kinked_effects import SmoothFriction

e = rde.effects
FOUR_R = rde.FourR((2.3, 0.7, 1.9, 0.4), (1.1, 0.6, 0.9, 0.35))
RPRP = rde.RPRP((2.3, 0.7, 1.9, 0.4), (1.1, 0.6))
STATES = 64
OF_EFFECTS = (potentials, forces_at_switches, *checks_of(hints))


def misses(scene, checks=OF_EFFECTS, states=STATES):
    return {miss.partition(": ")[0] for miss in verify(scene, states, checks=checks).misses}


def scene_with(*hooks):
    """A scene with an effect that has these hooks, and some numbers."""

    @dataclass(frozen=True)
    class Own(Effect):
        k: float = 8.0
        lower: float = -0.3
        upper: float = 0.7

        def hooks(self, arm):
            return hooks

    return rde.Scene(FOUR_R, (e.Gravity(), Own()))


def times(factor):
    """A function that declares a share of k."""
    return physics(lambda k: factor * k)


X, RATE = {"x": "phi2", "k": ".k"}, {"rate": "phid2", "k": ".k"}
BOTH, AT_TIP = {**X, "rate": "phid2"}, {"vx": "tip_vx", "vy": "vy4", "k": ".k"}
TO_3, TO_2 = {**X, "y": "phi3"}, {"x": "phi3", "y": "phi2", "k": ".k"}
SPRING, ENERGY = physics(lambda x, k: -k * x), physics(lambda x, k: 0.5 * k * x**2)
COUPLED, OF_BOTH = physics(lambda x, y, k: -k * (x - y)), physics(lambda x, y, k: 0.5 * k * (x - y) ** 2)
DAMPED = physics(lambda x, rate, k: -k * (x + 0.1 * rate))
ONE_SIDED = physics(lambda x, k: -k * maximum(x, 0.0))
BRAKE, PUSH = physics(lambda rate, k: -k * rate), physics(lambda rate, k: k * rate)
AT_POINT = physics(lambda vx, vy, k: (-k * vx + 3.0 * k * vy, -k * vy - 3.0 * k * vx))
STATE, FOLLOW = physics(lambda z: z), physics(lambda command, z, k: k * (command - z))
TURN, BACK = physics(lambda other, k: k * other), physics(lambda other, k: -k * other)


def lagging(**declared):
    """A state that follows the command."""
    bind = {"command": "command2", "z": ".z", "k": ".k"}
    return Actuation(1, STATE, bind, states=(State("z", "N m", FOLLOW, bind=bind, **declared),))


def after(factor):
    """A closed form of such a state, right with the factor 1."""
    return physics(lambda command, z, k, elapsed: command + (z - command) * exp(-factor * k * elapsed))


def swinging(rate):
    """Two states, of which neither changes with itself."""
    pairs = (("a", TURN, ".b"), ("b", BACK, ".a"))
    states = [State(n, "1", f, bind={"other": other, "k": ".k"}, rate=rate) for n, f, other in pairs]
    return Force(1, STATE, {"z": ".a"}, states=tuple(states))


def switching(law, **more):
    bind = {**X, "lower": ".lower", "upper": ".upper", **more}
    return Force(1, physics(law), bind, switch=(".lower", ".upper"))


RIGHT = [
    Force(1, SPRING, X, potential=ENERGY, stiffness=times(1.0)),
    Force(1, DAMPED, BOTH, potential=ENERGY, conservative=SPRING),
    Force(1, ONE_SIDED, X, potential=physics(lambda x, k: 0.5 * k * maximum(x, 0.0) ** 2)),
    Force(1, COUPLED, TO_3, potential=OF_BOTH),
    Force(2, COUPLED, TO_2, conservative=COUPLED),
    Force(1, physics(lambda rate, y, k: -k * (rate - y)), {**RATE, "y": "phid3"}, damping=times(1.0)),
    Force(Point(3), AT_POINT, AT_TIP, damping=times(4.0)),
    Force(1, PUSH, RATE),
    lagging(closed=after(1.0)),
    lagging(rate=times(1.6)),
    swinging(times(1.6)),
    switching(lambda x, lower, upper, k, side: -k * x - 9.0 * k * maximum(side, 0.0) * (x - upper)),
    Obstacle(physics(lambda xa, ya, xb, yb, k: xa + ya + xb + yb - k)),
]
WRONG = {
    "the sign of a potential": (
        "potentials against forces", Force(1, SPRING, X, potential=physics(lambda x, k: -0.5 * k * x**2)),
    ),
    "a factor of 1.00002": (
        "potentials against forces", Force(1, SPRING, X, potential=physics(lambda x, k: 0.50001 * k * x**2)),
    ),
    "an uncounted damper": (
        "potentials against forces", Force(1, DAMPED, BOTH, potential=ENERGY, conservative=ONE_SIDED),
    ),
    "half of a coupling": ("potentials against forces", Force(1, COUPLED, TO_3, potential=OF_BOTH)),
    "stiffness by more than a half": ("declared stiffness", Force(1, SPRING, X, stiffness=times(1 / 1.6))),
    "damping": ("declared damping", Force(1, BRAKE, RATE, damping=times(1e-9))),
    "damping at the tip": ("declared damping", Force(Point(3), AT_POINT, AT_TIP, damping=times(1.0))),
    "the sign of a damper": ("dampers brake", Force(1, PUSH, RATE, damping=times(1.0))),
    "a force at rest": ("numbers at rest", Force(1, physics(lambda rate, k: -k * rate / abs(rate)), RATE)),
    "a link at rest": (
        "numbers at rest",
        Actuation(1, physics(lambda command: command * command / abs(command)), {"command": "command2"}),
    ),
    "the rate of a state": ("declared rates of states", lagging(rate=times(1 / 1.6))),
    "rates of states that swing": ("declared rates of states", swinging(times(1 / 1.6))),
    "a closed form that is half as fast": ("closed forms of states", lagging(closed=after(0.5))),
    "a clearance at rest": (
        "numbers at rest", Obstacle(physics(lambda xa, xb, k: k * (xb - xa) / abs(xa))),
    ),
    "a jump at the top, with the rate": (
        "forces at their switches",
        switching(
            lambda x, rate, lower, upper, k, side: -k * x - 1e-8 * k * maximum(side, 0.0) * rate, rate="phid2"
        ),
    ),
}  # fmt: skip


def test_what_effects_declare_rightly_is_green():
    for hook in RIGHT[:3] + RIGHT[5:]:
        assert misses(scene_with(hook)) == set(), hook
    assert misses(scene_with(*RIGHT[:5]), (potentials, energy_book)) == set()


@pytest.mark.quick("the sign of a potential")
@pytest.mark.parametrize(("red", "hook"), WRONG.values(), ids=WRONG)
def test_what_effects_declare_wrongly_is_red_and_named(red, hook):
    found = verify(scene_with(hook), STATES, checks=OF_EFFECTS)
    (missed,) = (o for o in found.outcomes if o.verdict is Verdict.MISSED)
    assert missed.check == red
    assert "own" in missed.finding.words


@pytest.mark.long
def test_intervals_that_are_flagged_are_told():
    """Friction that jumps where a joint turns: no number of steps reaches a tolerance."""
    dry = physics(lambda rate, k: where(rate > 0.0, -k, where(rate < 0.0, k, 0.0)))
    hooks = [Force(k, dry, {"rate": f"phid{k + 1}", "k": ".k"}) for k in range(4)]
    scene = dataclasses.replace(scene_with(*hooks), tolerance=1e-6)
    outcome = verify(scene, STATES, checks=(flagged,)).outcomes[0]
    assert outcome.finding.found > 0.5
    assert outcome.verdict is Verdict.MISSED
    assert "% of the intervals end with a flag (TOLERANCE_NOT_REACHED)" in outcome.finding.words
    assert not misses(rde.Scene(FOUR_R, (e.Gravity(),), tolerance=1e-6), (flagged,))


@pytest.mark.long
def test_impacts_without_an_end_and_of_an_arm_of_a_micrometre_are_good():
    tiny = rde.RPRP((1e-6,) * 4, (1e-6, 1e-6))
    scene = rde.Scene(tiny, (e.Gravity(), e.PrismaticStop((0.0, 0.0), (1e-6, 1e-6), 1.0)), control_dt=1e-3)
    assert not misses(scene, checks_of(impacts))
    scene = rde.Scene(RPRP, (e.Gravity(), e.PrismaticStop((None, None), (None, None))), tolerance=1e-6)
    result = verify(scene, STATES, checks=checks_of(impacts))
    assert result.good
    assert {o.finding.words for o in result.outcomes} == {"no stop has an end"}


@pytest.mark.long
@pytest.mark.parametrize(("control_dt", "substeps"), [(SHORTEST_INTERVAL, 8), (LONGEST_INTERVAL, 1)])
def test_intervals_of_every_allowed_length_can_be_measured(control_dt, substeps):
    scene = dataclasses.replace(SCENES["stops rk4, inelastic"], control_dt=control_dt, substeps=substeps)
    result = verify(scene, 8, checks=checks_of(conservation, evaluators, symmetries))
    assert [o.finding.words for o in result.outcomes if "control_dt" in o.finding.words] == []


def test_given_states_are_judged_however_fast_and_however_near_to_rest():
    """No interval is shorter than a scene allows, and energies below rounding of an angle are no fault."""
    scene = rde.Scene(rde.FourR((0.5,) * 4, (1e5,) * 4), (e.Gravity(1.6),), control_dt=1e-6)
    straight = [[3.141592653589794, 3.141592653589794, -3.1415926535897922, 1e-15]]
    for efforts in (0.0, 1e300):
        given = np.array(straight), np.zeros((1, 4)), np.full((1, 4), efforts)
        outcome = energy_book.run(Sample(Subject("given", scene), 1, chosen=given))
        assert outcome.verdict is (Verdict.MISSED if efforts else Verdict.KEPT)
        assert "control_dt" not in outcome.finding.words


def test_a_book_that_does_not_close_is_red(monkeypatch):
    """Even where every potential is right: here the work of a damper is forgotten."""
    scene = scene_with(Force(1, BRAKE, RATE))
    assert not misses(scene, (energy_book,))
    work = rde.BatchSimulator.work.fget
    monkeypatch.setattr(rde.BatchSimulator, "work", property(lambda batch: 0.99 * work(batch)))
    (miss,) = verify(scene, STATES, checks=(energy_book,)).misses
    assert miss.startswith("energy balance: energy: kinetic + potential - work changes by up to")


RAISED = physics(lambda position, lower, upper, stiffness: 0.0 * position)
WEAK = physics(lambda stiffness: 1e-9 * stiffness)
CALM = physics(lambda position, lower, upper, damping: 1e-9 * damping * abs(position - upper))
LEVEL = physics(lambda level, scale: 0.5 * level / scale)
CENTRING = e.CentringSpring((9.0, 8.0), (0.0, 0.0), (0.3, 0.3))


@pytest.mark.parametrize(
    ("effect", "change", "red"),
    [
        (e.LimitSpring("r1", 0.0, 0.3, 50.0, 900.0), {"potential": RAISED}, "potentials against forces"),
        (e.LimitSpring("joint2", -4.0, 5.0, 50.0, 9.0), {"stiffness": WEAK}, "declared stiffness"),
        (e.LimitSpring("r2", 0.0, 0.3, 50.0, 9.0), {"damping": CALM}, "declared damping"),
        (CENTRING, {"function": RAISED, "conservative": RAISED}, "potentials against forces"),
        (SmoothFriction(0.5, 1e-3), {"damping": LEVEL}, "declared damping"),
    ],
)
def test_forces_are_looked_at_where_they_act(effect, change, red):
    """Springs at the ends of the travel act only beyond it, and smooth friction is steepest near rest."""

    class Changed(type(effect)):
        def hooks(self, arm):
            return tuple(dataclasses.replace(hook, **change) for hook in super().hooks(arm))

    checks = (potentials, *checks_of(hints))
    assert misses(rde.Scene(RPRP, (effect,)), checks, 256) == set()
    assert misses(rde.Scene(RPRP, (Changed(**dataclasses.asdict(effect)),)), checks, 256) == {red}


@pytest.mark.long
@pytest.mark.parametrize("width", [1e-9, 1e-4, 1e6])
@pytest.mark.parametrize(
    ("arm", "joints"), [(RPRP, ("r1", "joint2")), (FOUR_R, ("joint2",))], ids=["RPRP", "4R"]
)
def test_springs_at_any_distance_from_each_other_make_no_fault(width, arm, joints):
    """Differences do not straddle both limits, and rounding of an angle of many turns is no error."""
    springs = (e.LimitSpring(joint, -0.5 * width, 0.5 * width, 5000.0, 10.0) for joint in joints)
    scene = rde.Scene(arm, (e.Gravity(), *springs), tolerance=1e-6)
    assert misses(scene, (potentials, energy_book, forces_at_switches, order)) == set()


def test_a_quantity_of_an_arm_that_is_no_number_at_rest_is_red():
    class Divided(rde.Arm):
        joint_types = "R"
        functions = (physics(lambda m1, l1, w1: m1 * l1 * l1 * w1 * w1 / w1, gives="Lz"),)

    (miss,) = verify(rde.Scene(Divided((1.0,), (1.0,))), STATES, checks=(hints.numbers_at_rest,)).misses
    assert miss.startswith("numbers at rest: at rest, without efforts, Lz is not finite")


@pytest.mark.long
@pytest.mark.parametrize("word", [*scene_names(), "FourRGoalReach-v0"])
def test_scenes_of_the_package_are_good(word):
    assert verify(subject_of(word), 512, Mode.FULL).misses == ()


def test_coarse_steps_do_not_open_the_book():
    """The balance is that of the scene, not of its step."""
    coarse = {"integrator": "euler", "control_dt": 0.1, "tolerance": None}
    result = verify(dataclasses.replace(rde.load_scene("four_r_free"), **coarse), STATES, Mode.QUICK)
    assert result.good
    (tip_error,) = (o for o in result.outcomes if o.check == "tip error of the own step")
    assert "take more substeps" in tip_error.finding.words
