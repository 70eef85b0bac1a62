"""Does error control know the time scales of effects, do dampers brake, are closed forms solutions, and are
all numbers finite at rest?

Declared stiffness, damping and rates of states say how short steps must be before any error estimate exists.
Fixed steps evaluate the closed form of a state where error control integrates its derivative.
"""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from redundant_envs.effects.bound_hooks import TIME, Attached, Functions
from redundant_envs.effects.hooks import SPEED, Force, Obstacle, Point
from redundant_envs.effects.obstacles import clearance_functions
from redundant_envs.language.algebra import gives_of, numbered, where
from redundant_envs.language.dual import Dual, dual
from redundant_envs.language.quantities import Quantities
from redundant_envs.robots.checks import OF_LANES, OWN_NAMES
from redundant_envs.simulator.lane.direct import fields_of
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.verify.checks import ROUNDING, Array, Sample, check, ratio, worst_of
from redundant_envs.verify.equations import TILTED, columns
from redundant_envs.verify.promises import Finding, Promise, at_most

SHORT = at_most(1.5)
"""A step covers two radians of an oscillation, or two time constants of a decay; three are still in the
region of stability of rk8, and a declared number may leave out states that hardly occur."""
SLOWEST = 6.0  # decades of rates below the usual ones: friction that is smooth at 0 is steepest there
DRIVES = at_most(1e-6)  # largest positive power of a damper, in units of the largest power that it absorbs


class Motion:
    """Joint positions and rates at which the hooks of a scene are evaluated, and efforts."""

    def __init__(self, dynamics: Dynamics, joints: Array, rates: Array, efforts: Array | float = 0.0) -> None:
        self.dynamics, self.joints, self.rates = dynamics, joints, rates
        self.efforts = np.broadcast_to(efforts, (len(joints), len(dynamics.commands)))

    def values(
        self, more: Mapping[str, Any] | None = None, moved: int | None = None, faster: int | None = None
    ) -> Quantities:
        """All quantities, ``more`` given, with derivatives by a joint ``moved``, or ``faster``."""
        arm, d = self.dynamics.arm, self.dynamics
        back = np.linalg.inv(arm.motor_map)
        known: dict[str, Any] = fields_of(d) | d.effect_states.initial | dict.fromkeys(d.passed, 0.0)
        known[TIME] = known["interval"]
        known |= dict.fromkeys(numbered("command{}", d.count), 0.0)  # of links behind shared commands
        known |= {name: self.efforts[:, k] for k, name in enumerate(d.commands)}
        known |= {name: 0.0 if draw.normal else 0.5 for name, draw in d.draws.items()}  # their medians
        for names, numbers, joint in ((arm.coordinates, self.joints, moved), (arm.rates, self.rates, faster)):
            slopes = np.zeros(len(names)) if joint is None else back[joint]
            for name, x, s in zip(names, (numbers @ back).T, slopes.tolist(), strict=True):
                known[name] = Dual(x, s) if s else x
        x = Quantities({**TILTED, **known, **(more or {})}, d.functions, arm.sincos)
        x.update({n: value for n, value in d.begun(x).items() if n not in (more or {})})
        for a in d.scene.attached.along(x):
            a.settle_law(x)
        for k in d.slipping:
            rate = x[f"phid{k + 1}"]
            x[f"side_friction{k + 1}"], x[SPEED] = where(rate > 0.0, 1.0, where(rate < 0.0, -1.0, 0.0)), 0.0
        return x

    def slopes(self, a: Attached[Force], of_rate: bool) -> Array:
        """Derivatives of a force by its own position or rate: their largest sum of squares, a root of it."""
        function, count, plain = a.functions["function"], len(self.joints), self.values()
        if not isinstance(a.hook.joint, Point):
            x = self.values(faster=a.hook.joint) if of_rate else self.values(moved=a.hook.joint)
            return np.abs(np.broadcast_to(dual(function(x)).slope, count))
        forces: list[Any] = []
        for name in point_names(self.dynamics, a.hook.joint, of_rate):
            forces += function(self.values({alias: Dual(plain[alias], 1.0) for alias in name}))
        table = columns((dual(f).slope for f in forces), count).reshape(count, 2, 2)
        return np.asarray(np.linalg.norm(table, ord=2, axis=(1, 2)))


