"""Ranges of numbers: each distribution has its quantiles, and what is no range is refused with the fix."""

import dataclasses
import math
from statistics import NormalDist

import numpy as np
import pytest
import yaml
from catalogue import FOUR_R, RPRP, SCENES

import redundant_envs as rde
from redundant_envs.scenes.ranges import KINDS, distribution

e = rde.effects
DRAWS = (np.arange(20000) + 0.5) / 20000
EFFECTS = (
    e.Gravity(), e.ViscousFriction(0.1), e.EffortLimits(20.0), e.PrismaticStop((0.0, None), (0.3, 0.3)),
    e.LimitSpring("joint1", -2.0, -1.0), e.MotorBrake(0, 0.1),
)  # fmt: skip
ALL_FORMS = {
    "masses": {"scale": {"log_uniform": [0.8, 1.25]}, "shared": True},
    "gravity.g": {"normal": [9.81, 0.1], "within": [9.0, 10.0]},
    "effort_limits.limits": {"scale": {"uniform": [0.5, 1.0]}},
    "viscous_friction.coefficients[2]": {"choice": [0.0, 0.01, 0.03]},
}


def drawn(data):
    """Numbers of a distribution at equally spaced draws, which are its quantiles."""
    one = distribution("range", data)
    return one.formula(DRAWS, *one.numbers().values())


def scene(randomize):
    return rde.Scene(RPRP, EFFECTS, randomize=randomize)


def test_numbers_and_logarithms_have_the_quantiles_of_their_draws():
    np.testing.assert_allclose(drawn({"uniform": [-1.0, 3.0]}), -1.0 + 4.0 * DRAWS, rtol=0, atol=1e-14)
    logarithms = np.log(drawn({"log_uniform": [1e-3, 1e3]}))
    np.testing.assert_allclose(logarithms, math.log(1e3) * (2.0 * DRAWS - 1.0), rtol=0, atol=1e-13)
    values, counts = np.unique(drawn({"choice": [0.03, 0.0, 0.01]}), return_counts=True)
    np.testing.assert_array_equal(values, [0.0, 0.01, 0.03])
    assert max(counts) - min(counts) <= 1
    pair, bounded = [1, 2], {"normal": [1, 1], "within": [0, 1]}
    forms = {"uniform": pair}, {"log_uniform": pair}, bounded, {"choice": pair}
    assert tuple(distribution("range", data).kind for data in forms) == KINDS


@pytest.mark.parametrize(
    "within", [(-6.0, 6.0), (-1.0, 2.0), (3.0, 4.0), (-4.5, -3.0), (4.7, 9.0), (-30.0, 0.0)]
)
def test_a_normal_number_has_the_quantiles_of_the_normal_distribution_without_what_is_outside(within):
    """No number is moved to an end: the shares between the ends grow by one factor."""
    mean, deviation, normal = 2.0, 0.5, NormalDist()
    low, high = (mean + deviation * end for end in within)
    found = drawn({"normal": [mean, deviation], "within": [low, high]})
    mirrored = within[0] > 0.0  # the upper tail of a distribution function has lost its digits
    first, last = (-within[1], -within[0]) if mirrored else within
    shares = 1.0 - DRAWS if mirrored else DRAWS
    below = normal.cdf(first) + shares * (normal.cdf(last) - normal.cdf(first))
    expected = np.array([normal.inv_cdf(share) for share in below]) * (-1.0 if mirrored else 1.0)
    np.testing.assert_allclose((found - mean) / deviation, expected, rtol=2e-9, atol=2e-9)
    assert ((found > low) & (found < high)).all()


@pytest.mark.parametrize(
    "data",
    [
        {"uniform": [9.0, 9.0 + 4e-15]}, {"log_uniform": [1.0, 1.0 + 1e-15]},
        {"normal": [1.0, 1e-3], "within": [1.0, 1.0 + 1e-7]}, {"uniform": [-1e100, 1e100]},
    ],
)  # fmt: skip
def test_no_rounding_passes_an_end(data):
    one = distribution("range", data)
    draws = np.array([2.0**-33, *DRAWS, 1.0 - 2.0**-33])
    found = one.formula(draws, *one.numbers().values())
    assert ((found >= one.ends[0]) & (found <= one.ends[1])).all()


def test_a_scene_with_ranges_is_plain_data_and_comes_back_equal(tmp_path):
    one = scene(ALL_FORMS)
    assert one.to_dict()["randomize"] == ALL_FORMS
    file = tmp_path / "scene.yaml"
    file.write_text(yaml.safe_dump(one.to_dict()))
    for again in (rde.Scene.from_dict(one.to_dict()), rde.load_scene(file)):
        assert again == one
        assert hash(again) == hash(one)
    for none in (None, {}):
        assert scene(none) == rde.Scene(RPRP, EFFECTS)
        assert "randomize" not in scene(none).to_dict()


