# mypy: allow-untyped-defs
"""A control interval by another account, which shares with the simulator the laws of single effects alone:
point masses as complex numbers, a dense mass matrix, and the extrapolated midpoint rule with steps of each
lane's own. It has no elimination, no events and no pieces; a change of a law makes steps short."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

import numpy as np

from redundant_envs.effects.hooks import Field, Force, Friction, Gap, Impact, Impulse, Inertia
from redundant_envs.scenes.scene import Scene

COLUMNS = 2.0 * np.arange(1, 7)
"""Substeps of the columns of an extrapolation: the last one has order 12, the error is that of order 10."""
MIN_STEP = 1e-11
"""A step this small as a share of the interval is taken whatever its error: a law changes in it."""
MAX_STEPS = 100
NOT_TOLD = Friction, Impact, Gap, Impulse
"""Hooks that this account does not know."""


class Known(dict[str, Any]):
    """Quantities by name."""

    def each(self, names):
        return [self[name] for name in names]


def tells(scene: Scene) -> bool:
    """Whether it knows everything in a scene."""
    return not scene.attached.of(*NOT_TOLD)


class Account:
    """Lanes of a scene with numbers of their own, by name, and commands, (lanes, joints)."""

    def __init__(self, scene: Scene, numbers: Mapping[str, np.ndarray], commands: np.ndarray) -> None:
        self.scene, self.arm, self.B = scene, scene.robot, np.asarray(scene.robot.motor_map)
        self.given = dict(numbers) | {"control_dt": np.full(len(commands), scene.control_dt)}
        self.given |= {f"command{k + 1}": u for k, u in enumerate(commands.T)}
        self.acting = self.B if scene.actuation == "joint" else np.eye(len(self.B))
        x: Any = Known(self.given)
        self.instants = [(a, np.asarray(a.functions["after"](x))) for a in scene.attached.instants]
        self.moving = [name for a in scene.attached for name, f in a.states.items() if "derivative" in f]

    def points(self, x, q, qd=None):
        """Point masses, (lanes,) complex each, and their Jacobians and accelerations at qdd = 0."""
        place, found, turned, direction = 0j, [], -1, np.ones(len(q), complex)
        J, bias, lengths = np.zeros(q.shape, complex), 0j, 0
        for k, slides in enumerate(self.arm.prismatic):
            if slides:
                length, J = q[:, k], J.copy()
                J[:, k] = direction
            else:
                lengths, turned, direction, J = lengths + 1, k, np.exp(1j * q[:, k]), J.copy()
                length = x[f"l{lengths}"]
            if turned >= 0 and qd is not None:
                J[:, turned] += 1j * length * direction
                bias = bias - length * qd[:, turned] ** 2 * direction
                bias = bias + 2j * qd[:, k] * qd[:, turned] * direction * slides
            place = place + length * direction
            found.append((place, J, bias))
        return found

    def slope(self, known, y):
        """Rates of coordinates, velocities and states of effects."""
        n = len(self.arm.joints)
        M, forces, rates, _ = self.equations(known, y)
        qdd = np.linalg.solve(M, forces[:, :, None])[:, :, 0]
        return np.concatenate([y[:, n : 2 * n], qdd, rates], axis=1)

    def equations(self, known, y):
        """Mass matrix, (lanes, joints, joints), forces, rates of states of effects, and all quantities."""
        n, every = len(self.arm.joints), self.scene.attached
        q, qd = y[:, :n], y[:, n : 2 * n]
        x = Known(known)
        x |= dict(zip(self.moving, y[:, 2 * n :].T, strict=True))
        for k, (phi, phid) in enumerate(zip((q @ self.B).T, (qd @ self.B).T, strict=True)):
            x |= {f"phi{k + 1}": phi, f"phid{k + 1}": phid}
        points = self.points(x, q, qd)
        for k, (place, J, _) in enumerate(points):
            v = (J * qd).sum(axis=1)
            parts = {"x": place.real, "y": place.imag, "vx": v.real, "vy": v.imag}
            x |= {f"{name}{k + 1}": part for name, part in parts.items()}
        fields = [complex_of(a.functions["function"](x)) for a in every.of(Field)]
        field = sum(fields, np.zeros(len(q), complex))
        M, forces = np.zeros((len(q), n, n)), np.zeros((len(q), n))
        for k, (_, J, bias) in enumerate(points):
            loads = every.carried.get(f"m{k + 1}", ())
            m = x[f"m{k + 1}"] + sum(x[name] for name in loads)
            M += m[:, None, None] * (J.conj()[:, :, None] * J[:, None, :]).real
            forces -= m[:, None] * (J.conj() * (bias + field)[:, None]).real
        for a in every.of(Inertia):
            along = self.B[:, list(a.hook.joints)].sum(axis=1)
            M += x[a.parameter(a.hook.inertia)][:, None, None] * np.outer(along, along)
        changes = {}
        for a in every.of(Field, Force):
            a.settle_law(x)
            changes |= a.changes("derivative", x)
            if isinstance(a.hook, Force):
                f = a.functions["function"](x)
                if isinstance(a.hook.joint, int):
                    forces += np.multiply.outer(f, self.B[:, a.hook.joint])
                else:
                    forces += (points[a.hook.joint.number][1].conj() * complex_of(f)[:, None]).real
        for k, (command, chain) in enumerate(every.chains.items()):
            for link in chain:
                link.settle_law(x)
                changes |= link.changes("derivative", x)
                x[command] = link.functions["function"](x)
            forces += np.multiply.outer(x[command], self.acting[:, k])
        rates = [np.broadcast_to(changes[name], len(q)) for name in self.moving]
        return M, forces, np.array(rates).reshape(-1, len(q)).T, x

    def after(self, q, qd, states, error):
        """Tips at the end of the interval, (lanes, 2) m, of steps with some ``error``, relative to 1 and to
        the numbers; NaN for lanes that take too many."""
        self.given |= states
        count, dt = len(q), self.scene.control_dt
        y = np.concatenate([q, qd, *(states[name][:, None] for name in self.moving)], axis=1)
        t, h = np.zeros(count), np.full(count, dt / 16.0)
        breaks = [np.where((at >= 0.0) & (at < dt), at, np.inf) + np.zeros(count) for _, at in self.instants]
        for _ in range(MAX_STEPS):
            (lanes,) = np.nonzero(t < dt)
            if not len(lanes):
                break
            now = t[lanes]
            nexts = [np.where(at[lanes] > now, at[lanes], dt) for at in breaks]
            end = np.min([np.full(len(lanes), dt), *nexts], axis=0)
            whole = now + 1.01 * h[lanes] >= end
            step = np.where(whole, end - now, h[lanes])
            known = {name: value[lanes] for name, value in self.given.items()}
            for (a, _), at in zip(self.instants, breaks, strict=True):
                known[a.passed] = np.where(at[lanes] <= now, 1.0, 0.0)
            with np.errstate(all="ignore"):
                best, off = extrapolated(functools.partial(self.slope, known), y[lanes], step)
                off = (off / (1.0 + np.abs(y[lanes]))).max(axis=1) / error
            off = np.where(np.isfinite(off), off, 1e9)
            taken = (off <= 1.0) | (step <= MIN_STEP * dt)
            done = lanes[taken]
            y[done] = best[taken]
            t[done] = np.where(whole, end, now + step)[taken]
            h[lanes] = step * np.clip(0.9 * np.maximum(off, 1e-12) ** (-1.0 / 11.0), 0.1, 4.0)
        n = len(self.arm.joints)
        tip = self.points(self.given, y[:, :n])[-1][0]
        return np.where((t < dt)[:, None], np.nan, np.stack([tip.real, tip.imag], axis=1))


def complex_of(pair):
    return pair[0] + 1j * np.asarray(pair[1])


def extrapolated(slope, y, step):
    """A step from y, and its error: midpoint rules of some substeps, extrapolated to none (Gragg 1965)."""
    first, table = slope(y), []
    for j, count in enumerate(COLUMNS):
        h = (step / count)[:, None]
        before, here = y, y + h * first
        for _ in range(int(count) - 1):
            before, here = here, before + 2.0 * h * slope(here)
        row = [0.5 * (here + before + h * slope(here))]
        for k in range(j):
            row.append(row[k] + (row[k] - table[k]) / ((count / COLUMNS[j - k - 1]) ** 2 - 1.0))
        last, table = table, row
    return table[-1], np.abs(table[-1] - last[-1])
