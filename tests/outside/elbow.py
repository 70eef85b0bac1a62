"""One more observation: how high the second mass of an arm is."""

from dataclasses import dataclass

import redundant_envs as rde
from redundant_envs.algebra import physics, squash


@physics(gives="elbow_obs")
def elbow_height(y2, reach):
    return squash(y2, reach)


@dataclass(frozen=True)
class ElbowReachTask(rde.ReachTask):
    """The reach task, with the height of the elbow observed."""

    name = "ElbowReach"

    def functions(self, scene):
        return (*super().functions(scene), elbow_height)

    def observation(self, scene):
        return {**super().observation(scene), "elbow_obs": "squash(height of the second mass / reach)"}


rde.register_task(ElbowReachTask)