STOPPED = {
    "joints without ends": (e.JointStop((None, -1.0, None, None), (None, 2.0, 1.0, None), 0.5),),
    "two tendons": tuple(e.Tendon(("joint1", "joint2"), (0.04, -0.05), 3e3, name=n) for n in ("", "flexor")),
}
"""Effects with entries that are no numbers, and two of a kind, of which one has no name."""


@pytest.mark.parametrize("name", [*SCENES, *STOPPED])
def test_every_number_of_every_effect_can_be_drawn(name):
    """Its own one: a lane's numbers are checked by building the effect with them."""
    scene = SCENES[name] if name in SCENES else rde.Scene(FOUR_R, STOPPED[name])
    drawn = {p: {"choice": [x]} for p, x in scene.parameters().items() if "." in p and math.isfinite(x)}
    dataclasses.replace(scene, randomize=drawn)


SPRING, STOP, FRICTION = "limit_spring.joint1", "prismatic_stop", "viscous_friction.coefficients"
REFUSED = [
    ("randomize is 3; give a mapping of names to ranges", 3),
    ("gravity.g'] is 3; give one, such as", {"gravity.g": 3}),
    ("'gravity.x'; this scene has masses", {"gravity.x": {"uniform": [0, 1]}}),
    ("unknown key 'triangle'; valid: uniform", {"gravity.g": {"triangle": [0, 1]}}),
    ("has uniform and choice; give one", {"gravity.g": {"uniform": [0, 1], "choice": [1]}}),
    ("uniform is 2.0 to 2.0; give a smaller and a larger", {"gravity.g": {"uniform": [2, 2]}}),
    (r"uniform\[0\] is 'a'; give a finite number", {"gravity.g": {"uniform": ["a", 2]}}),
    ("both ends must be positive", {"masses": {"log_uniform": [0, 1]}}),
    ("standard deviation 0.0; it must be positive", {"gravity.g": {"normal": [9, 0], "within": [8, 9]}}),
    ("has 65 values; give 1 to 64", {"gravity.g": {"choice": list(range(65))}}),
    ("has 1.0 more than once", {"gravity.g": {"choice": [1, 1]}}),
    ("shared is 1; give True, or leave it out", {"masses": {"uniform": [1, 2], "shared": 1}}),
    ("put the others into scale", {"masses": {"scale": {"uniform": [1, 2]}, "uniform": [1, 2]}}),
    (r"coefficients\[1\] twice", {FRICTION: {"uniform": [0, 1]}, f"{FRICTION}[1]": {"uniform": [0, 1]}}),
    # numbers that a fixed number may not be
    (r"coefficients\[0\] is -1.0; it must not", {FRICTION: {"uniform": [-1, 1]}}),
    ("entry -2.0; it must be pos", {"masses": {"scale": {"uniform": [-1, 1]}}}),
    ("restitution is 2.0; it must lie in 0 to 1", {f"{STOP}.restitution": {"choice": [0, 2, 1]}}),
    (
        "LimitSpring.lower is 1.0, upper is 0.5; lower must be below",
        {f"{SPRING}.lower": {"uniform": [0, 1]}, f"{SPRING}.upper": {"uniform": [0.5, 1]}},
    ),
    (
        r"lower\[0\] is 0.2, upper\[0\] is 0.1",  # one draw serves all entries
        {
            f"{STOP}.{end}": {"uniform": [low, 0.2], "shared": True}
            for end, low in (("lower", 0), ("upper", 0.1))
        },
    ),
    (
        "lower is -2.0, upper is -3.0; lower must be below",  # a larger factor of a negative number
        {f"{SPRING}.lower": {"uniform": [-4, -2]}, f"{SPRING}.upper": {"scale": {"uniform": [0.5, 3]}}},
    ),
    ("MotorBrake.joint is 1.1459; give a joint", {"motor_brake.joint": {"uniform": [0, 3]}}),
    ("MotorBrake.joint is 4; give 0 to 3", {"motor_brake.joint": {"choice": [0, 4, 1]}}),
    ("spans a ratio of 1.0e[+]14", {"masses": {"log_uniform": [1e-7, 1e7]}}),
]


@pytest.mark.parametrize(("words", "data"), REFUSED, ids=[words for words, _ in REFUSED])
def test_what_is_no_range_or_draws_what_is_refused(words, data):
    with pytest.raises(ValueError, match=words) as error:
        scene(data)
    assert "randomize" in str(error.value)
    assert len(str(error.value)) < 500


def test_ends_that_touch_in_no_draw_and_numbers_of_a_task_are_allowed():
    numbers = {f"{SPRING}.lower": {"uniform": [3, 4]}, f"{SPRING}.upper": {"uniform": [5, 6]}}
    numbers["goal_tolerance"] = {"uniform": [0.01, 0.03]}  # which a scene does not know
    assert {r.name for r in scene(numbers).randomize} == {*numbers}
