"""Every number that an effect of the package declares refuses what it cannot be: a new effect's, too.

What has a wrong form is refused, and what is beyond the bounds that the page of the effect states.
"""

import dataclasses
import math
import re
from pathlib import Path

import pytest
from catalogue import FOUR_R
from refusals import short

import redundant_envs as rde
from redundant_envs.effects import OWN
from redundant_envs.effects.hooks import snake_case
from redundant_envs.effects.numbers import DECLARED, example_of, of_axes, two
from redundant_envs.robots.parameters import number

PAGES = Path(__file__).parents[2] / "docs" / "effects"
FIELDS = {
    f"{name}.{f.name}": (kind, f)
    for name, kind in OWN.items()
    for f in dataclasses.fields(kind)
    if DECLARED in f.metadata
}
OF_JOINTS = [name for name, (_, f) in FIELDS.items() if f.metadata[DECLARED].of_joints]
NO_NUMBERS = (math.nan, -math.inf, 10**400, "1.0", b"1", True, 1j, {})
NUMBER = r"-?\d[\d.]*(?:e-?\d+)?"


def usual(field):
    """A value that is allowed: that of the example, or the default."""
    kind, f = FIELDS[field]
    return example_of(kind).numbers.get(f.name, f.default)


def made(field, value):
    """The example of an effect with another value."""
    kind, f = FIELDS[field]
    return kind(**{**example_of(kind).numbers, f.name: value})


def refused(field, value):
    with pytest.raises(ValueError, match=rf"^{re.escape(field)}(\[\d+\])? (is|has) ") as error:
        made(field, value)
    assert short(str(error.value))


def allowed(field):
    """What a page says that a field may be."""
    kind, f = FIELDS[field]
    page = (PAGES / f"{snake_case(kind.__name__)}.md").read_text(encoding="utf-8")
    (cell,) = re.findall(rf"^\| `{f.name}\b.*? \| [^|]*\| ([^|]*) \|$", page, re.M)
    return cell.partition(";")[0]


def beyond(text):
    """Numbers beyond the bounds that a page states."""
    between = re.match(rf"({NUMBER}) to ({NUMBER})?", text)
    most = re.search(rf"(?:at most|up to) ({NUMBER})( in size)?", text)
    low, high = between.groups() if between else (None, most and most[1])
    if most and most[2]:
        low = f"-{high}"
    elif re.match("not negative|0 and more|positive|above 0", text):
        low = "0"
    found = [0.0] if re.match("positive|above 0", text) else []
    found += [float(low) - 0.01 * abs(float(low)) or -0.1] if low else []
    return found + ([1.01 * float(high)] if high else [])


@pytest.mark.parametrize("field", FIELDS)
def test_a_declared_number_is_refused_what_it_cannot_be(field):
    declared, value = FIELDS[field][1].metadata[DECLARED], usual(field)
    assert made(field, value)
    if isinstance(value, bool):
        wrong = [1, "yes"]
    elif isinstance(value, str):
        wrong = [3, "a b", "a.b"]
    elif isinstance(value, int):
        wrong = [0, 1.5, True, "1"]
    elif isinstance(value, tuple) and isinstance(value[0], str):
        wrong = ["joint1"]
    elif isinstance(value, tuple):
        wrong = [*((*value[:-1], x) for x in (*NO_NUMBERS, *beyond(allowed(field)))), *NO_NUMBERS]
    else:
        wrong = [*NO_NUMBERS, *beyond(allowed(field))]
        wrong += [(value, value)] if declared.form is number else [(value, x) for x in wrong]
    if declared.form in (two, of_axes):
        wrong += [(0.5,), (0.5, 0.5, 0.5)]
    for other in (*wrong, *([] if FIELDS[field][1].default is None else [None])):
        refused(field, other)


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


def test_bounds_of_pages_are_read():
    assert {field for field in FIELDS if beyond(allowed(field))} >= {*OF_JOINTS} - {"LuGre.stiction"}
    assert beyond("0 to 1e100; absent by default") == [-0.1, 1.01e100]
    assert beyond("positive, at most 1e100") == [0.0, -0.1, 1.01e100]
    assert beyond("any, up to 2 in size") == [-2.02, 2.02]
    assert beyond("any") == []


@dataclasses.dataclass(frozen=True)
class SlowLag(rde.effects.Lag):
    time_constant: float = 0.03


@dataclasses.dataclass(frozen=True)
class Started(rde.effects.Effect):
    """An effect as users write them: a number that the start alone takes, names and notes of their own."""

    k: dataclasses.InitVar[int] = 3
    example: float = dataclasses.field(default=2.0, metadata={"declared": "by me"})


class Doubled:
    def __post_init__(self):
        object.__setattr__(self, "c", 2.0 * self.c)


@dataclasses.dataclass(frozen=True)
class Mixed(rde.effects.Effect, Doubled):
    c: float = 0.5


def test_a_class_that_gives_a_number_another_default_keeps_its_check_and_unit():
    with pytest.raises(ValueError, match=r"SlowLag\.time_constant is 0"):
        SlowLag(0.0)
    assert SlowLag(1).time_constant == 1.0
    assert SlowLag().units(FOUR_R) == rde.effects.Lag(0.03).units(FOUR_R)


def test_effects_of_users_may_be_started_their_own_way():
    assert Started(5).example == 2.0
    assert Mixed().c == 1.0
