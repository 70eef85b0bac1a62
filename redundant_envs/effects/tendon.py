import functools
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from redundant_envs.effects import shapes
from redundant_envs.effects.hooks import Arm, Effect, Force, Hook, named
from redundant_envs.effects.numbers import (
    Curve,
    Example,
    Numbers,
    checked,
    one,
    positive,
    row,
    strength,
    text,
)
from redundant_envs.language.algebra import maximum, numbered, physics, total
from redundant_envs.robots.parameters import numbers, strengths
from redundant_envs.support.values import shown

Law = Callable[..., Any]


@functools.cache
def laws(count: int) -> tuple[Law, list[tuple[Law, Law]]]:
    """Functions of a tendon over ``count`` joints, of their positions and its moment arms: its energy, and at
    each joint its force and its stiffness."""
    positions, arms = numbered("position{}", count), numbered("arm{}", count)

    @physics(takes=(*positions, *arms, "stiffness", "pretension"))
    def tension(*values):
        """It pulls in proportion to its strain; a slack tendon does not push."""
        *along, stiffness, pretension = values
        longer = total(arm * position for position, arm in zip(along[:count], along[count:], strict=True))
        return maximum(pretension + stiffness * longer, 0.0)

    @physics(takes=(*positions, *arms, "stiffness", "pretension"))
    def energy(*values):
        return 0.5 * tension(*values) ** 2 / values[-2]

    def force(k: int) -> Law:
        @physics(takes=(*positions, *arms, "stiffness", "pretension"))
        def force(*values):
            """The tendon becomes shorter: its tension acts against its moment arm."""
            return -values[count + k] * tension(*values)

        return force

    def steepness(k: int) -> Law:
        @physics(takes=(arms[k], "stiffness"))
        def steepness(arm, stiffness):
            """All joints together are at most this stiff, relative to each: (sum |x_i|)^2 is at most
            count^2 max x_i^2."""
            return count * count * stiffness * arm * arm

        return steepness

    return energy, [(force(k), steepness(k)) for k in range(count)]


def several_joints(field: str, value: Any) -> tuple[str, ...]:
    """Names of two or more joints, each once."""
    joints = tuple(value) if isinstance(value, list) else value
    if not isinstance(joints, tuple) or len(joints) < 2 or len({*map(str, joints)}) < len(joints):
        fix = "give the names of two or more joints, each once, such as ('joint2', 'joint3')"
        raise ValueError(f"{field} is {shown(value)}; {fix}")
    return joints


@dataclass(frozen=True)
class Tendon(Effect):
    """An elastic tendon along two or more joints, which pulls and never pushes.

    Joint i makes the tendon longer by a_i phi_i, a_i being its moment arm. The tension is
    F = max(F0 + k sum a_i phi_i, 0); F0, the pretension, is that in the pose with all these phi at 0. The
    force on joint i is -a_i F, the potential F^2 / (2 k). With a negative F0 the tendon is slack in that
    pose: -F0 / k metres must be taken up before it pulls. With a pretension that is never used up it is a
    spring between its joints; two tendons with opposite arms are a pair of antagonists.

    Parameters
    ----------
    joints : tuple of str
        The joints along which it runs, such as ("joint2", "joint3").
    moment_arms : tuple of floats
        Moment arm a of each of these joints: m of a revolute joint, 1 or -1 for a slider (m per m).
    stiffness : float
        Stiffness k, N/m, positive.
    pretension : float
        Tension F0 with all these positions at 0, N; below 0 the tendon is slack there.
    name : str
        Tells several tendons of a scene apart: "flexor" has the parameters "tendon.flexor.stiffness", ...
    """

    joints: Sequence[str] = field(metadata=checked(several_joints))
    moment_arms: Numbers = field(metadata=row(strengths))
    stiffness: float = field(metadata=one(positive, "N/m"))
    pretension: float = field(default=0.0, metadata=one(strength, "N"))
    name: str = field(default="", metadata=checked(text))

    static = ("joints", "name")
    key = named("tendon.")
    example = Example(
        {
            "joints": ("joint2", "joint3"),
            "moment_arms": (0.03, 0.02),
            "stiffness": 3000.0,
            "pretension": 60.0,
        },
        curve=Curve("force", "position", 1.5),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        numbers("Tendon.moment_arms", self.moment_arms, len(self.joints))

    def _places(self, arm: Arm) -> list[int]:
        """Its joints by their numbers, from 0; ValueError if the arm has none of that name."""
        for k, joint in enumerate(self.joints):
            if joint not in arm.joints:
                known = ", ".join(arm.joints)
                raise ValueError(f"Tendon.joints[{k}] is {shown(joint)}; {arm.kind} has {known}")
        return [arm.joints.index(joint) for joint in self.joints]

    def units(self, arm: Arm) -> dict[str, str]:
        slides = [arm.prismatic[joint] for joint in self._places(arm)]
        return {f"moment_arms[{k}]": "1" if s else "m" for k, s in enumerate(slides)} | super().units(arm)

    def shapes(self, pose: shapes.Pose) -> tuple[shapes.Shape, ...]:
        """A line from link to link that passes each revolute joint at its moment arm, on the outer side of a
        bend that makes it longer."""
        if not pose.shows_joints:
            return ()
        ends, places = pose.ends, self._places(pose.arm)
        arms = dict(zip(places, self.moment_arms, strict=True))
        middles = [(0.5 * (xa + xb), 0.5 * (ya + yb)) for (xa, ya), (xb, yb) in itertools.pairwise(ends)]
        first, last = min(places), max(places)
        line = [middles[first - 1] if first else ends[0]]
        for joint in range(first, last + 1):
            (x, y), (xa, ya), (xb, yb) = ends[joint], ends[max(joint - 1, 0)], ends[joint + 1]
            turns = not pose.arm.prismatic[joint]
            away = arms.get(joint, 0.0) / (math.hypot(xb - xa, yb - ya) or 1.0) if turns else 0.0
            line.append((x + away * (yb - ya), y - away * (xb - xa)))
        line.append(middles[last])
        longer = sum(a * pose.positions[joint] for joint, a in arms.items())
        return (shapes.Line(tuple(line), taut=self.pretension + self.stiffness * longer > 0.0),)

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        energy, at_joints = laws(len(self.joints))
        places = self._places(arm)
        bind = {f"position{k + 1}": f"phi{joint + 1}" for k, joint in enumerate(places)}
        bind |= {f"arm{k + 1}": f".moment_arms[{k}]" for k in range(len(places))}
        forces: list[Force] = []
        for joint, (force, steepness) in zip(places, at_joints, strict=True):
            potential = None if forces else energy  # the first has that of all
            forces.append(Force(joint, force, bind, potential, conservative=force, stiffness=steepness))
        return tuple(forces)
