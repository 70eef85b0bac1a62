"""verify: potentials, declarations and laws of effects against their forces; a wrong one fails by name."""

import dataclasses
import re
from dataclasses import dataclass
from types import SimpleNamespace

import pytest
from catalogue import SCENES

import redundant_envs as rde
from redundant_envs.effects.hooks import Actuation, Effect, Force, Point, State
from redundant_envs.language.algebra import exp, maximum, physics, where
from redundant_envs.scenes.scene import LONGEST_INTERVAL, SHORTEST_INTERVAL, scene_names
from redundant_envs.verify import (
    Mode,
    closed_forms,
    conservation,
    evaluators,
    hints,
    impacts,
    rest,
    symmetries,
    verify,
)
from redundant_envs.verify.accuracy import flagged, order
from redundant_envs.verify.checks import checks_of
from redundant_envs.verify.conservation import energy_book
from redundant_envs.verify.forces import forces_at_switches, potentials
from redundant_envs.verify.promises import Verdict
from redundant_envs.verify.subjects import subject_of
from studies.kinked_effects import SmoothFriction

e = rde.effects
FOUR_R = rde.FourR((2.3, 0.7, 1.9, 0.4), (1.1, 0.6, 0.9, 0.35))
RPRP = rde.RPRP((2.3, 0.7, 1.9, 0.4), (1.1, 0.6))
STATES = 64
ENERGIES, DECLARED = (potentials, energy_book), checks_of(hints, rest)


def misses(scene, checks=DECLARED, states=STATES):
    return {miss.partition(": ")[0] for miss in verify(scene, states, checks=checks).misses}


def scene_with(*hooks, k=8.0):
    """A scene with an effect that has these hooks, and a number k."""

    @dataclass(frozen=True)
    class Own(Effect):
        k: float = 8.0

        def hooks(self, arm):
            return hooks

    return rde.Scene(FOUR_R, (e.Gravity(), Own(k)))


def times(factor):
    """A function that declares a share of k."""
    return physics(lambda k: factor * k)


law = SimpleNamespace(
    spring=physics(lambda x, k: -k * x),
    energy=physics(lambda x, k: 0.5 * k * x**2),
    wrong_sign=physics(lambda x, k: -0.5 * k * x**2),
    wrong_factor=physics(lambda x, k: k * x**2),
    slightly_wrong=physics(lambda x, k: 0.50001 * k * x**2),
    coupled=physics(lambda x, y, k: -k * (x - y)),
    coupled_energy=physics(lambda x, y, k: 0.5 * k * (x - y) ** 2),
    damped=physics(lambda x, rate, k: -k * (x + 0.1 * rate)),
    one_sided=physics(lambda x, k: -k * maximum(x, 0.0)),
    one_sided_energy=physics(lambda x, k: 0.5 * k * maximum(x, 0.0) ** 2),
    brake=physics(lambda rate, k: -k * rate),
    push=physics(lambda rate, k: k * rate),
    in_wind=physics(lambda rate, k: -k * (rate - 3.0) * abs(rate - 3.0)),
    steepness_in_wind=physics(lambda rate, k: 2.0 * k * abs(rate - 3.0)),
    between=physics(lambda rate, other, k: -k * (rate - other)),
    brake_at_point=physics(lambda vx, vy, k: (-k * vx + 3.0 * k * vy, -k * vy - 3.0 * k * vx)),
    push_at_point=physics(lambda vx, vy, k: (-k * vx, k * vy)),
    dry=physics(lambda rate, k: -k * rate / abs(rate)),
    by_sign=physics(lambda rate, k: where(rate > 0.0, -k, where(rate < 0.0, k, 0.0))),
    share_of=physics(lambda command: command * command / abs(command)),
)
X, RATE = {"x": "phi2", "k": ".k"}, {"rate": "phid2", "k": ".k"}
BOTH, AT_TIP = {**X, "rate": "phid2"}, {"vx": "tip_vx", "vy": "vy4", "k": ".k"}
TO_3, TO_2 = {**X, "y": "phi3"}, {"x": "phi3", "y": "phi2", "k": ".k"}
RIGHT = {
    "nothing else said": (ENERGIES, Force(1, law.spring, X, potential=law.energy)),
    "with a damper, of an angle, one-sided, between two joints": (
        ENERGIES,
        Force(1, law.damped, BOTH, potential=law.energy, conservative=law.spring),
        Force(0, law.spring, {"x": "theta1", "k": ".k"}, potential=law.energy),
        Force(1, law.one_sided, X, potential=law.one_sided_energy),
        Force(1, law.coupled, TO_3, potential=law.coupled_energy),
        Force(2, law.coupled, TO_2, conservative=law.coupled),
    ),
    "spring": (DECLARED, Force(1, law.spring, X, stiffness=times(1.0))),
    "drag in the wind": (DECLARED, Force(1, law.in_wind, RATE, damping=law.steepness_in_wind)),
    "dampers between two joints": (
        DECLARED, Force(1, law.between, {**RATE, "other": "phid3"}, damping=times(1.0)),
    ),
    "at the tip": (DECLARED, Force(Point(3), law.brake_at_point, AT_TIP, damping=times(4.0))),
    "a force that drives and declares nothing": (DECLARED, Force(1, law.push, RATE)),
}  # fmt: skip
AT_2, AT_3 = (f"potentials against forces: own: at joint{k} the conservative force is" for k in (2, 3))
STIFF, DAMPED, DRIVES = "declared stiffness: own", "declared damping: own", "dampers brake: own"
AT_REST = "numbers at rest: .*own"
WRONG = {
    "sign": (AT_2, Force(1, law.spring, X, potential=law.wrong_sign)),
    "factor": (AT_2, Force(1, law.spring, X, potential=law.wrong_factor)),
    "small factor": (AT_2, Force(1, law.spring, X, potential=law.slightly_wrong)),
    "uncounted damper": (
        AT_2, Force(1, law.damped, BOTH, potential=law.energy, conservative=law.one_sided),
    ),
    "half of a coupling": (AT_3, Force(1, law.coupled, TO_3, potential=law.coupled_energy)),
    "stiffness by more than a half": (STIFF, Force(1, law.spring, X, stiffness=times(1 / 1.6))),
    "damping": (DAMPED, Force(1, law.brake, RATE, damping=times(1e-9))),
    "sign of a damper": (DRIVES, Force(1, law.push, RATE, damping=times(1.0))),
    "sign at the tip": (DRIVES, Force(Point(3), law.push_at_point, AT_TIP, damping=times(1.0))),
    "damping at the tip": (DAMPED, Force(Point(3), law.brake_at_point, AT_TIP, damping=times(1.0))),
    "force at rest": (AT_REST, Force(1, law.dry, RATE)),
    "link at rest": (AT_REST, Actuation(1, law.share_of, {"command": "command2"})),
}  # fmt: skip


