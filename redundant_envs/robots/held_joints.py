"""Dynamics of an arm of which some joints are held: in joint coordinates, from which these are taken out.

With the rates of the joints u and qd = T u, the mass matrix of the joints is T^T M T and the forces on them
are T^T (Q - h - G). Held joints are left out of the system; the forces that hold them follow from the
accelerations of the others.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from redundant_envs.language.algebra import entries, numbered, physics, total, where
from redundant_envs.robots.arm import Arm
from redundant_envs.robots.derived import rows, solved
from redundant_envs.robots.mobility import joint_rates

Function = Callable[..., Any]


@functools.lru_cache(maxsize=64)
def held_joint_dynamics(arm: type[Arm], joints: tuple[int, ...]) -> Function:
    """Accelerations of the coordinates while joints with held > 0 keep their rates, the accelerations of
    these joints, and the forces that hold them [N m or N].

    The coordinates of a held joint have accelerations that are equal to the last bit, so that its rate stays
    exactly 0 where it was.
    """
    n = len(arm.coordinates)
    back = np.linalg.inv(joint_rates(arm)).round(12)  # T, of small whole numbers
    of_motion = [*entries("M", n, n), *(f"{letter}{k + 1}" for letter in "hGQ" for k in range(n))]
    held = [f"held{k + 1}" for k in joints]
    gives = [*numbered("qdd{}", n), *(f"{name}{k + 1}" for name in ("alpha", "hold") for k in joints)]

    @physics(gives=gives, takes=(*of_motion, *held))
    def held_joint_dynamics(*values: Any) -> tuple[Any, ...]:
        """T^T M T a = T^T (Q - h - G), by L D L^T, and qdd = T a."""
        M, (h, G, Q) = rows(values[: n * n], n), rows(values[n * n : n * n + 3 * n], n)
        forces = _summed(back.T, [q - a - b for q, a, b in zip(Q, h, G, strict=True)])
        half = [_summed(back.T, row) for row in M]  # M T, row by row
        of_joints = [_summed(back.T, column) for column in zip(*half, strict=True)]
        rests = dict(zip(joints, (flag > 0.0 for flag in values[n * n + 3 * n :]), strict=True))
        left = [[*row] for row in of_joints]
        for i, j in itertools.product(range(n), range(n)):
            for k in {i, j} & rests.keys():
                left[i][j] = where(rests[k], float(i == j), left[i][j])
        right = [where(rests[k], 0.0, f) if k in rests else f for k, f in enumerate(forces)]
        alpha = solved(left, right)
        hold = [total(a * b for a, b in zip(of_joints[k], alpha, strict=True)) - forces[k] for k in joints]
        return (*_summed(back, alpha), *(alpha[k] for k in joints), *hold)

    return held_joint_dynamics


def _summed(matrix: Any, terms: Sequence[Any]) -> list[Any]:
    """A matrix of small whole numbers times terms, each sum from left to right."""
    pairs = ([(float(s), t) for s, t in zip(row, terms, strict=True) if s != 0.0] for row in matrix)
    return [total(t if share == 1.0 else share * t for share, t in row) for row in pairs]
