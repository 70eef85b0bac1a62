"""How far the links are from discs, and how this changes with the joints."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.nominal import NominalModel
from redundant_envs.effects.hooks import Obstacle
from redundant_envs.scenes.scene import Scene
from redundant_envs.support.values import shown

Array = NDArray[np.float64]
DISC = {"centre[0]", "centre[1]", "radius"}  # numbers of an effect that is a disc, with contact or without


def discs_of(scene: Scene, numbers: Mapping[str, Array]) -> Array:
    """Centre x, y and radius [m] of each disc of a scene in each lane, (n, discs, 3), from the numbers in
    force by their names. ValueError without an obstacle, or for one that is no disc."""
    effects = dict.fromkeys(a.effect for a in scene.attached.of(Obstacle))
    if not effects:
        raise ValueError("scene has no obstacle; add KeepOut(centre, radius) to its effects")
    for effect in effects:
        if not effect.parameters().keys() >= DISC:
            raise ValueError(f"effects has {shown(effect)}; plans know discs alone: use KeepOut or Disc")
    keys = [effect.key for effect in effects]
    parts = [np.column_stack([numbers[f"{key}.centre"], numbers[f"{key}.radius"]]) for key in keys]
    return np.stack(parts, axis=1)


def clearance(model: NominalModel, phi: Array, discs: Array) -> Array:
    """Least distance (...) of any link in the poses phi (..., joints) from any of the discs (..., discs, 3),
    m; negative inside. Batch shapes broadcast."""
    x, y, _ = _nearest(model.links(phi), discs)
    distance: Array = (np.sqrt((x * x + y * y).min(axis=-2)) - discs[..., 2]).min(axis=-1)
    return distance


def clearance_slopes(model: NominalModel, phi: Array, discs: Array) -> tuple[Array, Array]:
    """Least distance of the links from each disc, (..., discs), and its slopes by the joints, (..., discs,
    joints), for phi and discs of one batch shape.

    The nearest point of a link, at the share s of its length, moves as (1 - s) of its one end and s of its
    other; the distance changes by that motion along the normal (Maciejewski and Klein 1985).
    """
    x, y, share = _nearest(model.links(phi), discs)
    square = x * x + y * y
    link = square.argmin(axis=-2)[..., None, :]  # the nearest one to each disc
    x, y, share, square = (np.take_along_axis(v, link, -2)[..., 0, :] for v in (x, y, share, square))
    length = np.sqrt(square)
    h = STEP * np.eye(model.joints)
    ends = (model.links(phi[..., None, :] + h) - model.links(phi[..., None, :] - h)) / (2.0 * STEP)
    ends = np.moveaxis(ends, -3, -1)  # (..., points, 2, joints)
    at = link[..., 0, :, None, None]
    first, second = (np.take_along_axis(ends, at + k, axis=-3) for k in (0, 1))
    moved = first + share[..., None, None] * (second - first)
    normal = np.stack([x, y], axis=-1) / np.maximum(length, TINY)[..., None]
    return length - discs[..., 2], (normal[..., None] * moved).sum(axis=-2)


STEP = 1e-5  # rad and m, of central differences: their error is about 1e-10
TINY = np.finfo(np.float64).tiny  # m, of links and distances that are zero


def _nearest(links: Array, discs: Array) -> tuple[Array, Array, Array]:
    """From each disc's centre to the nearest point of each link, x and y, and the share of the link's length
    at which that is, (..., links, discs) each."""
    x, y = links[..., 0], links[..., 1]
    along_x, along_y = np.diff(x)[..., None], np.diff(y)[..., None]
    to_x = discs[..., None, :, 0] - x[..., :-1, None]
    to_y = discs[..., None, :, 1] - y[..., :-1, None]
    square = np.maximum(along_x * along_x + along_y * along_y, TINY)
    share = np.clip((to_x * along_x + to_y * along_y) / square, 0.0, 1.0)
    return share * along_x - to_x, share * along_y - to_y, share
