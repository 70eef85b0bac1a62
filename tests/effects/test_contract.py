"""What every effect of the package promises, by rows: a new effect has them all. Its equation is tried in a
file of its own, and its page in ``tests/docs/test_pages.py``."""

import copy
import dataclasses
import json
import math
import pickle
import re
import runpy
from pathlib import Path

import numpy as np
import pytest
from catalogue import FOUR_R, GROUPS, RPRP, advanced, every_effect
from refusals import short

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.effects.numbers import (
    DECLARED,
    example_of,
    not_negative,
    of_axes,
    positive,
    strengths,
    two,
)
from redundant_envs.envs import cost
from redundant_envs.robots.parameters import number
from redundant_envs.scenes import config_folder
from redundant_envs.verify import Verdict, bits, conservation, evaluators, forces, hints, verify
from redundant_envs.verify.checks import checks_of, random_states
from studies.effects import load_study

ROOT = Path(__file__).parents[2]
described = runpy.run_path(str(ROOT / "docs" / "site" / "described.py"))["described"]
ENTRIES = load_study(config_folder("studies") / "effects.yaml").entries
"""Every effect with the numbers of its example, on a bare arm."""
EVERY = pytest.mark.parametrize("name", ENTRIES)
FIELDS = {
    f"{name}.{f.name}": (kind, f)
    for name, kind in e.OWN.items()
    for f in dataclasses.fields(kind)
    if DECLARED in f.metadata
}
OF_JOINTS = [name for name, (_, f) in FIELDS.items() if f.metadata[DECLARED].of_joints]
NAMED = [name for name, kind in e.OWN.items() if "name" in {f.name for f in dataclasses.fields(kind)}]


def alone(name, **how):
    """The scene with an effect, beside the bare arm."""
    return dataclasses.replace(ENTRIES[name].pair.scene, **how)


# ---- what it is --------------------------------------------------------------------------------------


def test_every_effect_of_the_folder_has_an_example_and_is_tested():
    assert all("example" in vars(kind) for kind in e.OWN.values())
    assert {type(entry.effect) for entry in ENTRIES.values()} == {*e.OWN.values()}
    groups = (every_effect, *GROUPS.values())
    used = {type(effect) for group in groups for arm in (RPRP, FOUR_R) for effect in group(arm)}
    assert used == {*e.OWN.values()}


@EVERY
def test_a_scene_with_an_effect_is_plain_data_and_comes_back_equal(name):
    scene = alone(name)
    data = json.loads(json.dumps(scene.to_dict()))
    for again in (rde.Scene.from_dict(data), pickle.loads(pickle.dumps(scene)), copy.deepcopy(scene)):
        assert again == scene
        assert again.parameters() == scene.parameters()


@pytest.mark.quick("Payload")
@EVERY
def test_what_an_effect_costs_is_on_the_bill(name):
    assert ENTRIES[name].effect.key in rde.bill(alone(name))


# ---- what it does ------------------------------------------------------------------------------------

CHECKS = checks_of(bits, conservation, evaluators, forces, hints)

OF_SOME = {
    "closed forms of states",
    "forces at their switches",
    "declared stiffness",
    "declared rates of states",
}
"""Checks that do not apply to every effect; an interval with backlash takes too many evaluations for those of
evaluators."""


@pytest.mark.long
@EVERY
def test_bits_energy_evaluators_and_what_is_declared_are_right(name):
    """Bits in any batch, order and copy; the energy balance; NumPy, single numbers, tensors; potentials,
    stiffness, damping, rates and closed forms of states."""
    report = verify(alone(name, tolerance=1e-6), 32, checks=CHECKS)
    assert report.misses == ()
    unjudged = {o.check for o in report.outcomes if o.verdict is not Verdict.KEPT} - OF_SOME
    assert all(check.startswith("evaluators") and name == "GearBacklash" for check in unjudged)


HOW = {
    "one rk8 step": {"tolerance": None},
    "two": {"tolerance": None, "substeps": 2},
    "1e-6": {"tolerance": 1e-6},
}
LANES, INTERVALS = 21, 20


def motion(scene, q, qd, efforts):
    """Bits of the states after each interval, and the evaluations that these took."""
    batch, found = advanced(scene, q, qd, intervals=0)[0], []
    for k in range(INTERVALS):
        status = batch.advance((-1.0) ** k * efforts)
        found += [batch.q.tobytes(), batch.qd.tobytes(), status.evaluations.tobytes()]
    return found


@pytest.mark.quick("CentringSpring-one rk8 step")
@pytest.mark.parametrize("how", HOW.values(), ids=HOW)
@pytest.mark.parametrize("name", [name for name, entry in ENTRIES.items() if entry.zero is not None])
def test_a_motion_has_the_same_bits_without_an_effect_and_with_one_of_zero_magnitude(name, how):
    entry = ENTRIES[name]
    zero, without = (dataclasses.replace(s, **how) for s in cost.alone(entry.arm, entry.zero))
    q, qd, efforts = random_states(without, LANES, 0)
    start = q, qd, efforts + np.random.default_rng(0).normal(0.0, 10.0, efforts.shape)
    expected = motion(without, *start)
    assert motion(zero, *start) == expected
    assert motion(alone(name, **how), *start) != expected