def point_names(dynamics: Dynamics, point: Point, of_rate: bool) -> list[list[str]]:
    """Names of the coordinates, or velocities, of the point of a force; the tip has two names for each."""
    number, form = point.number + 1, "v" if of_rate else ""
    last = number == dynamics.arm.num_masses
    return [[f"{form}{axis}{number}", *([f"tip_{form}{axis}"] if last else [])] for axis in "xy"]


def cases(trial: Sample, which: str) -> Iterator[tuple[Attached[Force], Motion]]:
    """Forces that declare a "stiffness" or "damping", with motions between and beyond their switches."""
    dynamics, (q, qd) = Dynamics(trial.scene), trial.poses
    rng = np.random.default_rng(trial.seed + 7)
    B = dynamics.arm.motor_map
    rates = qd @ B * 10.0 ** -(rng.uniform(0.0, SLOWEST, (len(q), 1)) ** (np.arange(len(q)) % 2)[:, None])
    for a in trial.scene.attached.of(Force):
        if not {"stiffness", "damping"} & a.functions.keys():
            continue
        joints = q @ B
        if a.hook.switch is not None:
            low, high = map(a.number, a.hook.switch)
            share = rng.uniform(0.0, 0.5, len(q)) * (high - low if np.isfinite(high - low) else 1.0)
            beyond = np.where(np.arange(len(q)) % 4 < 2, low - share, high + share)
            use = (np.arange(len(q)) % 2 == 0) & np.isfinite(beyond)
            joints[use, a.hook.joint] = beyond[use]
        if which in a.functions:
            yield a, Motion(dynamics, joints, rates)


def hinted(trial: Sample, which: str) -> Finding:
    """The largest ratio of the actual to the declared stiffness or damping of forces."""
    findings = []
    for a, motion in cases(trial, which):
        if which == "stiffness":
            motion = Motion(motion.dynamics, motion.joints, 0.0 * motion.rates)
        actual = motion.slopes(a, which == "damping")
        said = np.broadcast_to(a.functions[which](motion.values()), actual.shape)
        gap, where, state = trial.worst(np.where(np.isfinite(said), ratio(actual, said), np.nan))
        words = f"{a.key}: {which}= gives {said[state]:.6g} where it is {actual[state]:.6g}; give the largest"
        findings.append(Finding(gap, f"{where}, {a.key}", words))
    return worst_of(findings, f"no force declares a {which}")


@check("declared stiffness", SHORT)
def stiffness(trial: Sample) -> Finding:
    """The derivative of a force by its position, at rest, in units of the stiffness that it declares."""
    return hinted(trial, "stiffness")


@check("declared damping", SHORT)
def damping(trial: Sample) -> Finding:
    """The derivative of a force by its rate, in units of the damping that it declares."""
    return hinted(trial, "damping")


@check("dampers brake", DRIVES)
def dampers(trial: Sample) -> Finding:
    """A force that declares a damping dissipates energy: the part that its own rate causes has no positive
    power. Rates of other joints are left out: a damper between two joints may drive one of them."""
    findings = []
    for a, motion in cases(trial, "damping"):
        count = len(motion.joints)
        if isinstance(a.hook.joint, Point):
            names = point_names(motion.dynamics, a.hook.joint, of_rate=True)
            x = motion.values()
            rates = columns((x[name[0]] for name in names), count)
            still = motion.values({alias: 0.0 * x[name[0]] for name in names for alias in name})
        else:
            slow = np.where(np.arange(motion.rates.shape[1]) == a.hook.joint, 0.0, motion.rates)
            x, still = motion.values(), Motion(motion.dynamics, motion.joints, slow).values()
            rates = motion.rates[:, [a.hook.joint]]
        forces = (a.functions["function"](at) for at in (x, still))
        moving, resting = (columns(f if isinstance(f, tuple) else (f,), count) for f in forces)
        speed = np.linalg.norm(rates, axis=1)
        power = ((moving - resting) * rates).sum(axis=1)
        noise = ROUNDING * np.abs(moving).max(axis=1) * speed
        largest = np.linalg.norm(moving - resting, axis=1).max() * speed
        gap, where, state = trial.worst(ratio(np.maximum(power - noise, 0.0), largest))
        words = (
            f"{a.key}: declares a damping, and its rate adds {power[state]:.3g} W; turn the sign of the force"
        )
        findings.append(Finding(gap, f"{where}, {a.key}", words))
    return worst_of(findings, "no force declares a damping")


