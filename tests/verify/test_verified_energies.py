"""verify: every potential against its force, and a closed energy balance; a wrong one fails."""

import dataclasses
import re
from dataclasses import dataclass

import pytest

import redundant_envs as rde
from redundant_envs.__main__ import main
from redundant_envs.algebra import maximum, minimum, physics, where
from redundant_envs.effects import (
    REGISTRY,
    CentringSpring,
    Gravity,
    LimitSpring,
    PrismaticStop,
    centring_spring,
    limit_spring,
)
from redundant_envs.effects.hooks import Effect, Force, State
from redundant_envs.scene import LONGEST_INTERVAL, SHORTEST_INTERVAL, scene_names
from redundant_envs.verify import Mode, conservation, evaluators, impacts, symmetries, verify
from redundant_envs.verify.accuracy import flagged, order
from redundant_envs.verify.checks import Verdict, checks_of
from redundant_envs.verify.conservation import energy_book
from redundant_envs.verify.forces import forces_at_switches, potentials

FOUR_R = rde.FourR((2.3, 0.7, 1.9, 0.4), (1.1, 0.6, 0.9, 0.35))
RPRP = rde.RPRP((2.3, 0.7, 1.9, 0.4), (1.1, 0.6))
STATES = 64


def energies(scene):
    return verify(scene, STATES, checks=(potentials, energy_book))


@physics
def force(x, k):
    return -k * x


@physics
def energy(x, k):
    return 0.5 * k * x**2


@physics
def wrong_sign(x, k):
    return -0.5 * k * x**2


@physics
def wrong_factor(x, k):
    return k * x**2


@physics
def clamped(x, k):
    return 0.5 * k * minimum(x * x, 16.0)


@physics
def slightly_wrong(x, k):
    return 0.50001 * k * x**2


@physics
def coupled_energy(x, y, k):
    return 0.5 * k * (x - y) ** 2


@physics
def coupled_force(x, y, k):
    return -k * (x - y)


@physics
def damped(x, rate, k):
    return -k * (x + 0.1 * rate)


@physics
def one_sided(x, k):
    return -k * maximum(x, 0.0)


@physics
def one_sided_energy(x, k):
    return 0.5 * k * maximum(x, 0.0) ** 2


X, Y = {"x": "phi2", "k": ".k"}, {"x": "phi3", "k": ".k"}
RIGHT = {
    "nothing else said": (Force(1, force, X, potential=energy),),
    "said twice": (Force(1, force, X, potential=energy, conservative=force),),
    "with a damper": (Force(1, damped, {**X, "rate": "phid2"}, potential=energy, conservative=force),),
    "between two joints": (
        Force(1, coupled_force, {**X, "y": "phi3"}, potential=coupled_energy),
        Force(2, coupled_force, {**Y, "y": "phi2"}, conservative=coupled_force),
    ),
    "of an angle": (Force(0, force, {"x": "theta1", "k": ".k"}, potential=energy),),
    "one-sided": (Force(1, one_sided, X, potential=one_sided_energy),),
}
WRONG = {
    "sign": ((Force(1, force, X, potential=wrong_sign),), "joint2"),
    "factor": ((Force(1, force, X, potential=wrong_factor),), "joint2"),
    "beyond a turn": ((Force(1, force, X, potential=clamped),), "joint2"),
    "small factor": ((Force(1, force, X, potential=slightly_wrong),), "joint2"),
    "joint": ((Force(2, force, X, potential=energy),), r"joint[23]"),
    "damper that is not counted": (
        (Force(1, damped, {**X, "rate": "phid2"}, potential=energy, conservative=one_sided),), "joint2",
    ),
    "half of a coupling": (
        (Force(1, coupled_force, {**X, "y": "phi3"}, potential=coupled_energy),), "joint3",
    ),
}  # fmt: skip


def effect_with(hooks):
    @dataclass(frozen=True)
    class Own(Effect):
        k: float = 8.0

        def hooks(self, arm):
            return hooks

    return Own


@pytest.mark.parametrize("hooks", RIGHT.values(), ids=RIGHT)
def test_a_right_potential_is_green(hooks):
    result = energies(rde.Scene(FOUR_R, (effect_with(hooks)(),)))
    assert result.good
    assert result.of("energy book").finding.found < 1e-10


@pytest.mark.parametrize(("hooks", "joint"), WRONG.values(), ids=WRONG)
def test_a_wrong_potential_is_red(hooks, joint):
    result = energies(rde.Scene(FOUR_R, (effect_with(hooks)(),)))
    assert not result.good
    assert re.search(f"own: at {joint} the conservative force is", result.misses[0])


@physics
def by_sign(rate, k):
    return where(rate > 0.0, -k, where(rate < 0.0, k, 0.0))