# ---- its numbers -------------------------------------------------------------------------------------

NO_NUMBERS = (math.nan, -math.inf, 10**400, "1.0", b"1", True, 1j, {})
STRENGTHS = (not_negative, positive, strengths)
NUMBER = r"-?\d[\d.]*(?:e-?\d+)?"


def usual(field):
    """A value that is allowed: that of the example, or the default."""
    kind, f = FIELDS[field]
    return example_of(kind).numbers.get(f.name, f.default)


def made(field, value):
    """The example of an effect with another value."""
    kind, f = FIELDS[field]
    return kind(**{**example_of(kind).numbers, f.name: value})


def allowed(field):
    """What the class of the effect says of a number."""
    kind, f = FIELDS[field]
    return described(kind)[f.name]


def beyond(field):
    """Numbers beyond the bounds that a class states, and beyond the largest strength."""
    text, strong = allowed(field), FIELDS[field][1].metadata[DECLARED].check in STRENGTHS
    low, high = re.search(rf"({NUMBER}) to ({NUMBER})|$", text).groups()
    least, most = (re.search(rf"{word} ({NUMBER})|$", text)[1] for word in ("at least", "positive, at most"))
    low, high = low or least, high or most or ("1e100" if strong else None)
    if re.search("not negative|positive", text):
        low = "0"
    elif strong and not low:
        low = "-1e100"
    found = [0.0] if re.search("positive", text) else []
    found += [float(low) - 0.01 * abs(float(low)) or -0.1] if low else []
    return found + ([1.01 * float(high)] if high else [])


def wrong_values(field):
    """Values of a wrong form, and such as are beyond its bounds."""
    value, form = usual(field), FIELDS[field][1].metadata[DECLARED].form
    wrong = [*NO_NUMBERS, *beyond(field)]
    if isinstance(value, bool):
        wrong = [1, "yes"]
    elif isinstance(value, str):
        wrong = [3, "a b", "a.b"]
    elif isinstance(value, int):
        wrong = [0, 1.5, True, "1"]
    elif isinstance(value, tuple) and isinstance(value[0], str):
        wrong = ["joint1"]
    elif isinstance(value, tuple):
        wrong = [*((*value[:-1], x) for x in wrong), *NO_NUMBERS]
    else:
        wrong += [(value, value)] if form is number else [(value, x) for x in wrong]
    if form in (two, of_axes):
        wrong += [(0.5,), (0.5, 0.5, 0.5)]
    return wrong if FIELDS[field][1].default is None else [*wrong, None]


@pytest.mark.parametrize("field", FIELDS)
def test_a_declared_number_is_refused_what_it_cannot_be(field):
    assert made(field, usual(field))
    for value in wrong_values(field):
        with pytest.raises(ValueError, match=rf"^{re.escape(field)}(\[\d+\])? (is|has) ") as error:
            made(field, value)
        assert short(str(error.value))


@pytest.mark.parametrize("field", OF_JOINTS)
def test_one_number_serves_all_joints_and_other_counts_than_theirs_are_refused(field):
    name, value = field.partition(".")[2], usual(field)
    one = value[0] if isinstance(value, tuple) else value or 0.0
    (effect,) = rde.Scene(FOUR_R, (made(field, one),)).effects
    assert getattr(effect, name) == (one,) * 4
    with pytest.raises(
        ValueError, match=rf"{field} has 3 entries; FourR has 4 joints: give 4 numbers, or one"
    ):
        rde.Scene(FOUR_R, (made(field, (one,) * 3),))


def test_bounds_in_the_words_of_classes_are_read():
    assert {field for field in FIELDS if beyond(field)} >= {*OF_JOINTS} - {"LuGre.stiction"}
    assert beyond("SensorNoise.position") == [-0.1, 1.01e100]
    assert beyond("Lag.time_constant") == [0.0, -0.1, 1.01e100]
    assert beyond("TipForce.step") == [-1.01e100, 1.01e100]
    assert beyond("JointStop.restitution") == [-0.1, 1.01]
    assert beyond("Gravity.down") == []


@pytest.mark.parametrize("name", NAMED)
def test_several_effects_of_a_kind_have_names_and_numbers_of_their_own(name):
    effect = ENTRIES[name].effect
    left = dataclasses.replace(effect, name="left")
    parameters = rde.Scene(ENTRIES[name].arm.robot, (effect, left)).parameters()
    for own in effect.parameters():
        assert parameters[f"{effect.key}.{own}"] == parameters[f"{left.key}.{own}"]
    with pytest.raises(
        ValueError, match=f"second '{effect.key}'; combine the two, or give one of them another 'name'"
    ):
        rde.Scene(ENTRIES[name].arm.robot, (effect, copy.copy(effect)))


@dataclasses.dataclass(frozen=True)
class SlowLag(e.Lag):
    time_constant: float = 0.03


def test_a_class_that_gives_a_number_another_default_keeps_its_check_and_unit():
    with pytest.raises(ValueError, match=r"SlowLag\.time_constant is 0"):
        SlowLag(0.0)
    assert SlowLag(1).time_constant == 1.0
    assert SlowLag().units(FOUR_R) == e.Lag(0.03).units(FOUR_R)
