"""Follow a target that moves on a circle around the base: a task whose goal moves at every step."""

from dataclasses import dataclass

import redundant_envs as rde
from redundant_envs.algebra import physics


@physics(gives="turn")
def turn(interval, period):
    return 6.283185307179586 * interval / period


@physics(gives="turned_x turned_y")
def turned(goal_x, goal_y, turn_s, turn_c):
    return goal_x * turn_c - goal_y * turn_s, goal_x * turn_s + goal_y * turn_c


@dataclass(frozen=True)
class CircleTask(rde.ReachTask):
    """Keep the tip at a target that turns about the base.

    Parameters
    ----------
    period : float
        Time of a turn.
    """

    period: float = 8.0

    name = "Circle"
    summary = "follows a target that turns about its base"
    units = {**rde.ReachTask.units, "period": "s"}
    moves = {"goal_x": "turned_x", "goal_y": "turned_y"}
    angles = {**rde.ReachTask.angles, "turn": ("turn_s", "turn_c")}

    def functions(self, scene):
        return (*super().functions(scene), turn, turned)


rde.register_task(CircleTask)