@check("declared rates of states", SHORT)
def rates_of_states(trial: Sample) -> Finding:
    """Derivatives of the rates of change of effects' states by these states, and the fastest motion of the
    states of a hook together, in units of the rates that they declare."""
    dynamics, (q, qd, efforts) = Dynamics(trial.scene), trial.states
    B, findings = dynamics.arm.motor_map, []
    motion = Motion(dynamics, q @ B, qd @ B, efforts)
    for a in dynamics.scene.attached:
        states = {field: functions for field, functions in a.states.items() if "derivative" in functions}
        said = [j for j, functions in enumerate(states.values()) if "rate" in functions]
        if not said:
            continue
        names = [dynamics.effect_states[field].name for field in states]
        plain = motion.values()
        slopes = np.zeros((len(q), len(states), len(states)))
        declared = np.full((len(states), len(q)), np.nan)
        for j, (field, functions) in enumerate(states.items()):
            x = motion.values({field: Dual(np.broadcast_to(plain[field], len(q)), 1.0)})
            for i, other in enumerate(states.values()):
                slopes[:, i, j] = dual(other["derivative"](x)).slope
            if "rate" in functions:
                declared[j] = functions["rate"](x)
        gaps = [ratio(slopes[:, j, j], declared[j]) for j in said]
        if len(said) == len(states) and np.isfinite(slopes).all():
            gaps.append(ratio(np.abs(np.linalg.eigvals(slopes)).max(axis=1), declared.max(axis=0)))
        most, where, _ = trial.worst(np.stack(gaps, axis=1), [*(names[j] for j in said), "together"])
        words = f"{a.key}: states change {most:.3g} times as fast as their rate= says; give the largest"
        findings.append(Finding(most, f"{where}, {a.key}", words))
    return worst_of(findings, "no state declares a rate")


SOLVED = at_most(1e-9)  # rounding is 1e-15 times the time in time constants, a wrong factor 1e-3 and more
DECADES = 4.0  # number of decades of times below the control interval: of states that decay within it as well
SPREAD = 2.0  # largest values of a state at the start, in units of that which it has an interval later


@check("closed forms of states", SOLVED)
def closed_forms(trial: Sample) -> Finding:
    """A closed form keeps the value of its state at the time 0, and its derivative by the time is that of the
    state, at the values that it gives, with all other quantities constant."""
    dynamics, (q, qd, efforts) = Dynamics(trial.scene), trial.states
    x = Motion(dynamics, q @ dynamics.arm.motor_map, qd @ dynamics.arm.motor_map, efforts).values()
    states = ((a, field, functions) for a in dynamics.scene.attached for field, functions in a.states.items())
    findings = [_closed_form(trial, x, *state) for state in states if "closed" in state[2]]
    return worst_of(findings, "no state has a closed form")