@pytest.mark.quick("nothing else said")
@pytest.mark.parametrize("case", RIGHT.values(), ids=RIGHT)
def test_what_effects_declare_rightly_is_green(case):
    checks, *hooks = case
    assert misses(scene_with(*hooks), checks) == set()


@pytest.mark.quick("sign")
@pytest.mark.parametrize(("words", "hook"), WRONG.values(), ids=WRONG)
def test_what_effects_declare_wrongly_is_red_and_named(words, hook):
    checks = ENERGIES if words.startswith("potentials") else DECLARED
    first, *others = verify(scene_with(hook), STATES, checks=checks).misses
    assert re.match(words, first)
    assert all(miss.startswith("energy book") for miss in others)


@pytest.mark.long
def test_intervals_that_are_flagged_are_told():
    """Friction that jumps where a joint turns: no number of steps reaches a tolerance."""
    hooks = [Force(k, law.by_sign, {"rate": f"phid{k + 1}", "k": ".k"}) for k in range(4)]
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


def test_a_book_that_does_not_close_is_red(monkeypatch):
    """Even where every potential is right: here the work of a damper is forgotten."""
    scene = scene_with(Force(1, law.brake, RATE))
    assert not misses(scene, ENERGIES)
    work = rde.BatchSimulator.work.fget
    monkeypatch.setattr(rde.BatchSimulator, "work", property(lambda batch: 0.99 * work(batch)))
    (miss,) = verify(scene, STATES, checks=ENERGIES).misses
    assert miss.startswith("energy book: energy: kinetic + potential - work changes by up to")


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

    checks = (potentials, *DECLARED)
    assert misses(rde.Scene(RPRP, (effect,)), checks, 256) == set()
    assert misses(rde.Scene(RPRP, (Changed(**dataclasses.asdict(effect)),)), checks, 256) == {red}


