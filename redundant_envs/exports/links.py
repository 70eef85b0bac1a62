"""The links of an arm as rigid bodies, found from the positions of its point masses and its tip.

In the pose in which all joints are at 0 the displacement of a point by a joint shows where the joint is: a
revolute one is beside the point, across its displacement; a slider moves along it. Which joints move a point
shows the link that carries it. In poses at random the links then have to put all points where the arm has
them.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.robots.arm import Arm
from redundant_envs.robots.derived import coordinate_rates

Array = NDArray[np.float64]
POSES = 16
EQUAL = 1e-12  # largest difference of positions and of displacements, as a share of the reach
ALIKE = 1e-10  # largest difference of the arm's equations from those of its points, in units of their terms
LENGTH = 14  # characters from which on a number is not a short one


class RigidLink(NamedTuple):
    """What moves with a joint, and not with the next one; in the pose in which all joints are at 0."""

    joint: str
    slides: bool
    axis: Array  # direction of a slider
    place: Array  # of the joint, from that of the joint before, m
    points: dict[int, Array]  # point masses, counted from 0, and their positions from the joint, m
    tip: Array | None  # the position of the tip, if it is on this link


def links_of(arm: Arm) -> tuple[RigidLink, ...]:
    """The links of an arm, from base to tip; point masses that no joint moves belong to none. ValueError
    if it is not a chain of rigid links, one for each joint."""
    n = len(arm.joints)
    phi = np.vstack([np.zeros(n), np.random.default_rng(0).uniform(-1.5, 1.5, (POSES, n))])
    unknown = "its point masses are not known in all poses"
    try:
        with np.errstate(all="ignore"):
            points, moved = _points(arm, coordinates_at(arm, phi))
    except (ValueError, ArithmeticError) as error:
        raise _refusal(arm, f"{unknown}: {error}") from None
    if not (np.isfinite(points).all() and np.isfinite(moved).all()):
        raise _refusal(arm, unknown)
    _check_equations(arm, phi, moved[:, :-1])
    reach = max(float(np.abs(points).max()), 1e-300)
    by_joint = np.abs(moved).max(axis=(0, 2)) > EQUAL * reach  # whether a joint moves a point
    last = np.where(by_joint.any(axis=1), n - 1 - by_joint[:, ::-1].argmax(axis=1), -1)
    links: list[RigidLink] = []
    before = np.zeros(2)
    for k, joint in enumerate(arm.joints):
        carried = np.flatnonzero(by_joint[:, k])
        if not carried.size:
            raise _refusal(arm, f"its joint {joint} moves no point mass")
        at, by = points[0, carried[0]], moved[0, carried[0], :, k]
        positions = {int(p): points[0, p] for p in np.flatnonzero(last == k)}
        slides = arm.prismatic[k]
        if slides and abs(float(np.hypot(*by)) - 1.0) > EQUAL:
            raise _refusal(arm, f"its slider {joint} moves a mass by {np.hypot(*by):.6g} m for each metre")
        place = next(iter(positions.values()), before) if slides else np.array([at[0] - by[1], at[1] + by[0]])
        offsets = {p: _plain(position - place) for p, position in positions.items()}
        tip = offsets.pop(arm.num_masses, None)
        axis = _plain(by) if slides else np.zeros(2)
        links.append(RigidLink(joint, slides, axis, _plain(place - before), offsets, tip))
        before = place
    gap = max(float(np.abs(point - points[:, p]).max()) for p, point in _placed(links, phi, arm.num_masses))
    if not gap <= EQUAL * reach:
        raise _refusal(arm, f"a chain of rigid links would have its points up to {gap:.2g} m beside them")
    return tuple(links)


def coordinates_at(arm: Arm, phi: Array) -> Array:
    """Coordinates at positions of the joints (..., joints)."""
    q: Any = arm.coordinates_of_joints(*np.moveaxis(phi, -1, 0))
    rows = q if isinstance(q, tuple) else (q,)
    return np.stack(np.broadcast_arrays(*rows), axis=-1).astype(np.float64)


def _check_equations(arm: Arm, phi: Array, moved: Array) -> None:
    """Refuse an arm whose own equations are not those of its point masses, or whose motors are not at its
    joints; ``moved`` are displacements of the point masses by the joints."""
    q, shares, masses = coordinates_at(arm, phi), coordinate_rates(arm), np.array(arm.masses)
    if not np.allclose(arm.motor_map.T @ shares, np.eye(len(shares)), rtol=0.0, atol=ALIKE):
        raise _refusal(arm, "its motors do not act between a link and the one before it")
    qd = np.random.default_rng(1).uniform(-1.0, 1.0, q.shape)
    names = [f"{axis}dqd{p + 1}" for p in range(len(masses)) for axis in "XY"]
    turning = arm._vector(names, q=q, qd=qd).reshape(len(q), -1, 2)
    M, h, G = arm.mass_matrix(q), arm.bias_forces(q, qd), arm.gravity_forces(q, 9.81)
    for what, actual, indices, factor in (
        ("masses and inertias", shares.T @ M @ shares, "p, npaj, npak -> njk", moved),
        ("bias forces", h @ shares, "p, npaj, npa -> nj", turning),
        ("gravity forces", G @ shares, "p, npaj, a -> nj", np.array([0.0, 9.81])),
    ):
        terms = np.einsum(indices, masses, np.abs(moved), np.abs(factor))  # they may cancel
        if not np.abs(actual - np.einsum(indices, masses, moved, factor)).max() <= ALIKE * terms.max():
            raise _refusal(arm, f"its {what} are not those of its point masses")


def _placed(links: Sequence[RigidLink], phi: Array, tip: int) -> Iterator[tuple[int, Array]]:
    """Positions of all points that move, and of the tip, which has a number, too: (poses, 2) m. Within,
    vectors of the plane are complex numbers."""
    origin, turn = np.zeros(len(phi), complex), np.ones(len(phi), complex)
    for link, moved in zip(links, phi.T, strict=True):
        origin = origin + turn * complex(*link.place)
        if link.slides:
            origin = origin + moved * turn * complex(*link.axis)
        else:
            turn = turn * np.exp(1j * moved)
        for p, offset in (*link.points.items(), *([] if link.tip is None else [(tip, link.tip)])):
            yield p, (origin + turn * complex(*offset)).view(np.float64).reshape(-1, 2)


def _points(arm: Arm, q: Array) -> tuple[Array, Array]:
    """Positions of point masses and tip, (poses, points, 2), and their slopes, (poses, points, 2, joints)."""
    n, count = len(arm.joints), arm.num_masses
    names = [f"{axis}{p + 1}{j + 1}" for p in range(count) for axis in "XY" for j in range(n)]
    slopes = arm._vector(names, q=q).reshape(len(q), count, 2, n)
    slopes = np.concatenate([slopes, arm.jacobian(q)[:, None]], axis=1)
    points = np.concatenate([arm.points(q), arm.forward_kinematics(q)[:, None]], axis=1)
    return points, slopes @ coordinate_rates(arm)


def _plain(vector: Array) -> Array:
    """Without the rounding of a difference, where a short number has the same 15 digits."""
    shorter = ((f"{x:.15g}", x) for x in vector.tolist())
    return np.array([float(text) + 0.0 if len(text) < LENGTH else x for text, x in shorter])


def _refusal(arm: Arm, reason: str) -> ValueError:
    return ValueError(
        f"robot is a {arm.kind}, which cannot be written as rigid links: {reason}; the formats c and casadi "
        "take any arm"
    )