def _closed_form(trial: Sample, x: Quantities, a: Attached[Any], field: str, functions: Functions) -> Finding:
    """The largest gap between a closed form and its derivative, in units of the largest derivative."""
    count, interval = len(trial.states[0]), trial.scene.control_dt
    rng = np.random.default_rng(trial.seed + 9)
    times = interval * 10.0 ** -rng.uniform(0.0, DECADES, count)

    def at(function: str, value: Any, time: Any = 0.0) -> Any:
        values = {field: value, TIME: time}
        return functions[function].on(values[n] if n in values else x[n] for n in functions[function].names)

    later = np.broadcast_to(at("closed", x[field], interval), count)
    size = np.where(later == 0.0, 1.0, np.abs(later))
    start = size * rng.uniform(-SPREAD, SPREAD, count)
    jump = np.abs(at("closed", start) - start)
    then = dual(at("closed", start, Dual(times, np.ones(count))))
    slope, rate = np.broadcast_arrays(then.slope, at("derivative", then.value))
    sizes = at("derivative", start), slope, rate, (np.abs(start) + np.abs(then.value)) / interval
    largest = np.abs(np.broadcast_arrays(*sizes)).max(axis=0)
    most, where, state = trial.worst(np.maximum(ratio(slope - rate, largest), ratio(jump, size)))
    words = (
        f"{a.key}: closed= of {field!r} changes by {slope[state]:.6g} per second, and by {jump[state]:.3g} "
        f"at once; its derivative= is {rate[state]:.6g}: give the solution with all other quantities constant"
    )
    return Finding(most, f"{where}, {a.key}", words)


@check("numbers at rest", Promise(0.0, "quantities", "at most"))
def numbers_at_rest(trial: Sample) -> Finding:
    """Quantities of the arm, forces, links, changes of states, readings and accelerations are finite without
    velocities and efforts: in random poses, at ends of travel, straight, folded and square."""
    dynamics = Dynamics(trial.scene, track_work=True)
    q = np.concatenate([trial.states[0], trial.poses[0], trial.square])
    q = q[np.isfinite(dynamics.arm.points(q)).all(axis=(1, 2))]
    motion = Motion(dynamics, q @ dynamics.arm.motor_map, np.zeros_like(q))
    wrong, where = [], ""
    for what, value in _values(dynamics, motion):
        good = np.isfinite(np.broadcast_to(np.asarray(value, float), len(q)))
        if not good.all():
            pose = zip(dynamics.arm.joints, motion.joints[np.argmin(good)].round(4), strict=True)
            where = where or f"{what} at {', '.join(f'{k} {v:g}' for k, v in pose)}"
            wrong.append(what)
    words = (
        f"at rest, without efforts, {', '.join(wrong[:5])} {'is' if len(wrong) == 1 else 'are'} not finite; "
        "do not divide by a rate or an effort, which may be 0"
    )
    return Finding(len(wrong), where, words)


def _values(dynamics: Dynamics, motion: Motion) -> Iterator[tuple[str, Any]]:
    """The checked quantities, by names that a reader knows."""
    arm, x = dynamics.arm, motion.values()
    for a in dynamics.scene.attached:
        if isinstance(a.hook, Obstacle):
            continue  # its function is one of the ends of a link: see the clearances
        parts: list[Functions] = [a.functions, *a.states.values()]
        for field, function in (named for part in parts for named in part.items()):
            returned = function(x) if field != "kink" else ()
            for value in returned if isinstance(returned, tuple) else (returned,):
                yield f"{field} of {a.key}", value
    others = (f"the change of {name}" for name in dynamics.states[2 * dynamics.count :])
    names = [*numbered("qdd{}", len(arm.joints)), *others]
    yield from zip(names, dynamics.accelerations(motion.values()), strict=True)
    x.update({f"t{k + 1}": 0.0 for k in range(len(arm.joints))})
    outputs = {name for f in (*arm.functions, arm.column_norms) for name in gives_of(f)}
    clearances = clearance_functions(dynamics.scene.attached, arm)
    all_of_them = Quantities(x, (*dynamics.functions, arm.column_norms, *clearances), arm.sincos)
    for name in sorted(n for n in outputs if OWN_NAMES.fullmatch(n) or n in OF_LANES):
        yield name, all_of_them[name]
    for k, a in enumerate(dynamics.scene.attached.of(Obstacle), start=1):
        for j in range(arm.num_masses):
            yield f"clearance{k}_{j + 1} of {a.key}", all_of_them[f"clearance{k}_{j + 1}"]
