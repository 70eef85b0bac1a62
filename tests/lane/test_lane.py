"""Lanes have declared fields and no others, which say what they are."""

import pytest
from catalogue import SCENES

import redundant_envs as rde
from redundant_envs.model.programs import batch_simulator, environment_simulator
from redundant_envs.simulator.lane.fields import SCRATCH, STATE, Layout, Variable
from redundant_envs.simulator.lane.memory import Lane
from redundant_envs.tasks.reach import ReachTask

LAYOUT = Layout(
    [
        Variable("q", "rad", "an angle", STATE),
        Variable("q_start", "rad", "the angle before", SCRATCH),
        Variable("resting", "", "has no speed", SCRATCH, truth=True),
    ]
)
NUMBERS = {"q": 1.0, "q_start": 2.0, "resting": 1.0}


def test_a_field_is_loaded_once_and_read_as_it_was_until_it_is_set():
    asked = []
    lane = Lane(LAYOUT, lambda name: asked.append(name) or NUMBERS[name])
    assert lane.q == lane["q"] == 1.0
    assert lane.get(("q",), of="{}_start") == [2.0]
    lane.q = lane.q + 10.0
    lane.resting = lane.resting & (lane.q < 5.0)
    assert lane.written() == {"q": 11.0, "resting": 0.0}
    assert asked == ["q", "q_start", "resting"]


@pytest.mark.parametrize(
    "use",
    [
        lambda lane: lane["weight"],
        lambda lane: setattr(lane, "weight", 1.0),
        lambda lane: lane.get(["q"], of="{}_weight"),
    ],
)
def test_an_unknown_field_lists_those_there_are(use):
    with pytest.raises(AttributeError, match=r"a lane has no field '\w*weight'; it has q, q_start, resting"):
        use(Lane(LAYOUT, NUMBERS.__getitem__))


def test_every_field_of_a_scene_says_what_it_is():
    scene, limited = SCENES["stops 1e-6, inelastic"], rde.load_scene("rprp_reach")
    for simulator in (batch_simulator(scene, True), environment_simulator(limited, ReachTask())):
        fields = simulator.blocks.layout.fields
        assert len(fields) > 20
        assert all(f.doc and name == f.name for name, f in fields.items())
