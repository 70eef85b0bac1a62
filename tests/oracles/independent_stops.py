"""A simulation of an arm with hard stops that shares no code with the package.

Dense equations of motion from the point masses, SciPy's DOP853 with event location, impulses and resting
sliders found by trying every set of contacts. It favours simplicity over speed: the compiled core is compared
with it.
"""

from __future__ import annotations

import cmath
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]
BOUNCE = 1e-9
"""A slider whose bounce stays below this comes to rest, m; at elastic stops only if it is rounding."""
ROUNDING = 1e-13
"""A speed into a stop that counts as zero, m/s."""
MOST_CONTACTS = 600
MOST_IMPACTS = 10_000
"""Most impacts at one time, of sliders that strike in turn at both stops."""


@dataclass(frozen=True)
class StoppedArm:
    """A chain of revolute joints R and sliders P, with upright gravity, viscous joint friction and stops."""

    masses: tuple[float, ...]  # kg
    lengths: tuple[float, ...]  # m
    g: float  # m/s^2
    friction: float  # N m s/rad and N s/m, in every joint
    upper: float  # travel of all sliders from 0, m
    restitution: float
    types: str = "RPRP"

    @property
    def sliders(self) -> list[int]:
        return [k for k, kind in enumerate(self.types) if kind == "P"]

    def equations(self, y: Array, efforts: Array) -> tuple[Array, Array]:
        """Mass matrix (n, n) and the forces on the right-hand side (n,) at q, qd = y.

        A point is a complex number: each joint adds a length along the direction of the last revolute one.
        """
        q, qd = np.split(y, 2)
        n, lengths, turned, direction = len(q), iter(self.lengths), -1, 1.0 + 0.0j
        M, forces = np.zeros((n, n)), np.zeros(n)
        jacobian, acceleration = np.zeros(n, complex), 0.0j  # of the point so far, at qdd = 0
        for k, (kind, mass) in enumerate(zip(self.types, self.masses, strict=True)):
            rate, before = qd[k], turned
            if kind == "R":
                length, turned, direction = next(lengths), k, cmath.exp(1j * q[k])
                if before >= 0:
                    rate = rate - qd[before]
            else:
                length, jacobian[k] = q[k], direction
            if turned >= 0:
                jacobian[turned] += 1j * length * direction
                acceleration -= length * qd[turned] ** 2 * direction
                if kind == "P":
                    acceleration += 2j * qd[k] * qd[turned] * direction
            M += mass * np.outer(jacobian.conj(), jacobian).real
            forces -= mass * (jacobian.conj() * (acceleration + 1j * self.g)).real
            effort = efforts[k] - self.friction * rate
            forces[k] += effort
            if kind == "R" and before >= 0:  # the motor reacts on the link before
                forces[before] -= effort
        return M, forces

    def motion(self, y: Array, efforts: Array, held: Sequence[int]) -> tuple[Array, Array]:
        """Accelerations (n,), and the forces (n,) that hold some sliders in position."""
        M, forces = self.equations(y, efforts)
        free = [k for k in range(len(forces)) if k not in held]
        qdd, hold = np.zeros_like(forces), np.zeros_like(forces)
        qdd[free] = np.linalg.solve(M[np.ix_(free, free)], forces[free])
        hold[list(held)] = (M @ qdd - forces)[list(held)]
        return qdd, hold

    def after(self, q: Array, qd: Array, efforts: Array, seconds: float, rtol: float = 1e-12) -> Array | None:
        """q, qd (2 n,) after some seconds of constant efforts; None after too many contacts."""
        from scipy.integrate import solve_ivp

        y, t, n = np.concatenate([q, qd]), 0.0, len(q)
        held: dict[int, float] = {}
        left: set[int] = set()
        for _ in range(MOST_CONTACTS):
            y, held = self._contacts(y, efforts, held, left)
            joints = tuple(held)

            def slope(_: float, y: Array, joints: tuple[int, ...] = joints) -> Array:
                return np.concatenate([y[n:], self.motion(y, efforts, joints)[0]])

            events, names = [], []
            for joint in self.sliders:
                if joint in held:
                    events.append(_terminal(t, self._pull, joint, held[joint], joints, efforts))
                    names.append((joint, 0.0))
                else:
                    events.append(_terminal(t, lambda y, j: y[j] - self.upper, joint))
                    events.append(_terminal(t, lambda y, j: -y[j], joint))
                    names += [(joint, 1.0), (joint, -1.0)]
            free = [j for j in self.sliders if j not in held]
            turns = [lambda _, y, j=j: y[n + j] for j in free]
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
        n, at = len(self.types), [j for j in self.sliders if y[j] >= self.upper or y[j] <= 0.0]
        sides = {j: 1.0 if y[j] >= self.upper else -1.0 for j in at}
        if not sides:
            return y, {}
        joints = list(sides)
        s = np.array([sides[j] for j in joints])
        y = y.copy()
        M, _ = self.equations(y, efforts)
        W = np.linalg.inv(M)[np.ix_(joints, joints)] * np.outer(s, s)
        columns = np.linalg.inv(M)[:, joints] * s
        leave = {j for j, u in zip(joints, s * y[n:][joints], strict=True) if u < -ROUNDING and j not in held}
        for _ in range(MOST_IMPACTS):
            u = s * y[n:][joints]
            if not (u > ROUNDING).any():
                break
            # Sliders without velocity are held if their stops press them, whether they were held before or
            # not.
            standing = [j for j, v in zip(joints, u, strict=True) if abs(v) <= ROUNDING and j not in left]
            held = {j: sides[j] for j in self._supported(y, efforts, standing, sides)}
            # A slider that moves away from its stop is struck when an impact of the other has sent it back.
            here = [k for k, j in enumerate(joints) if u[k] > ROUNDING or j in held]
            struck = (u + self.restitution * np.maximum(u, 0.0))[here]
            impulse = complementary(W[np.ix_(here, here)], struck)
            y[n:] -= columns[:, here] @ impulse
            for k, p in zip(here, impulse, strict=True):
                if p > 0.0 and u[k] > 0.0:
                    y[n + joints[k]] = -sides[joints[k]] * self.restitution * u[k]
                    leave.discard(joints[k])
        u = s * y[n:][joints]
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
            some, inverse = list(chosen), np.linalg.inv(M)
            y[n:] -= inverse[:, some] @ np.linalg.solve(inverse[np.ix_(some, some)], y[n:][some])
            y[n:][some] = 0.0
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
