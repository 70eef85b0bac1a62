"""Functions of a task take its numbers, and those of the scene, as arguments: held ones are refused."""

import functools
from dataclasses import dataclass

import pytest

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.envs.core import Core

full = rde.ReachTask.functions
rewards = rde.ReachTask.reward_functions


def near(held):
    return physics(gives="near_term")(lambda distance: held / (1.0 + distance))


def pays(held):
    return {"reward_functions": lambda self, scene: (near(held(self, scene)),)}


def made(width=1.0, static=(), **body):
    body = {"__annotations__": {"width": float}, "width": 1.0, "static": static, **body}
    return dataclass(frozen=True)(type("Held", (rde.ReachTask,), body))(width=width)


def branch(self, scene):
    return rewards(self, scene)[: 3 if self.hold_steps > 12 else 4]


def with_double(self):
    rde.ReachTask.__post_init__(self)
    object.__setattr__(self, "double", 2.0 * self.width)


HELD = {
    "a closure": ("width", pays(lambda task, scene: task.width)),
    "a number of the base": ("goal_tolerance", pays(lambda task, scene: task.goal_tolerance)),
    "a branch": ("hold_steps", {"reward_functions": branch}),
    "a partial": ("width", pays(lambda task, scene: functools.partial(max, task.width)(0.1))),
    "an attribute": (
        "width",
        {"__post_init__": with_double, **pays(lambda task, scene: task.double)},
    ),
    "the arm's": (r"masses\[0\] of the arm", pays(lambda task, scene: scene.robot.masses[0])),
    "an effect's": (
        r"limits\[1\] of the effect effort_limits",
        pays(lambda task, scene: scene.parameters()["effort_limits.limits[1]"]),
    ),
    "a start": (
        "start_angle",
        {"start_range": lambda self, scene, joint: (f"-{self.start_angle}", f"{self.start_angle}")},
    ),
    "a metric": (
        "width",
        {"metrics": property(lambda self: rde.ReachTask.metrics[: 4 if self.width > 0.7 else 3])},
    ),
    "an observation": (
        "width",
        {
            "observation": lambda self, scene: dict(
                list(rde.ReachTask.observation(self, scene).items())[: 3 if self.width > 1.2 else 5]
            )
        },
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", HELD)
@pytest.mark.parametrize("scene", ["rprp_reach", "four_r_reach"])
def test_a_number_that_is_held_is_refused(scene, what):
    name, body = HELD[what]
    with pytest.raises(
        ValueError, match=rf"Held does not follow its number {name} .*take it as the argument"
    ):
        Core(scene, 1, made(**body))


def test_a_static_number_may_be_held_and_is_no_argument():
    held = made(2.0, static=("width",), reward_functions=HELD["a closure"][1]["reward_functions"])
    assert "width" not in held.parameters()
    core = Core("four_r_reach", 1, held)
    assert "width" not in core.task.parameters()
    with pytest.raises(ValueError, match=r"Held.static has 'speed_bound'; choose"):
        Core("four_r_reach", 1, made(static=("speed_bound",)))


def test_what_the_message_names_is_an_argument():
    @physics(gives="near_term")
    def term(distance, width, m1, effort_limits_limits_1):
        return width * m1 / (1.0 + distance) / effort_limits_limits_1

    Core("four_r_reach", 1, made(reward_functions=lambda self, scene: (term,)))
