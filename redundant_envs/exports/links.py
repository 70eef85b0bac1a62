"""The links of an arm as rigid bodies, found from the positions of its point masses.

In the pose in which all joints are at 0 the displacement of a point by a joint shows where the joint is: a
revolute one is beside the point, across its displacement; a slider moves along it. Which joints move a point
shows the link that carries it. In poses at random the links then have to put all points where the arm has
them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.robots.arm import Arm
from redundant_envs.robots.mobility import joint_rates

Array = NDArray[np.float64]
POSES = 16
EQUAL = 1e-12
"""Largest difference of positions and of displacements, as a share of the reach."""


class Link(NamedTuple):
    """What moves with a joint, and not with the next one; in the pose in which all joints are at 0."""

    joint: str
    slides: bool
    axis: Array  # direction of a slider
    place: Array  # of the joint, from that of the joint before, m
    points: dict[int, Array]  # point masses, counted from 0, and their positions from the joint, m


def links_of(arm: Arm) -> tuple[Link, ...]:
    """The links of an arm, from base to tip.

    Raises
    ------
    ValueError
        If the arm is not a chain of rigid links, one for each joint.
    """
    n = len(arm.joints)
    phi = np.vstack([np.zeros(n), np.random.default_rng(0).uniform(-1.5, 1.5, (POSES, n))])
    try:
        q = np.stack(np.broadcast_arrays(*_tuple(arm.coordinates_of_joints(*phi.T))), axis=-1)
        points, moved = arm.points(q), _displacements(arm, q)
    except (ValueError, ArithmeticError) as error:
        raise _refusal(arm, f"its point masses are not known in all poses: {error}") from None
    reach = max(float(np.abs(points).max()), 1e-300)
    if not (np.isfinite(points).all() and np.isfinite(moved).all()):
        raise _refusal(arm, "its point masses are not known in all poses")
    by_joint = np.abs(moved).max(axis=(0, 2)) > EQUAL * reach  # whether a joint moves a point
    last = np.where(by_joint.any(axis=1), n - 1 - by_joint[:, ::-1].argmax(axis=1), -1)
    if (last < 0).any():
        raise _refusal(arm, f"no joint moves its mass {int(np.flatnonzero(last < 0)[0]) + 1}")
    made: list[Link] = []
    before = np.zeros(2)
    for k, joint in enumerate(arm.joints):
        carried = np.flatnonzero(by_joint[:, k])
        if not carried.size:
            raise _refusal(arm, f"its joint {joint} moves no point mass")
        at, by = points[0, carried[0]], moved[0, carried[0], :, k]
        own = {int(p): points[0, p] for p in np.flatnonzero(last == k)}
        slides = arm.prismatic[k]
        place = next(iter(own.values()), before) if slides else np.array([at[0] - by[1], at[1] + by[0]])
        axis = by if slides else np.zeros(2)
        offsets = {p: _plain(position - place) for p, position in own.items()}
        made.append(Link(joint, slides, _plain(axis), _plain(place - before), offsets))
        before = place
    gap = float(np.abs(placed(made, phi) - points).max())
    if not gap <= EQUAL * reach:
        raise _refusal(arm, f"its points would be up to {gap:.2g} m beside those of a chain of rigid links")
    return tuple(made)


def placed(links: list[Link], phi: Array) -> Array:
    """Positions of all point masses (poses, masses, 2) m at joint positions (poses, joints)."""
    origin, angle = np.zeros((len(phi), 2)), np.zeros(len(phi))
    found: dict[int, Array] = {}
    for link, moved in zip(links, phi.T, strict=True):
        origin = origin + _turned(link.place, angle)
        if link.slides:
            origin = origin + moved[:, None] * _turned(link.axis, angle)
        else:
            angle = angle + moved
        found |= {p: origin + _turned(offset, angle) for p, offset in link.points.items()}
    return np.stack([found[p] for p in sorted(found)], axis=1)


def _displacements(arm: Arm, q: Array) -> Array:
    """Displacements of all points by the joints, (poses, masses, 2, joints)."""
    n = len(arm.joints)
    names = [f"{axis}{p + 1}{j + 1}" for p in range(arm.num_masses) for axis in "XY" for j in range(n)]
    slopes = arm._vector(names, q=q).reshape(len(q), arm.num_masses, 2, n)
    return np.asarray(slopes @ np.linalg.inv(joint_rates(arm)), dtype=np.float64)


def _turned(vector: Array, angle: Array) -> Array:
    s, c = np.sin(angle), np.cos(angle)
    return np.stack([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]], axis=-1)


def _plain(vector: Array) -> Array:
    """Without the rounding of a difference, where a shorter number has the same 15 digits."""
    return np.array([float(f"{x:.15g}") + 0.0 for x in vector])


def _tuple(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,)


def _refusal(arm: Arm, reason: str) -> ValueError:
    return ValueError(f"robot is a {arm.kind}, which cannot be written as rigid links: {reason}")
