"""Arms, scenes, trajectories and bills in a notebook: small HTML with escaped texts, whatever they hold."""

import re
from dataclasses import dataclass
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.effects import Effect, Force
from redundant_envs.language.algebra import physics
from redundant_envs.model.listing import Bill, Operations
from redundant_envs.model.trajectory import Trajectory
from redundant_envs.scenes.scene import scene_names
from redundant_envs.support.notebook import LONGEST_CELL, MAX_BYTES, MAX_ROWS

e = rde.effects
HOSTILE = "<script>alert('1')</script>&\"<b>"
FOUR_R = rde.FourR((2.0, 1.5, 1.0, 0.5), (0.3, 0.5, 0.4, 0.6))
RPRP = rde.RPRP((2.0, 1.5, 1.0, 0.5), (0.3, 0.5))


class Page(NamedTuple):
    tags: list
    cells: list
    """Texts."""


def page(thing):
    """What a notebook shows: never an error, small, closed, without scripts, files, calls, and names that
    may collide with those of other objects."""
    text = thing._repr_html_()
    assert len(text.encode()) <= MAX_BYTES
    elements = [*ElementTree.fromstring(text).iter()]
    tags = [x.tag.rpartition("}")[2] for x in elements]
    assert {"script", "img", "b"}.isdisjoint(tags)
    assert not [name for x in elements for name in x.attrib if name == "id" or name.startswith("on")]
    assert "http" not in text.replace('xmlns="http://www.w3.org/2000/svg"', "")
    assert "nan" not in re.sub(r">[^<]*<", "", text)
    return Page(tags, [x.text for x in elements if x.text and x.tag != "style"])


def motion(arm, q, t):
    """A trajectory whose numbers are made up."""
    zero, rest = np.zeros(np.shape(q)), np.zeros(np.shape(q)[:-1])
    return Trajectory(np.asarray(t, float), q, zero, rest, rest, rest, zero, rde.Scene(arm))


@pytest.mark.parametrize(
    "arm",
    [
        FOUR_R, RPRP, rde.Chain("P", (1.0,)), rde.Chain("RPRPRRRPRR", (1.0,) * 10, (0.3,) * 7),
        rde.Chain("R" * 10, (1e-30,) * 10, (1e-30,) * 10), rde.Chain("RRP", (1e30, 1e18, 1e20), (1e30, 1e18)),
    ],
    ids=lambda arm: "".join("RP"[slides] for slides in arm.prismatic),
)  # fmt: skip
def test_an_arm_is_drawn_with_its_names_and_numbers(arm):
    found = page(arm)
    assert "svg" in found.tags
    assert "pre" not in found.tags
    assert {*arm.coordinates} <= {*found.cells}
    assert ", ".join(f"{m:.6g}" for m in arm.masses) in found.cells


def test_the_links_of_a_drawing_have_the_lengths_of_the_arm():
    text = FOUR_R._repr_html_()
    data = re.search(r'<path d="(M[^"]*L[^"]*)"', text)[1]
    points = np.array([[float(x) for x in pair.split()] for pair in re.split("[ML]", data)[1:]])
    drawn = np.hypot(*np.diff(points, axis=0).T)
    np.testing.assert_allclose(drawn / drawn.sum(), np.array(FOUR_R.lengths) / sum(FOUR_R.lengths), atol=2e-3)


@dataclass(frozen=True)
class Hostile(rde.FourR):
    kind = HOSTILE


push = physics(lambda size: size)


@dataclass(frozen=True)
class Push(Effect):
    size: float
    name: str = "a"
    static = ("name",)

    @property
    def key(self):
        return f"push.{self.name}"

    def units(self, arm):
        return {"size": HOSTILE}

    def hooks(self, arm):
        return (Force(0, push, {"size": ".size"}),)


def test_texts_of_users_are_escaped():
    arm = Hostile(FOUR_R.masses, FOUR_R.lengths)
    found = page(rde.Scene(arm, (Push(1.5),)))
    assert found.cells.count(HOSTILE) == 2  # of the arm, and a unit
    for thing in (arm, motion(arm, np.zeros((3, 4)), [0.0, 1.0, 2.0]), Bill({HOSTILE: Operations()})):
        assert HOSTILE in page(thing).cells


def test_a_scene_has_its_effects_with_units_and_how_it_is_stepped():
    effects = e.Gravity(), e.EffortLimits((20.0, 32.0, 8.0, 16.0)), e.PrismaticStop((0, 0), (0.2, np.inf))
    ranges = {"gravity.g": {"uniform": [9, 10]}}
    found = page(rde.Scene(RPRP, effects, tolerance=1e-6, randomize=ranges))
    steps, drawn = "1e-06 m at the tip", "{'uniform': [9.0, 10.0]}"
    assert {"m/s^2", "20, 32, 8, 16", "N m, N", "0.2, inf", "rk8", steps, drawn} <= {*found.cells}
    assert "pre" not in found.tags
    assert "0.1 each" in page(rde.Scene(FOUR_R, (e.ViscousFriction(0.1),))).cells
    for name in scene_names():
        assert "svg" in page(rde.load_scene(name)).tags


def test_of_what_is_too_long_the_first_rows_are_shown_or_the_text():
    found = page(rde.Scene(FOUR_R, tuple(Push(1.0, f"{'a' * 300}{k}") for k in range(100))))
    assert f"... and {100 - MAX_ROWS} more" in found.cells
    assert found.cells.count("size") == MAX_ROWS
    assert max(map(len, found.cells)) <= LONGEST_CELL
    assert page(Bill({f"{'&' * 99}{k}": Operations(*["&" * 100] * 8) for k in range(100)})).tags == ["pre"]


def test_a_trajectory_shows_its_last_pose_and_the_way_of_its_tip():
    t = np.linspace(0.0, 4.0, 401)
    text = motion(FOUR_R, 0.2 * t[:, None] * np.ones(4), t)._repr_html_()
    way, links, *_ = re.findall(r'<path d="M([^"]*)"', text)
    assert way.count("L") == 299
    assert way.rpartition("L")[2] == links.rpartition("L")[2]


@pytest.mark.parametrize(
    ("q", "t", "drawn"),
    [
        (np.zeros((1, 4)), [0.0], True),
        (np.zeros((0, 4)), [], False),
        (np.full((3, 4), np.nan), [0.0, 1.0, 2.0], False),
        (np.array([[0.1] * 4, [np.nan] * 4, [np.inf] * 4]), [0.0, 1.0, 2.0], True),
        (np.full((3, 4), 1e300), [0.0, 1.0, 2.0], True),
        (np.zeros((3, 4)), [0.0, np.nan, np.inf], True),
        (np.zeros((3, 2, 3, 4)), [0.0, 1.0, 2.0], True),
        (np.random.default_rng(0).uniform(-9.0, 9.0, (5000, 30, 4)), np.arange(5000.0), True),
    ],
    ids=["one", "none", "nan", "fault", "huge", "times", "batch", "long"],
)
def test_a_trajectory_is_shown_whatever_it_holds(q, t, drawn):
    assert ("svg" in page(motion(RPRP, q, t)).tags) == drawn


def test_a_bill_is_a_dict_that_is_shown_as_a_table():
    found = rde.bill(rde.Scene(FOUR_R, (e.Gravity(),), "rk4"))
    assert repr(found) == repr(dict(found))
    assert {"gravity", "sine pairs", str(found["arm"].additions)} <= {*page(found).cells}
