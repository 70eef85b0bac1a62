"""From a way through joint space to a motion that the motors can follow: corners are rounded, and the time is
scaled as in Hollerbach, "Dynamic scaling of manipulator trajectories" (1984)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from redundant_envs.control.nominal import NominalModel
from redundant_envs.control.poses import far_apart

Array = NDArray[np.float64]
POINTS = 201  # of a way: its corners are rounded over 12 points and more
REST = 0.1  # s, between a motion and the time from which the goal has to be held
SOONEST = 0.2  # s, of a motion where the goal has to be held at once
SHARE_OF_SPEED = 0.6  # of the speed that an action of 1 is: the rest is for the feedback
SAMPLES = np.linspace(0.0, 1.0, 41)  # shares of the time at which efforts are compared with their limits


class Motion(NamedTuple):
    """References of lanes: phi, its rates and accelerations, each (n, steps, joints)."""

    phi: Array
    phid: Array
    phidd: Array


def evenly(model: NominalModel, way: Array, points: int = POINTS) -> Array:
    """Points (points, joints) at equal distances along a polyline (m, joints)."""
    length = np.concatenate([[0.0], np.cumsum(far_apart(model, way[1:], way[:-1]))])
    at = np.linspace(0.0, length[-1], points)
    return np.stack([np.interp(at, length, column) for column in way.T], axis=1)


def rounded(ways: Array, width: float) -> Array:
    """Ways (n, points, joints) averaged over a share ``width`` of their length to either side; straight ways
    and both ends stay."""
    pad = int(width * ways.shape[1])
    if not pad:
        return ways
    bell = np.pad(np.convolve(np.hanning(pad + 2)[1:-1], np.hanning(pad + 2)[1:-1]), 1)
    before = 2.0 * ways[:, :1] - ways[:, pad:0:-1]  # a line goes straight on beyond its ends
    after = 2.0 * ways[:, -1:] - ways[:, -2 : -pad - 2 : -1]
    windows = sliding_window_view(np.concatenate([before, ways, after], axis=1), 2 * pad + 1, axis=1)
    smooth: Array = windows @ bell / bell.sum()
    return smooth


def minimum_jerk(s: Array) -> tuple[Array, Array, Array]:
    """10 s^3 - 15 s^4 + 6 s^5 and its derivatives: from rest to rest (Flash and Hogan 1985)."""
    return (
        s**3 * (10.0 - 15.0 * s + 6.0 * s**2), 30.0 * s**2 * (1.0 - s) ** 2,
        60.0 * s * (1.0 - 3.0 * s + 2.0 * s**2),
    )  # fmt: skip


def at_shares(ways: Array, s: Array) -> Motion:
    """Ways (n, points, joints) at the shares s (n, m) of their time, with derivatives by that share."""
    along, rate, change = (x[..., None] for x in minimum_jerk(s))
    spacing = 1.0 / (ways.shape[1] - 1)
    slopes = np.gradient(ways, spacing, axis=1)
    place = along[..., 0] / spacing
    low = np.minimum(place.astype(np.intp), ways.shape[1] - 2)
    part = (place - low)[..., None]

    def between(table: Array) -> Array:
        first = np.take_along_axis(table, low[..., None], axis=1)
        second = np.take_along_axis(table, low[..., None] + 1, axis=1)
        return first + part * (second - first)

    slope, bend = between(slopes), between(np.gradient(slopes, spacing, axis=1))
    return Motion(between(ways), slope * rate, slope * change + bend * rate**2)


def quickest(model: NominalModel, ways: Array, seconds: Array, most: float) -> tuple[Array, Array]:
    """The shortest of the times ``seconds``, (k,) or (k, n), in which no motor exceeds the share ``most`` of
    its limit, and the largest share then, (n,) each; the time of the least share where all exceed it. Where
    actions are joint velocities, their shares of ``SHARE_OF_SPEED`` count like those of efforts.

    Times T scale efforts exactly: those of accelerations by 1 / T^2, of friction by 1 / T, and gravity not.
    """
    unit = at_shares(ways, np.broadcast_to(SAMPLES, (len(ways), len(SAMPLES))))
    still = np.zeros_like(unit.phi)
    weight = model.efforts(unit.phi, still, still)
    friction = model.friction * unit.phid
    inertial = model.efforts(*unit) - weight - friction
    seconds = np.broadcast_to(seconds if seconds.ndim > 1 else seconds[:, None], (len(seconds), len(ways)))
    times = seconds[..., None, None]
    loads = np.stack(
        [(np.abs(inertial / t**2 + friction / t + weight) / model.limits).max(axis=(1, 2)) for t in times]
    )
    if model.speeds is not None:
        shares = (np.abs(unit.phid) / (SHARE_OF_SPEED * model.speeds)).max(axis=(1, 2))
        loads = np.maximum(loads, shares / seconds)
    best = np.where((loads < most).any(axis=0), (loads < most).argmax(axis=0), loads.argmin(axis=0))[None]
    return np.take_along_axis(seconds, best, axis=0)[0], np.take_along_axis(loads, best, axis=0)[0]


def latest_end(numbers: Mapping[str, Array], dt: float) -> Array:
    """Times (n,) [s] by which motions have to end for the goal to be held in the last steps of an episode, as
    its numbers say; infinite in an episode without a limit."""
    moving = np.subtract(numbers.get("limit", np.inf), numbers.get("hold_steps", 0.0))
    latest: Array = np.maximum(np.atleast_1d(moving) * dt - REST, SOONEST)
    return latest


def timed(ways: Array, seconds: Array, dt: float, steps: int) -> Motion:
    """Motion along ways (n, points, joints) in the times ``seconds`` (n,), at 0, dt, ..; at rest after."""
    s = np.minimum(np.arange(steps + 1) * dt / seconds[:, None], 1.0)
    unit, per = at_shares(ways, s), 1.0 / seconds[:, None, None]
    return Motion(unit.phi, unit.phid * per, unit.phidd * per**2)


def quintic(phi: Array, phid: Array, end: Array, seconds: float, dt: float, steps: int) -> Motion:
    """Motion from states (n, joints) to poses at rest in ``seconds``, by polynomials of fifth degree whose
    acceleration is 0 at both ends; at rest after."""
    s = np.minimum(np.arange(steps + 1) * dt / seconds, 1.0)[:, None]
    share, rate, change = minimum_jerk(s)
    # beside minimum jerk: a part with the first rate and no way
    more = s - 6.0 * s**3 + 8.0 * s**4 - 3.0 * s**5
    more_rate = 1.0 - 18.0 * s**2 + 32.0 * s**3 - 15.0 * s**4
    more_change = -36.0 * s + 96.0 * s**2 - 60.0 * s**3
    way, start = (end - phi)[:, None], phid[:, None]
    return Motion(
        phi[:, None] + way * share + start * seconds * more,
        way * rate / seconds + start * more_rate,
        way * change / seconds**2 + start / seconds * more_change,
    )