def test_intervals_that_are_flagged_are_told():
    """Friction that jumps where a joint turns: no number of steps reaches a tolerance."""
    hooks = tuple(Force(k, by_sign, {"rate": f"phid{k + 1}", "k": ".k"}) for k in range(4))
    effects = (Gravity(), effect_with(hooks)())
    outcome = verify(rde.Scene(FOUR_R, effects, tolerance=1e-6), STATES, checks=(flagged,)).outcomes[0]
    assert outcome.finding.found > 0.5
    assert outcome.verdict is Verdict.MISSED
    assert "% of the intervals end with a flag (TOLERANCE_NOT_REACHED)" in outcome.finding.words
    assert verify(rde.Scene(FOUR_R, (Gravity(),), tolerance=1e-6), STATES, checks=(flagged,)).good


def test_stops_without_an_end_are_no_fault():
    open_ended = PrismaticStop((None, None), (None, None))
    result = verify(
        rde.Scene(RPRP, (Gravity(), open_ended), tolerance=1e-6), STATES, checks=checks_of(impacts)
    )
    assert result.good
    assert {o.finding.words for o in result.outcomes} == {"no stop has an end"}


@pytest.mark.parametrize(("control_dt", "substeps"), [(SHORTEST_INTERVAL, 100), (LONGEST_INTERVAL, 1)])
def test_intervals_of_every_allowed_length_can_be_measured(control_dt, substeps):
    effects = (Gravity(), PrismaticStop((0.0, 0.0), (0.25, 0.25), 0.3))
    scene = rde.Scene(RPRP, effects, "rk4", control_dt, substeps=substeps)
    result = verify(scene, STATES, checks=checks_of(conservation, evaluators, symmetries))
    assert [o.finding.words for o in result.outcomes if "control_dt" in o.finding.words] == []


def test_impacts_of_an_arm_of_a_micrometre_are_good():
    tiny = rde.RPRP((1e-6,) * 4, (1e-6, 1e-6))
    scene = rde.Scene(tiny, (Gravity(), PrismaticStop((0.0, 0.0), (1e-6, 1e-6), 1.0)), control_dt=1e-3)
    assert verify(scene, STATES, checks=checks_of(impacts)).good


def test_a_book_that_does_not_close_is_red(monkeypatch):
    """Even where every potential is right: here the work of a damper is forgotten."""
    scene = rde.Scene(FOUR_R, (effect_with((Force(1, force, {"x": "phid2", "k": ".k"}),))(),))
    assert energies(scene).good
    work = rde.BatchSimulator.work.fget
    monkeypatch.setattr(rde.BatchSimulator, "work", property(lambda batch: 0.99 * work(batch)))
    (miss,) = energies(scene).misses
    assert miss.startswith("energy book: energy: kinetic + potential - work changes by up to")


@physics
def half_spring_energy(position, lower, upper, stiffness):
    return 0.25 * stiffness * ((upper - position) ** 2 + (lower - position) ** 2)


@physics
def raised(position, lower, upper, stiffness):
    return 0.0 * position


@pytest.mark.parametrize(
    ("module", "effect", "field", "wrong"),
    [
        (limit_spring, LimitSpring("r1", 0.0, 0.3), "spring_energy", raised),
        (limit_spring, LimitSpring("r1", 0.0, 0.3), "spring", raised),
        (centring_spring, CentringSpring((9.0, 8.0), (0.0, 0.0), (0.3, 0.3)), "energy", half_spring_energy),
        (centring_spring, CentringSpring((9.0, 8.0), (0.0, 0.0), (0.3, 0.3)), "force", raised),
    ],
)
def test_a_mutation_of_an_effect_of_the_package_is_red(module, effect, field, wrong, monkeypatch):
    """Springs at the ends of the travel act only beyond it: potentials are checked there, too."""
    scene = rde.Scene(RPRP, (Gravity(), effect))
    assert energies(scene).good
    monkeypatch.setattr(module, field, wrong)
    misses = energies(rde.Scene(RPRP, (Gravity(), effect))).misses
    assert misses[0].startswith(f"potentials against forces: {effect.key}: at r")


@pytest.mark.parametrize("width", [1e-9, 1e-6, 1e-4, 1.0, 1e3, 1e5])
@pytest.mark.parametrize("joint", ["r1", "joint2"])
def test_springs_at_any_distance_from_each_other_make_no_fault(width, joint):
    """Differences do not straddle both limits, and rounding of an angle of many turns is no error."""
    spring = LimitSpring(joint, -0.5 * width, 0.5 * width, 5000.0, 10.0)
    for arm in (RPRP, rde.FourR((1.0,) * 4, (0.3,) * 4)) if joint == "joint2" else (RPRP,):
        scene = rde.Scene(arm, (Gravity(), spring), tolerance=1e-6)
        result = verify(scene, STATES, checks=(potentials, energy_book, forces_at_switches, order))
        assert result.misses == ()


