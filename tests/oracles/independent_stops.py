"""A simulation of the RPRP arm with hard stops that shares no code with the package.

Dense equations of motion, SciPy's DOP853 with event location, impulses and resting sliders found by trying
every set of contacts. It favours simplicity over speed, since the compiled core is compared with it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]
SLIDERS = (1, 3)
BOUNCE = 1e-9
"""A slider whose bounce stays below this comes to rest, m; at elastic stops only if it is rounding."""
ROUNDING = 1e-13
"""A speed into a stop that counts as zero, m/s."""
MOST_CONTACTS = 600
MOST_IMPACTS = 10_000
"""Most impacts at one time, of sliders that strike in turn at both stops."""


@dataclass(frozen=True)
class StoppedArm:
    """An RPRP arm with upright gravity, viscous joint friction and stops."""

    masses: tuple[float, ...]  # kg
    lengths: tuple[float, ...]  # m
    g: float  # m/s^2
    friction: float  # N m s/rad and N s/m, in every joint
    upper: float  # travel of both sliders from 0, m
    restitution: float

    def equations(self, y: Array, efforts: Array) -> tuple[Array, Array]:
        """Mass matrix (4, 4) and the forces on the right-hand side (4,) at q, qd = y."""
        theta1, r1, theta2, r2, w1, v1, w2, v2 = (float(x) for x in y)
        m1, m2, m3, m4 = self.masses
        l1, l2 = self.lengths
        a, b = l1 + r1, l2 + r2
        c, s = math.cos(theta1 - theta2), math.sin(theta1 - theta2)
        mu, sigma = m2 + m3 + m4, m3 * l2 + m4 * b
        M = np.diag([m1 * l1**2 + mu * a**2, mu, m3 * l2**2 + m4 * b**2, m4])
        M[0, 2] = M[2, 0] = a * sigma * c
        M[0, 3] = M[3, 0] = -m4 * a * s
        M[1, 2] = M[2, 1] = sigma * s
        M[1, 3] = M[3, 1] = m4 * c
        h1 = a * (2 * mu * v1 * w1 + sigma * s * w2**2 + 2 * m4 * v2 * w2 * c)
        h2 = -mu * a * w1**2 - sigma * c * w2**2 + 2 * m4 * v2 * w2 * s
        h3 = sigma * (2 * v1 * w1 * c - a * w1**2 * s) + 2 * m4 * b * v2 * w2
        h4 = -m4 * (a * w1**2 * c + 2 * v1 * w1 * s + b * w2**2)
        G1, G2 = (m1 * l1 + mu * a) * math.cos(theta1), mu * math.sin(theta1)
        weight = self.g * np.array([G1, G2, sigma * math.cos(theta2), m4 * math.sin(theta2)])
        t1, f1, t2, f2 = efforts
        t1, f1 = t1 - self.friction * w1, f1 - self.friction * v1
        t2, f2 = t2 - self.friction * (w2 - w1), f2 - self.friction * v2
        return M, np.array([t1 - t2 - h1, f1 - h2, t2 - h3, f2 - h4]) - weight

    def motion(self, y: Array, efforts: Array, held: Sequence[int]) -> tuple[Array, Array]:
        """Accelerations (4,), and the forces (4,) that hold some sliders in position."""
        M, forces = self.equations(y, efforts)
        free = [k for k in range(4) if k not in held]
        qdd, hold = np.zeros(4), np.zeros(4)
        qdd[free] = np.linalg.solve(M[np.ix_(free, free)], forces[free])
        hold[list(held)] = (M @ qdd - forces)[list(held)]
        return qdd, hold

    def after(self, q: Array, qd: Array, efforts: Array, seconds: float, rtol: float = 1e-12) -> Array | None:
        """q, qd (8,) after some seconds of constant efforts; None after too many contacts."""
        from scipy.integrate import solve_ivp

        y, t = np.concatenate([q, qd]), 0.0
        held: dict[int, float] = {}
        left: set[int] = set()
        for _ in range(MOST_CONTACTS):
            y, held = self._contacts(y, efforts, held, left)
            joints = tuple(held)

            def slope(_: float, y: Array, joints: tuple[int, ...] = joints) -> Array:
                return np.concatenate([y[4:], self.motion(y, efforts, joints)[0]])

            events, names = [], []
            for joint in SLIDERS:
                if joint in held:
                    events.append(_terminal(t, self._pull, joint, held[joint], joints, efforts))
                    names.append((joint, 0.0))
                else:
                    events.append(_terminal(t, lambda y, j: y[j] - self.upper, joint))
                    events.append(_terminal(t, lambda y, j: -y[j], joint))
                    names += [(joint, 1.0), (joint, -1.0)]
            free = [j for j in SLIDERS if j not in held]
            turns = [lambda _, y, j=j: y[4 + j] for j in free]
            # SciPy sees only the ends of its steps: they start short, because of bounces, and the motion
            # ends when a slider turns beyond a stop that it passes twice in a step.
            first, longest, end = min(1e-9, 0.5 * (seconds - t)), seconds / 40, seconds
            while True:
                piece = solve_ivp(
                    slope, (t, end), y, "DOP853", events=[*events, *turns], rtol=rtol, atol=rtol,
                    max_step=longest, first_step=min(first, 0.5 * (end - t)),
                )  # fmt: skip
                found = zip(free, piece.t_events[len(events) :], piece.y_events[len(events) :], strict=True)
                beyond = [
                    time
                    for joint, times, states in found
                    for time, state in zip(times, states, strict=True)
                    if time > t and not 0.0 <= state[joint] <= self.upper
                ]
                if not beyond or min(beyond) >= end:
                    break
                end = min(beyond)
            t, y = float(piece.t[-1]), piece.y[:, -1].copy()
            met = [name for name, times in zip(names, piece.t_events, strict=False) if len(times)]
            left = {joint for joint, side in met if side == 0.0}
            for joint, side in met:
                if side != 0.0:
                    y[joint] = self.upper if side > 0.0 else 0.0
            if not met or t >= seconds:
                return y if t >= seconds else None
        return None

    def _pull(self, y: Array, joint: int, side: float, held: Sequence[int], efforts: Array) -> float:
        """Force with which the stop of a resting slider would have to pull, N."""
        return float(side * self.motion(y, efforts, held)[1][joint])

    def _contacts(
        self, y: Array, efforts: Array, held: dict[int, float], left: set[int]
    ) -> tuple[Array, dict[int, float]]:
        """Velocities after all impacts, and the sliders that then rest, with their sides."""
        sides = {j: 1.0 if y[j] >= self.upper else -1.0 for j in SLIDERS if y[j] >= self.upper or y[j] <= 0.0}
        if not sides:
            return y, {}
        joints = list(sides)
        s = np.array([sides[j] for j in joints])
        y = y.copy()
        M, _ = self.equations(y, efforts)
        W = np.linalg.inv(M)[np.ix_(joints, joints)] * np.outer(s, s)
        columns = np.linalg.inv(M)[:, joints] * s
        leave = {j for j, u in zip(joints, s * y[4:][joints], strict=True) if u < -ROUNDING and j not in held}
        for _ in range(MOST_IMPACTS):
            u = s * y[4:][joints]
            if not (u > ROUNDING).any():
                break
            # Sliders without velocity are held if their stops press them, whether they were held before or
            # not.
            standing = [j for j, v in zip(joints, u, strict=True) if abs(v) <= ROUNDING and j not in left]
            held = {j: sides[j] for j in self._supported(y, efforts, standing, sides)}
            # A slider that moves away from its stop is struck when an impact of the other has sent it back.
            here = [n for n, j in enumerate(joints) if u[n] > ROUNDING or j in held]
            struck = (u + self.restitution * np.maximum(u, 0.0))[here]
            impulse = complementary(W[np.ix_(here, here)], struck)
            y[4:] -= columns[:, here] @ impulse
            for n, p in zip(here, impulse, strict=True):
                if p > 0.0 and u[n] > 0.0:
                    y[4 + joints[n]] = -sides[joints[n]] * self.restitution * u[n]
                    leave.discard(joints[n])
        u = s * y[4:][joints]
        qdd, _ = self.motion(y, efforts, [j for j in held if j in sides and j not in left])
        free_qdd, _ = self.motion(y, efforts, [])
        height = BOUNCE if self.restitution < 1.0 else 8.881784197001252e-16 * max(self.upper, 1.0)
        resting = []
        for j, speed, side in zip(joints, u, s, strict=True):
            press = max(side * qdd[j], side * free_qdd[j])
            low = press > 0.0 and speed**2 <= 2.0 * press * height and j not in leave
            if low or (j in held and speed > -ROUNDING):
                resting.append(j)
        chosen = self._supported(y, efforts, resting, sides)
        if chosen:
            k = list(chosen)
            inverse = np.linalg.inv(M)
            y[4:] -= inverse[:, k] @ np.linalg.solve(inverse[np.ix_(k, k)], y[4:][k])
            y[4:][k] = 0.0
        return y, {j: sides[j] for j in chosen}

    def _supported(
        self, y: Array, efforts: Array, may: Sequence[int], sides: Mapping[int, float]
    ) -> tuple[int, ...]:
        """Sliders held by their stops: no stop pulls, and no slider moves into a stop."""
        for count in range(len(may), -1, -1):
            for chosen in itertools.combinations(may, count):
                qdd, hold = self.motion(y, efforts, chosen)
                pushed = all(sides[j] * hold[j] <= 0.0 for j in chosen)
                if pushed and all(sides[j] * qdd[j] <= 0.0 for j in may if j not in chosen):
                    return chosen
        return ()


def _terminal(start: float, function: Any, *arguments: Any) -> Any:
    """An event that ends a piece of motion when function(y, *arguments) becomes positive after its start.

    At the start it may be 0: a slider that has just been struck or released.
    """

    def event(t: float, y: Array) -> float:
        return float(function(y, *arguments)) if t > start else -1.0

    event.terminal, event.direction = True, 1.0  # type: ignore[attr-defined]
    return event


def complementary(W: Array, d: Array) -> Array:
    """p >= 0 with W p - d >= 0 and p (W p - d) = 0, by trying every set."""
    n = len(d)
    for count in range(n + 1):
        for chosen in itertools.combinations(range(n), count):
            p = np.zeros(n)
            if chosen:
                k = list(chosen)
                p[k] = np.linalg.solve(W[np.ix_(k, k)], d[k])
            if (p >= 0.0).all() and (W @ p - d >= -1e-12 * np.abs(d).max()).all():
                return p
    raise ValueError(f"no impulses fit the mobility {W.tolist()} and the speeds {d.tolist()}")