@pytest.mark.long
@pytest.mark.parametrize("width", [1e-9, 1e-4, 1e6])
@pytest.mark.parametrize(
    ("arm", "joints"),
    [(RPRP, ("r1", "joint2")), (rde.FourR((1.0,) * 4, (0.3,) * 4), ("joint2",))],
    ids=["RPRP", "4R"],
)
def test_springs_at_any_distance_from_each_other_make_no_fault(width, arm, joints):
    """Differences do not straddle both limits, and rounding of an angle of many turns is no error."""
    springs = (e.LimitSpring(joint, -0.5 * width, 0.5 * width, 5000.0, 10.0) for joint in joints)
    scene = rde.Scene(arm, (e.Gravity(), *springs), tolerance=1e-6)
    assert misses(scene, (potentials, energy_book, forces_at_switches, order)) == set()


JUMPS = {
    "everywhere": (lambda x, lower, upper, k, side: -k * x - 1e-6 * k * (upper - lower) * side, ".lower"),
    "at the top, with the rate": (
        lambda x, rate, lower, upper, k, side: -k * x - 1e-8 * k * maximum(side, 0.0) * rate, ".upper",
    ),
    "nowhere": (
        lambda x, lower, upper, k, side: (
            -k * x - 9.0 * k * (maximum(side, 0.0) * (x - upper) - maximum(-side, 0.0) * (x - lower))
        ),
        None,
    ),
}  # fmt: skip


@pytest.mark.parametrize(("function", "limit"), JUMPS.values(), ids=JUMPS)
def test_a_force_that_jumps_where_its_law_changes_is_red(function, limit):
    @dataclass(frozen=True)
    class Switching(Effect):
        lower: float = -0.3
        upper: float = 0.7
        k: float = 8.0

        def hooks(self, arm):
            bind = {**BOTH, "lower": ".lower", "upper": ".upper"}
            used = {n: s for n, s in bind.items() if n in function.__code__.co_varnames}
            return (Force(1, physics(function), used, switch=(".lower", ".upper")),)

    found = verify(rde.Scene(FOUR_R, (Switching(),)), STATES, checks=(forces_at_switches,)).misses
    assert len(found) == (limit is not None)
    assert all(f"switching: at ('.lower', '.upper'), {limit} = " in miss for miss in found)


STATE, FOLLOW = physics(lambda z: z), physics(lambda command, z, k: k * (command - z))
TURN, BACK = physics(lambda other, k: k * other), physics(lambda other, k: -k * other)


def lagging(rate):
    bind = {"command": "command2", "z": ".z", "k": ".k"}
    return Actuation(1, STATE, bind, states=(State("z", "N m", FOLLOW, bind=bind, rate=rate),))


def swinging(rate):
    """Two states, of which neither changes with itself."""
    pairs = (("a", TURN, ".b"), ("b", BACK, ".a"))
    states = [State(n, "1", f, bind={"other": other, "k": ".k"}, rate=rate) for n, f, other in pairs]
    return Force(1, STATE, {"z": ".a"}, states=tuple(states))


@pytest.mark.parametrize("hook", [lagging, swinging])
@pytest.mark.parametrize(("share", "red"), [(1.6, False), (1 / 1.6, True)])
def test_rates_of_states_are_compared_with_how_they_change(hook, share, red):
    assert misses(scene_with(hook(times(share)))) == ({"declared rates of states"} if red else set())


CLOSED = {
    "right": (lambda command, z, k, elapsed: command + (z - command) * exp(-k * elapsed), False),
    "half as fast": (lambda command, z, k, elapsed: command + (z - command) * exp(-0.5 * k * elapsed), True),
    "another start": (
        lambda command, z, k, elapsed: command + (1.001 * z - command) * exp(-k * elapsed), True,
    ),
}  # fmt: skip


@pytest.mark.parametrize("form", CLOSED)
def test_a_closed_form_that_does_not_solve_its_derivative_is_red(form):
    function, red = CLOSED[form]
    bind = {"command": "command2", "z": ".z", "k": ".k"}
    state = State("z", "N m", FOLLOW, bind=bind, closed=physics(function))
    scene = scene_with(Actuation(1, STATE, bind, states=(state,)))
    assert misses(scene, checks_of(closed_forms)) == ({"closed forms of states"} if red else set())


def test_a_quantity_of_an_arm_that_is_no_number_at_rest_is_red():
    class Divided(rde.Arm):
        joint_types = "R"
        functions = (physics(lambda m1, l1, w1: m1 * l1 * l1 * w1 * w1 / w1, gives="Lz"),)

    (miss,) = verify(rde.Scene(Divided((1.0,), (1.0,))), STATES, checks=DECLARED).misses
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
    assert "take more substeps" in result.of("tip error of the own step").finding.words
