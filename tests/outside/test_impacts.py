"""Effects from outside with hard stops: the travel that they declare, their motion, and refused ones."""

import dataclasses

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.effects import Effect, Impact


@dataclasses.dataclass(frozen=True)
class Bumper(Effect):
    """Stops of one slider with its own restitution."""

    joint: int = 1
    upper: float = 0.2
    lower: float = 0.0
    restitution: float = 0.0

    static = ("joint",)

    @property
    def key(self):
        return f"bumper{self.joint}"

    def hooks(self, arm):
        return (Impact(self.joint, ".lower", ".upper", ".restitution"),)


def test_stops_on_one_of_two_sliders_work_and_let_go_when_they_are_moved():
    arm = rde.RPRP((1.0,) * 4, (0.3, 0.3))
    batch = rde.BatchSimulator(rde.Scene(arm, (Bumper(),), tolerance=1e-8))
    batch.set_state([0.0, 0.1, 0.0, 0.1], [0.0, 1.0, 0.0, 0.0])
    for _ in range(20):
        batch.advance([0.0, 30.0, 0.0, 0.0])
    assert batch.q[0, 1] == 0.2
    batch.set_parameters({"bumper1.upper": 0.5})
    for _ in range(3):
        batch.advance([0.0, 30.0, 0.0, 0.0])
    assert batch.q[0, 1] > 0.21


def test_impacts_tell_the_travel_of_their_joints():
    arm = rde.RPRP((1.0,) * 4, (0.3, 0.3))
    assert Bumper().travel(arm) == {1: ("lower", "upper")}
    assert Bumper(upper=np.inf).travel(arm) == {}


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        ({"restitution": 1.5}, r"Bumper\).restitution is 1.5; it must lie in 0 to 1"),
        ({"restitution": -0.1}, r"Bumper\).restitution is -0.1; it must lie in 0 to 1"),
        ({"lower": 0.3}, r"travel is .lower to .upper, which are 0.3 and 0.2; the first must be below"),
    ],
)
def test_impacts_that_cannot_be_are_refused_of_a_scene_and_of_a_lane(numbers, said):
    arm = rde.RPRP((1.0,) * 4, (0.3, 0.3))
    with pytest.raises(ValueError, match=said):
        rde.Scene(arm, (Bumper(**numbers),))
    batch = rde.BatchSimulator(rde.Scene(arm, (Bumper(),)), 3)
    before = batch.save()["parameters"]
    with pytest.raises(ValueError, match=said.replace(r"Bumper\)", "bumper1")):
        batch.set_parameters({f"bumper1.{name}": value for name, value in numbers.items()}, [1])
    np.testing.assert_array_equal(batch.save()["parameters"], before)


@pytest.mark.parametrize(
    ("effects", "said"),
    [
        ((Bumper(), Bumper(3, restitution=0.5)), "stops with several restitutions"),
        ((Bumper(), e.PrismaticStop((0, 0), (1, 1))), "several restitutions"),
        ((Bumper(0),), "'joint1' is not a slider"),
    ],
)
def test_stops_that_cannot_be_together_are_refused(effects, said):
    with pytest.raises(ValueError, match=said):
        rde.Scene(rde.RPRP((1.0,) * 4, (0.3, 0.3)), effects)
