"""Lanes: declared fields and no others, reading and setting them, on plain and on traced numbers."""

import numpy as np
import pytest
from catalogue import SCENES

import redundant_envs as rde
from redundant_envs.model.programs import batch_simulator, environment_simulator
from redundant_envs.simulator.lane.fields import LOG, PARAMETER, SCRATCH, STATE, Layout, Variable
from redundant_envs.simulator.lane.memory import Lane
from redundant_envs.tasks.reach import ReachTask

LAYOUT = Layout(
    [
        Variable("q", "rad", "an angle", STATE),
        Variable("q_start", "rad", "the angle before", SCRATCH),
        Variable("mass", "kg", "of the link", PARAMETER),
        Variable("resting", "", "has no speed", SCRATCH, truth=True),
        Variable("v", "rad/s", "its rate", STATE),
        Variable("v_start", "rad/s", "the rate before", SCRATCH),
        Variable("time", "s", "of an event", LOG),
    ]
)
NUMBERS = {"q": 1.0, "q_start": 2.0, "mass": 3.0, "resting": 1.0, "v": 5.0, "v_start": 6.0, "time": 7.0}


@pytest.fixture
def lane():
    return Lane(LAYOUT, NUMBERS.__getitem__)


# ---- fields ----------------------------------------------------------------------------------------


def test_fields_live_one_after_the_other_in_the_memory_of_their_lifetime():
    assert {name: LAYOUT.row_of(name) for name in LAYOUT.fields} == {
        "q": ("state", 0), "q_start": ("scratch", 0), "mass": ("parameter", 0), "resting": ("scratch", 1),
        "v": ("state", 1), "v_start": ("scratch", 2), "time": ("log", 0),
    }  # fmt: skip
    assert [LAYOUT.size(life) for life in (STATE, PARAMETER, SCRATCH, LOG)] == [2, 1, 3, 1]
    assert "mass" in LAYOUT
    assert "weight" not in LAYOUT


def test_a_name_has_one_owner():
    first, second = (
        Variable("q", "rad", "an angle", STATE, owner="the arm Odd"),
        Variable("q", "m", "other", SCRATCH),
    )
    said = "'q' is a name of the arm Odd: an angle, and of the engine"
    with pytest.raises(ValueError, match=f"{said}: other; rename one"):
        Layout([first, second])


@pytest.mark.parametrize(
    "use",
    [
        lambda lane: lane.weight,
        lambda lane: lane["weight"],
        lambda lane: setattr(lane, "weight", 1.0),
        lambda lane: lane.__setitem__("weight", 1.0),
        lambda lane: lane.get(["q"], of="{}_weight"),
        lambda lane: LAYOUT.row_of("weight"),
    ],
)
def test_an_unknown_field_lists_those_there_are(lane, use):
    with pytest.raises(AttributeError, match=r"a lane has no field '\w*weight'; it has q, q_start, mass,"):
        use(lane)
    assert lane.written() == {}


@pytest.mark.parametrize("name", ["4R gravity dop853", "stops 1e-6, inelastic"])
def test_every_field_of_a_scene_says_what_it_is(name):
    limited = rde.load_scene("rprp_reach")
    for simulator in (batch_simulator(SCENES[name], True), environment_simulator(limited, ReachTask())):
        fields = simulator.blocks.layout.fields
        assert len(fields) > 20
        assert all(f.doc and name == f.name for name, f in fields.items())


# ---- reading and setting ---------------------------------------------------------------------------


def test_a_field_is_loaded_once_and_read_as_it_was_until_it_is_set_and_then_as_it_is():
    asked = []
    lane = Lane(LAYOUT, lambda name: asked.append(name) or NUMBERS[name])
    assert lane.q == lane["q"] == 1.0
    lane.q = lane.q + 10.0
    lane["v"] = 20.0
    assert (lane.q, lane.v) == (11.0, 20.0)
    lane.q = 12.0
    assert lane.written() == {"q": 12.0, "v": 20.0}
    assert asked == ["q"]
    assert "resting" in lane
    assert not hasattr(lane, "weight")


def test_several_fields_are_read_and_set_by_the_form_of_their_names(lane):
    assert lane.get(("q", "v")) == [1.0, 5.0]
    assert lane.get(("q", "v"), of="{}_start") == [2.0, 6.0]
    lane.set(("v", "q"), (8.0, 9.0), of="{}_start")
    assert lane.written() == {"v_start": 8.0, "q_start": 9.0}
    with pytest.raises(ValueError, match="shorter"):
        lane.set(("v", "q"), (8.0,))


# ---- truths ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [1.0, 0.0, np.array([0.0, 1.0])], ids=str)
def test_a_truth_is_read_as_a_condition_and_kept_as_a_number(number):
    lane = Lane(LAYOUT, lambda name: number)
    np.testing.assert_array_equal(lane.resting, np.array(number, bool))
    lane.resting = lane.resting | (lane.q > 5.0)
    np.testing.assert_array_equal(lane.written()["resting"], number)
