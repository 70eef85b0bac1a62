"""Ranges of numbers: each distribution has its quantiles, and what is no range is refused with the fix."""

import dataclasses
import math
from statistics import NormalDist

import numpy as np
import pytest
import yaml
from catalogue import FOUR_R, SCENES

import redundant_envs as rde
from redundant_envs.scenes.ranges import KINDS, distribution, plain, ranges

e = rde.effects
DRAWS = (np.arange(20000) + 0.5) / 20000
ARM = rde.RPRP((2.0, 1.5, 1.0, 0.5), (0.3, 0.5))
EFFECTS = (
    e.Gravity(), e.ViscousFriction(0.1), e.EffortLimits(20.0), e.PrismaticStop((0.0, None), (0.3, 0.3)),
    e.LimitSpring("joint1", -2.0, 2.0),
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
    return rde.Scene(ARM, EFFECTS, randomize=randomize)


# ---- distributions ---------------------------------------------------------------------------------------


def test_a_uniform_number_has_the_quantiles_of_its_draws():
    np.testing.assert_allclose(drawn({"uniform": [-1.0, 3.0]}), -1.0 + 4.0 * DRAWS, rtol=0, atol=1e-14)


def test_the_logarithm_of_a_log_uniform_number_is_uniform():
    found = np.log(drawn({"log_uniform": [1e-3, 1e3]}))
    np.testing.assert_allclose(found, math.log(1e3) * (2.0 * DRAWS - 1.0), rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    "within", [(-6.0, 6.0), (-1.0, 2.0), (-0.5, -0.4), (3.0, 4.0), (-4.5, -3.0), (4.7, 9.0), (-30.0, 0.0)]
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
    assert (found > low).all()
    assert (found < high).all()


def test_the_values_of_a_choice_are_equally_frequent():
    values, counts = np.unique(drawn({"choice": [0.03, 0.0, 0.01]}), return_counts=True)
    np.testing.assert_array_equal(values, [0.0, 0.01, 0.03])
    assert max(counts) - min(counts) <= 1


@pytest.mark.parametrize(
    "data",
    [
        {"uniform": [9.0, 9.0 + 4e-15]}, {"log_uniform": [1.0, 1.0 + 1e-15]},
        {"normal": [1.0, 1e-3], "within": [1.0, 1.0 + 1e-7]}, {"uniform": [-1e100, 1e100]},
    ],
)  # fmt: skip
def test_no_rounding_passes_an_end(data):
    one = distribution("range", data)
    low, high = one.ends
    ends = np.array([2.0**-33, 1.0 - 2.0**-33])
    found = one.formula(np.concatenate([ends, DRAWS]), *one.numbers().values())
    assert (found >= low).all()
    assert (found <= high).all()


# ---- plain data ------------------------------------------------------------------------------------------


def test_a_scene_with_ranges_is_plain_data_and_comes_back_equal(tmp_path):
    one = scene(ALL_FORMS)
    assert one.to_dict()["randomize"] == ALL_FORMS
    file = tmp_path / "scene.yaml"
    file.write_text(yaml.safe_dump(one.to_dict()))
    for again in (rde.Scene.from_dict(one.to_dict()), rde.load_scene(file)):
        assert again == one
        assert hash(again) == hash(one)
    assert ranges(one.randomize) == one.randomize
    assert plain(one.randomize) == ALL_FORMS


@pytest.mark.parametrize("none", [None, {}])
def test_a_scene_without_ranges_is_the_one_that_has_no_such_argument(none):
    assert scene(none) == rde.Scene(ARM, EFFECTS)
    assert "randomize" not in scene(none).to_dict()


@pytest.mark.long
def test_simulations_use_the_numbers_of_the_scene_and_run_the_same_program():
    one, fixed = scene(ALL_FORMS), scene(None)
    assert rde.listing(one) == rde.listing(fixed)
    assert rde.bill(one) == rde.bill(fixed)
    motions = [rde.simulate(s, (1.0, 0.1, 0.2, 0.1), (0.0,) * 4, [0.1]) for s in (one, fixed)]
    np.testing.assert_array_equal(motions[0].q, motions[1].q)
    assert motions[0].without_springs is None  # no spring is reached: the energy of gravity is all


# ---- errors ----------------------------------------------------------------------------------------------

REFUSED = {
    "no mapping": (3, "randomize is 3; give a mapping of names to ranges"),
    "no name": ({3: {"uniform": [0, 1]}}, "has the key 3; give names"),
    "no range": ({"gravity.g": 3}, "gravity.g'] is 3; give one, such as"),
    "a range of an unknown number": (
        {"gravity.x": {"uniform": [0, 1]}}, "'gravity.x'; this scene has masses",
    ),
    "an unknown kind": ({"gravity.g": {"triangle": [0, 1]}}, "unknown key 'triangle'; valid: uniform"),
    "no kind": ({"gravity.g": {}}, "has no distribution; give one of uniform, log_uniform, normal, choice"),
    "two kinds": ({"gravity.g": {"uniform": [0, 1], "choice": [1]}}, "has uniform and choice; give one"),
    "an empty range": ({"gravity.g": {"uniform": [2, 2]}}, "uniform is 2.0 to 2.0, which is empty"),
    "a reversed range": ({"gravity.g": {"uniform": [2, 1]}}, "uniform is 2.0 to 1.0, which is reversed"),
    "reversed ends": (
        {"gravity.g": {"normal": [1, 1], "within": [2, 1]}}, "within is 2.0 to 1.0, which is rev",
    ),
    "one end": ({"gravity.g": {"uniform": [2]}}, "give two numbers, the least and the largest"),
    "no numbers": ({"gravity.g": {"uniform": ["a", 2]}}, r"uniform\[0\] is 'a'; give a finite number"),
    "an infinite end": ({"gravity.g": {"uniform": [0, math.inf]}}, r"uniform\[1\] is inf; give a finite"),
    "a logarithm of 0": ({"masses": {"log_uniform": [0, 1]}}, "both ends must be positive"),
    "a normal without ends": ({"gravity.g": {"normal": [9, 1]}}, "normal without ends; give 'within'"),
    "a normal without width": (
        {"gravity.g": {"normal": [9, 0], "within": [8, 9]}}, "standard deviation 0.0; it must be positive",
    ),
    "a normal far away": (
        {"gravity.g": {"normal": [0, 1], "within": [8, 9]}}, "6e-16 of its draws; give ends",
    ),
    "no values": ({"gravity.g": {"choice": []}}, "has 0 values; give 1 to 64"),
    "too many values": ({"gravity.g": {"choice": list(range(65))}}, "has 65 values; give 1 to 64"),
    "a value twice": ({"gravity.g": {"choice": [1, 1]}}, "has 1.0 more than once"),
    "no truth": ({"masses": {"uniform": [1, 2], "shared": 1}}, "shared is 1; give True, or leave it out"),
    "a factor and a number": (
        {"masses": {"scale": {"uniform": [1, 2]}, "uniform": [1, 2]}}, "put uniform into scale",
    ),
    "a factor of nothing": ({"masses": {"scale": 2}}, "scale is 2; give one, such as"),
    "an entry of two ranges": (
        {
            "viscous_friction.coefficients": {"uniform": [0, 1]},
            "viscous_friction.coefficients[1]": {"uniform": [0, 1]},
        },
        r"draws viscous_friction.coefficients\[1\] twice",
    ),
    # numbers that a fixed number may not be
    "an end that an effect refuses": (
        {"viscous_friction.coefficients": {"uniform": [-1, 1]}}, r"coefficients\[0\] is -1.0; it must not",
    ),
    "an end that the arm refuses": ({"masses": {"uniform": [0, 1]}}, "entry 0.0; it must be positive"),
    "a factor that makes it so": ({"masses": {"scale": {"uniform": [-1, 1]}}}, "entry -2.0; it must be pos"),
    "a value that an effect refuses": (
        {"prismatic_stop.restitution": {"choice": [0, 2, 1]}}, "restitution is 2.0; it must lie in 0 to 1",
    ),
    "ends that cross": (
        {
            "limit_spring.joint1.lower": {"uniform": [0, 1]},
            "limit_spring.joint1.upper": {"uniform": [0.5, 1]},
        },
        "LimitSpring.lower is 1.0, upper is 0.5; lower must be below",
    ),
    "ends that cross where one draw serves all entries": (
        {
            "prismatic_stop.lower": {"uniform": [0, 0.2], "shared": True},
            "prismatic_stop.upper": {"uniform": [0.1, 0.3], "shared": True},
        },
        r"lower\[0\] is 0.2, upper\[0\] is 0.1; lower must be below",
    ),
    "an end beyond a fixed one": ({"limit_spring.joint1.lower": {"uniform": [0, 2]}}, "lower must be below"),
    "masses too far apart": ({"masses": {"log_uniform": [1e-7, 1e7]}}, "spans a ratio of 1.0e[+]14"),
    "a factor of no stop": (
        {"prismatic_stop.lower": {"scale": {"uniform": [1, 2]}}}, "is -inf, and a factor",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_range_or_draws_what_is_refused(name):
    data, words = REFUSED[name]
    with pytest.raises(ValueError, match=words) as error:
        scene(data)
    assert "randomize" in str(error.value)
    assert len(str(error.value)) < 500


def test_ends_that_cross_where_all_draws_are_large_are_refused():
    """A larger factor of a negative number is a lower end."""
    numbers = {
        "limit_spring.joint1.lower": {"uniform": [-4, -2]},
        "limit_spring.joint1.upper": {"scale": {"uniform": [0.5, 3]}},
    }
    with pytest.raises(ValueError, match=r"lower is -2.0, upper is -3.0; lower must be below"):
        rde.Scene(ARM, (e.LimitSpring("joint1", -2.0, -1.0),), randomize=numbers)


def test_ends_that_touch_in_no_draw_are_allowed():
    one = scene(
        {"limit_spring.joint1.lower": {"uniform": [3, 4]}, "limit_spring.joint1.upper": {"uniform": [5, 6]}}
    )
    assert [r.name for r in one.randomize] == ["limit_spring.joint1.lower", "limit_spring.joint1.upper"]


def test_a_number_of_a_task_is_not_known_to_a_scene_and_allowed():
    assert scene({"goal_tolerance": {"uniform": [0.01, 0.03]}}).randomize[0].name == "goal_tolerance"


def test_the_list_of_kinds_has_all_of_them():
    forms = (
        {"uniform": [1, 2]},
        {"log_uniform": [1, 2]},
        {"normal": [1, 1], "within": [0, 1]},
        {"choice": [1]},
    )
    assert tuple(distribution("range", data).kind for data in forms) == KINDS


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
