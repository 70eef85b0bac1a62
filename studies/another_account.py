# mypy: allow-untyped-defs
"""A control interval by another account, which shares with the simulator the laws of single effects alone:
point masses as complex numbers and a dense mass matrix, without any elimination. SciPy's DOP853 integrates
them in the angles and travels of the joints and locates events; what a joint without a rate does, and which
stops an impact involves, is found by trying every possibility. A lane takes up to a second."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np

from redundant_envs.effects.hooks import SPEED, Field, Force, Friction, Gap, Impact, Impulse, Inertia
from redundant_envs.scenes.scene import Scene

BOUNCE = 1e-15
"""A joint whose bounce stays below this comes to rest, rad or m."""
SLOW = 1e-13
"""A rate into a stop that counts as none."""
TORN = 1e-12
"""Share of the limit of a friction by which holding a joint has to exceed it."""
MAX_EVENTS = 400
MIN_STEPS, SHORTEST = 40, 1e-18
ELSEWHERE = -np.inf, np.inf, 0.0
"""Ends and restitution of a joint without stops."""


def tells(scene: Scene) -> bool:
    """Whether this account knows everything in a scene."""
    return not scene.attached.of(Gap, Impulse)


def complementary(W, d):
    """p >= 0 with W p - d >= 0 and p (W p - d) = 0, by trying every set."""
    n = len(d)
    for count in range(n + 1):
        for chosen in itertools.combinations(range(n), count):
            p, k = np.zeros(n), list(chosen)
            p[k] = np.linalg.solve(W[np.ix_(k, k)], d[k])
            if (p >= 0.0).all() and (W @ p - d >= -1e-12 * np.abs(d).max()).all():
                return p
    raise ArithmeticError(f"no impulses fit the mobility {W.tolist()} and the speeds {d.tolist()}")


class Known(dict[str, Any]):
    """Quantities by name."""

    def each(self, names):
        return [self[name] for name in names]


class Account:
    """One lane of a scene with numbers of its own, by name, and commands, (1, joints). States y have angles
    and travels of joints, their rates, and states of effects; those of joints that have been at a stop count
    from there, so that the lowest bounce has all its digits."""

    def __init__(self, scene: Scene, numbers: Mapping[str, np.ndarray], commands: np.ndarray) -> None:
        self.scene, self.arm, self.B = scene, scene.robot, np.asarray(scene.robot.motor_map)
        self.quantities = dict(numbers) | {"control_dt": np.full(len(commands), scene.control_dt)}
        self.quantities |= {f"command{k + 1}": u for k, u in enumerate(commands.T)}
        self.acting = self.B if scene.actuation == "joint" else np.eye(len(self.B))
        x: Any = Known(self.quantities)
        self.instants = [(a, np.asarray(a.functions["after"](x))) for a in scene.attached.instants]
        self.moving = [name for a in scene.attached for name, f in a.states.items() if "derivative" in f]
        n = len(self.arm.joints)
        self.n, self.rates, self.inverse = n, slice(n, 2 * n), np.linalg.inv(self.B)
        self.origin, self.loose = np.zeros(n), set[int]()
        self.stops = {
            a.hook.joint: tuple(
                float(x[a.parameter(name)][0]) for name in (a.hook.lower, a.hook.upper, a.hook.restitution)
            )
            for a in scene.attached.of(Impact)
        }
        self.frictions = scene.attached.of(Friction)
        self.rough = {a.hook.joint for a in self.frictions}

    def points(self, x, q, qd=None):
        """Point masses, (lanes,) complex each, and their Jacobians and accelerations at qdd = 0."""
        place, points, turned, direction = 0j, [], -1, np.ones(len(q), complex)
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
            points.append((place, J, bias))
        return points

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

    def terms(self, y):
        """Mobilities W, accelerations without contacts, rates of states, and limits of friction."""
        q, qd = self.motion(y)
        M, forces, changes, x = self.equations(self.known, np.concatenate([q, qd, y[2 * self.n :]])[None])
        W, free = (self.B.T @ np.linalg.solve(M[0], right) for right in (self.B, forces[0]))
        limits = np.zeros(self.n)
        for a in self.frictions:
            law, speed = a.functions["limit"], np.abs(y[self.rates][[a.hook.joint]])
            limits[a.hook.joint] += law.on(speed if name == SPEED else x[name] for name in law.names)[0]
        return W, free, changes[0], limits

    def motion(self, y):
        """Coordinates and velocities, (joints,) each."""
        return (self.origin + y[: self.n]) @ self.inverse, y[self.rates] @ self.inverse

    def ends(self, k):
        """The stops of a joint, from its origin."""
        low, high, _ = self.stops.get(k, ELSEWHERE)
        return low - self.origin[k], high - self.origin[k]

    def side(self, y, k):
        """Side of the stop that a joint is at; 0 if it is at none."""
        low, high = self.ends(k)
        return 1.0 if y[k] >= high else -1.0 if y[k] <= low else 0.0

    def arrive(self, y, k, end):
        """Put the origin of a joint at its stop, ``end`` from the present one, where it is."""
        self.origin[k], y[k] = self.origin[k] + end, 0.0

    def moved(self, terms, modes):
        """Accelerations of joints, and forces along them: those with the mode 0 are held, others slip."""
        W, free, _, limits = terms
        push, held = -limits * modes, np.flatnonzero(modes == 0.0)
        push[held] = -np.linalg.solve(W[np.ix_(held, held)], (free + W @ push)[held])
        a = free + W @ push
        a[held] = 0.0
        return a, push

    def modes(self, y):
        """What the joints do, and the terms: 1 and -1 slip that way, 0 is held by friction or a stop."""
        terms, modes = self.terms(y), np.sign(y[self.rates])
        modes[[k for k in range(self.n) if k not in self.stops and k not in self.rough]] = 1.0
        still = np.flatnonzero(modes == 0.0)
        off, best = np.inf, modes
        for some in itertools.product((0.0, 1.0, -1.0), repeat=len(still)):
            tried = modes.copy()
            tried[still] = some
            here = self.contradiction(y, terms, tried, still)
            if here < off:
                off, best = here, tried
        return best, terms

    def contradiction(self, y, terms, modes, still):
        """By how much the accelerations contradict the modes of joints without a rate; 0 if they do not."""
        (W, _, _, limits), (a, push) = terms, self.moved(terms, modes)
        violations = [0.0]
        for k in still:
            side = self.side(y, k)
            if modes[k] == 0.0:
                off = W[k, k] * (self.held_by(push[k], side) - limits[k])
                violations.append(np.inf if k in self.loose else off)
            else:
                violations.append(np.inf if modes[k] == side else -modes[k] * a[k])
        return max(violations)

    @staticmethod
    def held_by(push, side):
        """What friction has to hold a joint with: a stop holds it in one direction."""
        return abs(push) if side == 0.0 else side * push

    def struck(self, y):
        """The state after all impacts of an instant, and their joints. Stops that are struck, and those at
        which joints rest, support the arm; a joint that moves out is not supported, and may be struck
        next."""
        hit = set()
        for _ in range(MAX_EVENTS):
            at = [k for k in self.stops if self.side(y, k)]
            sides = np.array([self.side(y, k) for k in at])
            into = sides * y[self.rates][at]
            if not (into > SLOW).any():
                y[self.n + np.array(at, int)[into > 0.0]] = 0.0
                return y, hit
            W, free, *_ = self.terms(y)
            supports = (into > SLOW) | ((abs(into) <= SLOW) & (sides * free[at] >= 0.0))
            s, mobility = np.flatnonzero(supports), W[np.ix_(at, at)] * np.outer(sides, sides)
            bounce = np.array([self.stops[k][2] for k in at]) * np.maximum(into, 0.0)
            p = np.zeros(len(at))
            p[s] = complementary(mobility[np.ix_(s, s)], (into + bounce)[s])
            y = y.copy()
            y[self.rates] -= W[:, at] @ (sides * p)
            for i in np.flatnonzero(p > 0.0):
                y[self.n + at[i]] = -sides[i] * bounce[i]
                hit.add(at[i])
        raise ArithmeticError("impacts do not end")

    def settled(self, y, hit):
        """The state without bounces that are too low; who leaves a stop without an impact does not rest."""
        modes, terms = self.modes(y)
        (W, _, _, limits), (a, _) = terms, self.moved(terms, modes)
        at = [k for k in self.stops if self.side(y, k)]
        low = []
        for k in at:
            rate, press = y[self.n + k], self.side(y, k) * a[k] - 2.0 * W[k, k] * limits[k]
            fades = (self.stops[k][2] < 1.0 and k in hit) or abs(rate) <= SLOW
            pressed = press > 0.0 and self.side(y, k) * rate < 0.0
            low += [k] if fades and pressed and rate * rate <= 2.0 * press * BOUNCE else []
        if low:
            y, held = y.copy(), [k for k in at if k in low or y[self.n + k] == 0.0]
            y[self.rates] -= W[:, held] @ np.linalg.solve(W[np.ix_(held, held)], y[self.rates][held])
            y[self.rates][held] = 0.0
        return y

    def after(self, q, qd, states, error):
        """The tip at the end of the interval, (1, 2) m; NaN after too many events."""
        try:
            q, _ = self.motion_after(q, qd, states, error)
        except ArithmeticError:
            return np.full((1, 2), np.nan)
        tip = self.points(self.quantities, q[None])[-1][0]
        return np.stack([tip.real, tip.imag], axis=1)

    def motion_after(self, q, qd, states, error):
        """Coordinates and velocities then, (joints,) each."""
        self.quantities |= states
        dt, t = self.scene.control_dt, 0.0
        y = np.concatenate([q[0] @ self.B, qd[0] @ self.B, *(states[name] for name in self.moving)])
        for k in self.stops:
            if side := self.side(y, k):
                self.arrive(y, k, self.ends(k)[side > 0.0])
        for end in sorted({float(at[0]) for _, at in self.instants if 0.0 < at[0] < dt} | {dt}):
            passed = {a.passed: np.where((at >= 0.0) & (at <= t), 1.0, 0.0) for a, at in self.instants}
            self.known = self.quantities | passed
            y, t = self.crossed(y, t, end, error), end
        return self.motion(y)

    def crossed(self, y, t, end, error):
        """The state at the end of a piece of the interval."""
        for _ in range(MAX_EVENTS):
            if t >= end:
                return y
            y = self.settled(*self.struck(y))
            modes, terms = self.modes(y)
            self.loose.clear()
            t, y = self.to_event(y, modes, self.moved(terms, modes)[0], t, end, error)
        raise ArithmeticError("events do not end")

    def to_event(self, y, modes, a, t, end, error):
        """The time and state of the next event, or of the end. SciPy sees events at the ends of its steps
        alone: these start short, as bounces may be, and end where a joint turns; if it turns beyond its stop,
        again until then."""
        from scipy.integrate import solve_ivp

        def slope(_, y):
            terms = self.terms(y)
            return np.concatenate([y[self.rates], self.moved(terms, modes)[0], terms[2]])

        events, until, longest = self.events(y, modes), end, self.scene.control_dt / MIN_STEPS
        leaving = [k for k in self.stops if modes[k] and self.side(y, k) and y[self.n + k] * a[k]]
        first = max(min([longest, *(0.25 * abs(y[self.n + k] / a[k]) for k in leaving)]), SHORTEST)
        while True:
            solution = solve_ivp(  # atol is the stricter one where a coordinate is below 1
                slope, (t, until), y, "DOP853", events=[e for e, _ in events], rtol=max(error, 3e-14),
                atol=1e-2 * error, first_step=min(first, until - t), max_step=longest,
            )  # fmt: skip
            if not solution.success:
                raise ArithmeticError(solution.message)
            time, after = float(solution.t[-1]), solution.y[:, -1].copy()
            ends = {k: self.ends(k) for k in self.stops}
            if time == until or all(low <= after[k] <= high for k, (low, high) in ends.items()):
                break
            until = time
        for (_, then), times in zip(events, solution.t_events, strict=True):
            if len(times):
                then(after)
        return time, after

    def events(self, y, modes):
        """Functions whose passage through 0 ends the modes, and what to do with the state then."""
        return [event for k in sorted({*self.stops, *self.rough}) for event in self.events_of(k, y, modes)]

    def events_of(self, k, y, modes):
        """Those of a joint: what holds it tears, or it comes to rest or to a stop."""
        if modes[k] == 0.0:
            side = self.side(y, k)

            def torn(y):  # by how much what holds the joint exceeds the limit of its friction
                terms = self.terms(y)
                push = self.moved(terms, modes)[1][k]
                return self.held_by(push, side) - terms[3][k] * (1.0 + TORN) - SLOW

            return [(_event(torn, 1.0), lambda y: self.loose.add(k))]

        def stands(y):
            y[self.n + k] = 0.0

        events = [(_event(lambda y: y[self.n + k], -modes[k]), stands)]
        for end, way in zip(self.ends(k), (-1.0, 1.0), strict=True):
            if np.isfinite(end):
                beyond = _event(lambda y, end=end, way=way: way * (y[k] - end), 1.0)
                events.append((beyond, functools.partial(self.arrive, k=k, end=end)))
        return events


def contact_motion(scene, start, error):
    """Coordinates after an interval of a scene with its own numbers, (lanes, joints); ``start`` has
    coordinates, velocities and efforts, (lanes, joints) each."""
    numbers = {name: np.array([value]) for name, value in scene.parameters().items()}
    lanes = zip(*start, strict=True)
    return np.array(
        [Account(scene, numbers, u[None]).motion_after(q[None], qd[None], {}, error)[0] for q, qd, u in lanes]
    )


def complex_of(pair):
    return pair[0] + 1j * np.asarray(pair[1])


def _event(function, direction):
    """A terminal event of SciPy."""

    def asked(_, y):
        return function(y)

    asked.terminal, asked.direction = True, direction
    return asked