@physics
def jumping(x, lower, upper, k, side):
    return -k * x - 1e-6 * k * (upper - lower) * side


@physics
def jumping_at_the_top(x, rate, lower, upper, k, side):
    return -k * x - 1e-8 * k * maximum(side, 0.0) * rate


@physics
def meeting(x, lower, upper, k, side):
    return -k * x - 9.0 * k * (maximum(side, 0.0) * (x - upper) - maximum(-side, 0.0) * (x - lower))


@physics
def forgets(memory):
    return -memory


@pytest.mark.parametrize("remembers", [False, True], ids=["", "with a state"])
@pytest.mark.parametrize(
    ("function", "limit"),
    [(jumping, ".lower"), (jumping_at_the_top, ".upper"), (meeting, None)],
    ids=["everywhere", "at the top, with the rate", "nowhere"],
)
def test_a_force_that_jumps_where_its_law_changes_is_red(function, limit, remembers):
    @dataclass(frozen=True)
    class Switching(Effect):
        lower: float = -0.3
        upper: float = 0.7
        k: float = 8.0

        def hooks(self, arm):
            bind = {"x": "phi2", "rate": "phid2", "k": ".k", "lower": ".lower", "upper": ".upper"}
            used = {n: s for n, s in bind.items() if n in function.__code__.co_varnames}
            memory = (State("memory", "1", derivative=forgets, bind={"memory": ".memory"}),)
            states = memory if remembers else ()
            return (Force(1, function, used, switch=(".lower", ".upper"), states=states),)

    for arm in (FOUR_R, RPRP):
        misses = verify(rde.Scene(arm, (Switching(),)), STATES, checks=(forces_at_switches,)).misses
        assert len(misses) == (limit is not None)
        if limit is not None:
            assert f"switching: at ('.lower', '.upper'), {limit} = " in misses[0]


def test_energies_of_every_scale_are_judged_in_their_own_units():
    """Neither a light arm nor a potential far from zero makes a fault, or hides one."""
    for mass in (1e-6, 1e6):
        arm = rde.FourR((mass,) * 4, (1.0, 1.0, 1.0, 1.0))
        for hooks, right in ((RIGHT["nothing else said"], True), (WRONG["factor"][0], False)):
            scene = rde.Scene(arm, (Gravity(), effect_with(hooks)(8.0 * mass)))
            assert energies(scene).good is right


def test_verify_exits_with_1_on_a_miss(tmp_path, monkeypatch, capsys):
    """A registered effect is found by name in a file; the line names scene, effect and joint."""
    path = tmp_path / "mine.yaml"
    text = (
        "robot: {{type: FourR, masses: [1, 1, 1, 1], lengths: [0.2, 0.2, 0.2, 0.2]}}\n"
        "effects: [{{type: Gravity}}, {{type: {}}}]\n"
    )
    for name, hooks, status in (("Right", RIGHT["nothing else said"], 0), ("Wrong", WRONG["sign"][0], 1)):
        kind = effect_with(hooks)
        kind.__name__ = name
        monkeypatch.setitem(REGISTRY, name, kind)
        path.write_text(text.format(name))
        assert main(["verify", "--quick", "--states", "64", "four_r_free", str(path)]) == status
        out, err = capsys.readouterr()
        assert ("MISSED" in out) == bool(status)
    assert f"{path}: MISSED: potentials against forces: wrong: at joint2 the conservative force is" in out
    assert "verify found" in err
    assert "redundant_envs: 1 " not in err


@pytest.mark.parametrize("more", [("nowhere",), ("--json", "."), ("--markdown", ".")], ids=str)
def test_verify_refuses_before_it_measures(more, capsys):
    assert main(["verify", "four_r_free", *more]) == 2
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("name", scene_names())
def test_scenes_of_the_package_are_good(name):
    result = verify(rde.load_scene(name), 256, Mode.QUICK)
    assert result.misses == ()
    assert result.of("potentials against forces").finding.found < 1e-8
    assert result.of("energy book").finding.found < 1e-10


def test_coarse_steps_do_not_open_the_book():
    """The balance is that of the scene, not of its step."""
    scene = dataclasses.replace(
        rde.load_scene("four_r_free"), integrator="euler", control_dt=0.1, tolerance=None
    )
    result = verify(scene, STATES, Mode.QUICK)
    assert result.good
    assert "take more substeps" in result.of("tip error of the own step").finding.words
