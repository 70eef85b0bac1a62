"""Control intervals with hard stops against an account that shares no code with the package.

``python -m tests.oracles.compared_stops 10000`` compares as many intervals of the families of ``study
impacts``, some 50 ms each.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from redundant_envs.progress import counted
from redundant_envs.studies.intervals import families, tips_after
from redundant_envs.studies.stop_families import StopFamily
from redundant_envs.verify.judging import judge
from tests.oracles.independent_stops import StoppedArm


def compared(family: StopFamily, count: int, seed: Any) -> tuple[int, int]:
    """Intervals of a family that the account crosses, and those of them that are missed without a flag."""
    drawn = family.draw(count, np.random.default_rng(seed))
    tips, status = tips_after(family, family.scene(), drawn)
    arm = StoppedArm(
        family.masses, family.lengths, family.g, family.friction, family.travel, family.restitution
    )
    inverse, right = np.linalg.inv(family.robot.motor_map), np.full((count, 2), np.nan)
    for i, (q, qd, efforts) in enumerate(
        zip(drawn.joints @ inverse, drawn.rates @ inverse, drawn.efforts, strict=True)
    ):
        if status.numerics[i] == 0:
            end = arm.after(q, qd, efforts, family.control_dt)
            if end is not None:
                right[i] = family.robot.forward_kinematics(end[:4])
    judgement = judge(tips, [right], family.tolerance, np.isfinite(right).all(axis=1))
    return int(judgement.judged.sum()), int(judgement.missed.sum())


def main(count: int) -> int:
    chosen, judged, missed = families("impacts", 0), 0, 0
    with counted("intervals with stops", len(chosen)) as done:
        for number, family in enumerate(chosen):
            here, off = compared(family, -(-count // len(chosen)), (0, number))
            judged, missed = judged + here, missed + off
            done(f"{off} of {here} missed: {family.name}")
    print(f"{judged} intervals compared, {missed} missed")
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
