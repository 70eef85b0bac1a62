"""Tasks of redundancy that observe less, to see what an observation is worth to a learner, as in
python -m agents --import docs.examples.fewer_observations train PRESET env=FourRReachAroundBlind-v0
"""

from dataclasses import dataclass

import redundant_envs as rde
from redundant_envs.tasks.reach_around import ReachAroundTask
from redundant_envs.tasks.reach_light import ReachLightTask


def without(names, *prefixes):
    return {name: text for name, text in names.items() if not name.startswith(prefixes)}


@dataclass(frozen=True)
class ReachAroundBlind(ReachAroundTask):
    """ReachAround without the distances of links from discs, and without whether a link has touched one."""

    name = "ReachAroundBlind"

    def observation(self, scene):
        return without(super().observation(scene), "clearance", "struck")


@dataclass(frozen=True)
class ReachLightBlind(ReachLightTask):
    """ReachLight without the efforts that hold the pose."""

    name = "ReachLightBlind"

    def observation(self, scene):
        return without(super().observation(scene), "rest")


rde.register_task(ReachAroundBlind, {"FourR": "four_r_around", "RPRP": "rprp_around"})
rde.register_task(ReachLightBlind)
