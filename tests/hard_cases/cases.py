"""The rows of hard cases by their numbers: what is simulated, which figures are asked, and their bounds.

``cases.yaml`` says what is hard about each, and which naive variants fail it.
"""

import math
from dataclasses import replace

import numpy as np

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.model.energy import kinetic_energy, potential_energy
from redundant_envs.verify.checks import random_states
from redundant_envs.verify.promises import at_least, at_most

from . import naive
from .hard_case import THEMES, Accelerations, Asked, Case, Figure, Run

LAB = rde.FourR((1.0,) * 4, (0.5,) * 4)
"""The 4R arm of 1 kg and 0.5 m each."""
SLIDING = rde.RPRP((1.0,) * 4, (0.5, 0.5))
UNEQUAL = rde.RPRP((2.0, 1.5, 1.0, 0.5), (0.3, 0.5))
HEAVY = rde.RPRP((1e6, 1.0, 1e-6, 1e-6), (1.0, 1.0))
"""Slider 1 carries 1 kg and nothing else moves."""
LIGHT = rde.FourR((1e-12, 1e-12, 1e-12, 1.0), (0.5,) * 4)
PARTICLE = rde.RPRP((1e-12, 1.0, 1e-12, 1e-12), (0.5, 0.5))
ZERO, UPRIGHT = np.zeros(4), np.full(4, np.pi / 2)
BENT = (0.3, 1.2, -2.0, 0.8), (1.0, -2.0, 3.0, -4.0)
FOLDED = (0.0, np.pi, 0.0, np.pi)
STATE_B = (0.2, 1.0, -0.5, 2.0), (6.0, -4.0, 8.0, -10.0)
"""98 J: chaotic, a Lyapunov time of 0.16 s."""
FIVE_IMPACTS = (0.3, 0.1, -0.4, 0.2), (1.0, 0.8, -2.0, -0.6)
"""In half a second between stops."""


def falling(arm=LAB, *effects, **how):
    return rde.Scene(arm, (e.Gravity(9.81), *effects), **how)


def stopped(arm=SLIDING, restitution=1.0, gravity=9.81, upper=(0.3, 0.3), **how):
    """Sliders between hard stops at 0 and ``upper``, m."""
    stop = e.PrismaticStop((0.0, 0.0), upper, restitution)
    return rde.Scene(arm, (e.Gravity(gravity), stop), **{"control_dt": 0.02, **how})


# ---- figures ----------------------------------------------------------------------------------------------


def energy(scene, q, qd):
    """Kinetic and potential energy, (...), J."""
    return kinetic_energy(scene, q, qd) + potential_energy(scene, q)


def energy_change(run, motion):
    """Largest change of the energy of any lane since the start, J; NaN of motions that are lost."""
    total = energy(run.scene, motion.q, motion.qd)
    return np.abs(total - total[0]).max()


def energy_kept(bound, unit="J off", scale=1.0, name="the energy"):
    """The change of the energy in units of a number, or of the largest energy at the start."""

    def number(run, motion):
        at_start = np.abs(energy(run.scene, motion.q[0], motion.qd[0])).max()
        return energy_change(run, motion) / (scale or at_start)

    return Asked(name, number, at_most(bound, unit))


def tips_off(run, q, reference):
    """Distances of tips from those of a reference: coordinates, or a number of equal steps, m."""
    exact = run.fine_end(reference).q if isinstance(reference, int) else np.asarray(reference)
    kinematics = run.scene.robot.forward_kinematics
    return np.linalg.norm(kinematics(q) - kinematics(exact), axis=-1)


def tip(name, reference, bound):
    def number(run, motion):
        return tips_off(run, motion.q[-1], reference).max()

    return Asked(name, number, at_most(bound, "m off"))


def pose(start, *goal):
    """A pose of the lab arm with its tip at a goal, sought from a singular one."""

    def sought(subject):
        found = LAB.forward_kinematics(subject.pose_at(rde.Scene(LAB), start, np.array(goal)))
        what = f"a pose {np.hypot(*goal):.2f} m from the base, sought from there,"
        yield Figure(what, np.linalg.norm(found - goal), at_most(1e-6, "m off"))

    return sought


def rates(name, exact):
    return Asked(name, lambda run, motion: np.abs(motion.qd[-1] - exact).max(), at_most(0, "rad/s off"))


def beyond(run, motion):
    """Largest distance beyond a stop at the end of an interval, m."""
    ends = [(motion.q[..., k], lower, upper) for k, lower, upper, _ in naive.stops_of(run.scene)]
    return np.max([np.maximum(np.maximum(q - upper, lower - q), 0.0).max() for q, lower, upper in ends])


INSIDE = Asked("the largest distance beyond a stop", beyond, at_most(0, "m"))
UNFLAGGED = Asked("flagged lanes", lambda run, motion: np.count_nonzero(motion.numerics), at_most(0))
MORE_STEPS = Asked(
    "intervals with more steps, or a flag,",
    lambda run, motion: motion.evaluations[0, 0] >= 24 or motion.numerics[0] != 0,
    at_least(1),
)


# ---- masses, lengths and singular poses -------------------------------------------------------------------

STRAIGHT_END = (-2.2941618162353746, -2.4834802323820511, -2.7634110527282831, -2.7308771419242488)
"""The straight arm after 1 s, by collocation of order 16 in 34 digits."""
MICROMETRE = rde.FourR((1.0,) * 4, (1.0, 1e-6, 1.0, 1e-6))
VANISHING = falling(rde.FourR((1.0,) * 4, (1.0, 1e-5, 1.0, 1e-5)), tolerance=1e-6)
AXES = {
    f"at the axis of link {link} ": (rde.RPRP(masses, (0.5, 0.5)), q, (1.0, 0.8, -2.0, -0.6))
    for link, masses, q in (
        (2, (1.0, 1.0, 1e-9, 1.0), (0.3, 0.1, -0.4, -0.5 + 1e-6)),
        (1, (1e-9, 1.0, 1.0, 1.0), (0.3, -0.5 + 1e-6, -0.4, 0.1)),
    )
}


def flying_by(b):
    """A free particle that passes the base at a distance: its angle, its radius, and their rates."""
    radius = np.hypot(1.0, b)
    start = (np.arctan2(b, -1.0), radius - 0.5, 0.0, 0.0), (-b / radius**2, -1.0 / radius, 0.0, 0.0)

    def off(run, motion):
        return np.abs(PARTICLE.points(motion.q[-1, 0])[1] - (1.0, b)).max()

    asked = Asked("the end of the line", off, at_most(1e-6, "m off")), UNFLAGGED
    return Run(rde.Scene(PARTICLE, (), tolerance=1e-6), *start, 100, asked, name=f"passing at {b:g} m ")


def off_unflagged(run, motion):
    """Of starts that two references agree in, most of all."""
    finer, coarser = (run.fine_end(steps).q for steps in (4096, 2048))
    judged = tips_off(run, coarser, finer) <= 1e-7
    missed = ~(tips_off(run, motion.q[-1], finer) <= 1e-6) & (motion.numerics == 0)
    return np.mean(missed[judged]) if judged.sum() >= 300 else math.nan


MASSES = {
    "1": (
        Accelerations(LAB, ZERO, ZERO, (0.5, -0.2, 0.1, 0.3), 9.81),
        *(
            Run(
                falling(tolerance=tolerance), ZERO, ZERO, 50, (tip("the tip after 1 s", STRAIGHT_END, most),),
                name=f"at tolerance {tolerance:g} m ",
            )
            for tolerance, most in ((1e-6, 1e-8), (1e-12, 1e-13))
        ),
        pose(ZERO, 1.5, 0.9),
    ),
    "2": (
        Accelerations(LAB, FOLDED, BENT[1], (0.1,) * 4, 9.81),
        lambda _: [Figure("the manipulability", LAB.manipulability(np.array(FOLDED)), at_most(1e-15))],
        pose(FOLDED, 0.3, 0.6),
    ),
    "3": tuple(Accelerations(LIGHT, *BENT, (0.1,) * 4, g, name=f"with g = {g:g} ") for g in (0.0, 9.81)),
    # Half an ulp of one torque moves qdd by 2.6e-10: the numbers given have no more digits.
    "4": (Accelerations(LIGHT, (0.3, 0.3001, 0.2999, 0.30005), BENT[1], (0.1,) * 4, bound=2e-10),),
    "5": (Accelerations(rde.FourR((1.0, 1.0, 1.0, 1e-12), (0.5,) * 4), *BENT, (0.1, 0.1, 0.1, 1e-12)),),
    "6": (
        Accelerations(MICROMETRE, *BENT, (0.1, 1e-7, 0.1, 1e-7)),
        Run(falling(MICROMETRE, tolerance=1e-6), *BENT, 1, (
            MORE_STEPS,
            Asked(
                "an unflagged tip after 20 ms",
                lambda run, m: 0.0 if m.numerics[0] else tips_off(run, m.q[-1], 16384).max(),
                at_most(1e-6, "m off"),
            ),
        )),
    ),
    "8": (
        Accelerations(SLIDING, (0.3, 0.1, -0.4, -0.5), (1.0, 0.8, -2.0, -0.6), (0.1,) * 4, 9.81),
        Run(falling(SLIDING, tolerance=1e-12), (0.3, 0.1, -0.4, -0.4), (1.0, 0.8, -2.0, -2.0), 10, (
            Asked("the slider after the pass", lambda run, m: m.q[-1, 0, 3], at_most(-0.5, "m")),
            energy_kept(1e-11),
        )),
    ),
    "9": tuple(
        row
        for name, (arm, *state) in AXES.items()
        for row in (
            Accelerations(arm, *state, (0.1,) * 4, name=name),
            Run(falling(arm, tolerance=1e-6), *state, 1, (MORE_STEPS,), name=name),
        )
    ),
    "10": tuple(flying_by(b) for b in (0.1, 0.01, 0.001)),
    "44": (
        Run(VANISHING, *random_states(VANISHING, 512, 0)[:2], 1, (
            Asked("the share of 512 starts that are off without a flag", off_unflagged, at_most(1e-3)),
            Asked("the share of flagged ones", lambda _, m: np.mean(m.numerics != 0), at_most(4e-3)),
        )),
    ),
}  # fmt: skip

# ---- chaos, speed and long runs ---------------------------------------------------------------------------


def growing_mode():
    """The fastest mode of the upright lab arm: its rate, 1/s, and its shape, largest entry 1."""
    mass, up = LAB.mass_matrix(UPRIGHT), np.diag(9.81 * 0.5 * np.array([4.0, 3.0, 2.0, 1.0]))
    half = np.linalg.cholesky(mass)
    values, vectors = np.linalg.eigh(np.linalg.solve(half, np.linalg.solve(half, up).T))
    shape = np.linalg.solve(half.T, vectors[:, -1])
    return np.sqrt(values[-1]), shape / shape[np.argmax(np.abs(shape))]


RATE, SHAPE = growing_mode()
LAGUERRE = np.sqrt(9.395070912301 * 9.81 / 0.5)
"""The same rate, from the largest zero of the Laguerre polynomial L_4."""
BANG_BANG = np.random.default_rng(5).choice((-60.0, 60.0), (200, 200, 4))
SPIN = 31.9 * np.pi
"""rad/s. Sums of steps are rounded, to the same side for as long as their exponent stays: by 1.26e6 times
half of 1.2e-10 rad at most."""
SPINNING = rde.Scene(LAB, (), integrator="rk4", control_dt=5.0, substeps=1000)


SPRUNG = falling(SLIDING, e.CentringSpring((200.0, 200.0), (0.0, 0.0), (0.3, 0.3)))


def releases(lanes):
    """Poses of an RPRP arm, whose sliders are within their travel."""
    q = np.random.default_rng(11).uniform(-np.pi, np.pi, (lanes, 4))
    q[:, [1, 3]] = 0.15 + 0.1 / np.pi * q[:, [1, 3]]
    return q


def deviation(run, motion):
    return np.abs(motion.q[-1] - UPRIGHT).max()


def growth(run, motion):
    start = np.abs(motion.q[0] - UPRIGHT).max()
    return abs(np.log(deviation(run, motion) / start) / 0.84 / LAGUERRE - 1.0)


def median_energy(run, motion):
    ends = (energy(run.scene, motion.q[k], motion.qd[k]) for k in (-1, 0))
    return np.median(np.abs(np.subtract(*ends)))


CHAOS = {
    "11": tuple(
        Run(falling(tolerance=tolerance), *STATE_B, 1000, (energy_kept(most),), name=f"at {name} ")
        for name, tolerance, most in (("exact", 1e-12, 1e-9), ("standard", 1e-6, 1e-3))
    ),
    "12": (
        Run(falling(tolerance=1e-12), STATE_B[0], 2.0 * np.array(STATE_B[1]), 250, (
            energy_kept(1e-11, "of itself off", None, "the energy within 5 s"),
            Asked("the most evaluations of an interval", lambda _, m: m.evaluations.max(), at_least(24)),
        )),
    ),
    "48": (
        Run(
            falling(rde.FourR((1.0, 1.0, 1.0, 1e-9), (0.5,) * 4), tolerance=1e-6), (-1.6, -1.5, -1.7, 0.0),
            (0.0, 0.0, 0.0, 2.0 * np.pi / 0.005), 1, (tip("the tip after 20 ms", 1024, 1e-6),),
        ),
    ),
    "13": (
        Run(falling(tolerance=1e-6), UPRIGHT + 1e-8 * SHAPE, 1e-8 * RATE * SHAPE, 42, (
            Asked("the deviation after 0.84 s in rad", deviation, at_least(5e-4)),
            Asked("the rate of growth", growth, at_most(1e-6, "of itself off")),
        )),
    ),
    "14": (
        Run(
            falling(tolerance=1e-6), np.tile(UPRIGHT, (19, 1)), 0.0, 25,
            (Asked("the deviation after 0.5 s", deviation, at_most(1e-12, "rad")),),
        ),
    ),
    "15": (
        Run(falling(tolerance=1e-6, actuation="generalized"), np.zeros((200, 4)), 0.0, 200, (
            Asked("the lost numbers", lambda _, m: np.count_nonzero(~np.isfinite(m.q[-1])), at_most(0)),
            Asked("the mean cost", lambda _, m: m.evaluations.mean() / 12, at_most(20, "steps of RK8")),
        ), lambda k: BANG_BANG[k]),
    ),
    "20": (
        Run(SPINNING, ZERO, SPIN, 1257, (
            Asked("the angle by the rate", lambda _, m: abs(m.q[-1] / SPIN - 6285).max(), at_most(7.5e-7)),
            rates("the rate", SPIN),
        )),
    ),
    "21": tuple(
        Run(
            falling(integrator=method, control_dt=10.0, substeps=round(10.0 / step)),
            np.random.default_rng(21).uniform(-np.pi, np.pi, (8, 4)), 0.0, 100,
            (Asked("the median energy", median_energy, at_most(most, "J off")),),
            name=f"with {method.upper()} of {1e3 * step:g} ms ",
        )
        for method, step, most in (("rk4", 1e-3, 1e-3), ("rk8", 2.5e-3, 1e-7))
    ) + tuple(
        Run(
            replace(scene, integrator=method, control_dt=step * substeps, substeps=substeps),
            releases(lanes), 0.0, intervals,
            (Asked("the median energy", median_energy, at_most(most, "J off")),),
            name=f"RPRP with {what} and {method.upper()} ",
        )
        for what, scene, method, step, substeps, lanes, intervals, most in (
            ("springs", SPRUNG, "rk4", 1e-3, 10_000, 16, 20, 2.4e-5),
            ("springs", SPRUNG, "rk8", 2.5e-3, 10_000, 64, 40, 1e-10),
            ("stops", stopped(), "rk4", 1e-3, 20, 16, 1000, 1.5e-7),
        )
    ),
}  # fmt: skip

# ---- stops and impacts ------------------------------------------------------------------------------------


def errors_of_five_impacts(subject, steps):
    """Errors of the tip in steps of RK4, m; the run and the motion of the last of them."""
    exact, errors = rde.simulate(stopped(integrator="dop853"), *FIVE_IMPACTS, [0.5]).q[-1], []
    for step in steps:
        scene = stopped(integrator="rk4", control_dt=step)
        run = Run(scene, *FIVE_IMPACTS, round(0.5 / step), longest=step)
        motion = subject.motion(run)
        errors.append(tips_off(run, motion.q[-1], exact).max())
    return errors, run, motion


def five_impacts_keep_the_order(subject):
    errors, run, motion = errors_of_five_impacts(subject, (1e-2, 5e-3, 2.5e-3, 1e-3))
    slopes = np.diff(np.log(errors)) / np.log((0.5, 0.5, 0.4))
    yield Figure("the largest distance beyond a stop", beyond(run, motion), at_most(0, "m"))
    yield Figure("the number of impacts less 5", abs(len(motion.impacts()) - 5), at_most(0))
    yield Figure("the tip at RK4 of 1 ms", errors[-1], at_most(1e-9, "m off"))
    yield Figure("the order of RK4", slopes.min(), at_least(3.9))
    yield Figure("the energy at RK4 of 1 ms", energy_change(run, motion), at_most(1e-8, "J off"))
    cost = motion.evaluations.sum() / (4 * 500)
    yield Figure("the evaluations at RK4 of 1 ms", cost, at_most(1.05, "of those without stops"))


def pulled_back(gaps, asked, name="", longest=None, **how):
    """At 1 m/s towards a stop, and pulled away from it by 200 m/s^2."""
    q = np.tile((0.0, 0.3, 0.0, 0.1), (len(gaps), 1))
    q[:, 1] -= gaps
    scene, pull = stopped(HEAVY, gravity=0.0, **how), (0.0, -200.0002, 0.0, 0.0)
    return Run(scene, q, (0.0, 1.0, 0.0, 0.0), 1, asked, pull, name, longest)


def bounced_off(run, motion):
    v = math.sqrt(1.0 - 2.0 * 200.0 * 0.002)
    left = 0.02 - (1.0 - v) / 200.0
    return abs(motion.q[-1, 0, 1] - (0.3 - v * left - 100.0 * left**2))


def apex_energy(run, motion):
    total = 0.5 * motion.qd[..., 1] ** 2 + 200.0 * motion.q[..., 1]  # of the mass of 1 kg
    return np.abs(total[1] - total[0]).max()


def most_impacts(run, motion):
    return max(len(motion.impacts("r1", lane)) for lane in range(motion.q.shape[1]))


WAYS = {"rk4": {"integrator": "rk4"}, "rk8": {}, "error control": {"tolerance": 1e-6}}


def hidden_impact(tolerance):
    """The slider strikes one stop and then rests at the other."""

    def wrong(run, motion):
        return [x.kind for x in motion.impacts("r2")] != ["upper impact", "lower impact"]

    scene = stopped(restitution=0.5, gravity=0.0, upper=(0.3, 0.05), tolerance=tolerance)
    return Run(
        scene, (0.0, 0.1, 0.0, 0.0497), (0.0, 0.0, 0.0, 1.0), 1,
        (Asked("wrong lists of impacts", wrong, at_most(0)), tip("the tip", 160, 1e-12)),
        (0.0, 0.0, 0.0, -250.0), "in one step " if tolerance is None else f"at {tolerance:g} m ", 0.02,
    )  # fmt: skip


STOPS = {
    "23": (
        five_impacts_keep_the_order,
        Run(stopped(tolerance=1e-12), *FIVE_IMPACTS, 25, (energy_kept(1e-10),), name="at exact "),
    ),
    "27": tuple(
        pulled_back((0.002,), (
            Asked("the number of impacts less 1", lambda _, m: abs(len(m.impacts("r1")) - 1), at_most(0)),
            Asked("the end", bounced_off, at_most(1e-7, "m off")),
        ), f"with {name} ", 0.02, **how)
        for name, how in (WAYS | {"dop853": {"integrator": "dop853"}}).items()
    ),
    "27b": (
        pulled_back(0.0025 * (1.0 + np.array([0.0, 1e-14, -1e-14, 1e-12, -1e-12, 4e-7, -4e-7])), (
            Asked("the largest number of impacts", most_impacts, at_most(1)),
            Asked("the energy", apex_energy, at_most(1e-9, "J off")),
        ), tolerance=1e-6),
    ),
    "29": tuple(
        Run(stopped(gravity=0.0, **how), (0.3, 0.1, 0.3, 0.1), (0.0, 50.0, 0.0, 0.0), 1, (
            Asked("the number of impacts", lambda _, m: len(m.impacts()), at_least(3)),
            energy_kept(1e-9, "of itself off", None),
            INSIDE,
        ), None, f"with {name} ", 0.02)
        for name, how in WAYS.items()
    ),
    "43": tuple(hidden_impact(tolerance) for tolerance in (1e-6, 1e-12, None)),
}  # fmt: skip

# ---- rest, release and springs ----------------------------------------------------------------------------

BALL = rde.RPRP((1.0, 1.0, 1.0, 1e-12), (0.5, 0.5))


def resting(restitution, seconds):
    """Link 1 lies on its own stop: only the ball on link 2 bounces."""
    exact = math.sqrt(2.0 * 0.3 / 9.81) * (1.0 + restitution) / (1.0 - restitution)

    def off(run, motion):
        last = motion.impacts("r2")[-1]
        return abs(last.time + 2.0 * restitution * last.speed / (9.81 * (1.0 - restitution)) - exact)

    def moved(run, motion):
        late = math.ceil(exact / 0.02) + 1
        return np.count_nonzero(motion.q[late:, 0, 3] != 0.3) + np.count_nonzero(motion.qd[late:, 0, 3])

    return Run(
        falling(BALL, e.PrismaticStop((None, None), (0.3, 0.3), restitution), tolerance=1e-9),
        (-math.pi / 2, 0.3, -math.pi / 2, 0.0), 0.0, round(seconds / 0.02), (
            Asked("the time of rest", off, at_most(1e-7, "s off")),
            Asked("the numbers that change after it", moved, at_most(0)),
        ), name=f"at restitution {restitution:g} ", longest=0.02,
    )  # fmt: skip


def pressed(tolerance, bound):
    """The force turns after 5 s, and the motor lags: a release after ln 2 of its time constant."""
    effects = e.PrismaticStop((0.0, 0.0), (0.3, 0.3), 0.3), e.Lag(7.3e-3)
    scene = rde.Scene(SLIDING, effects, tolerance=tolerance)
    force = np.array((0.0, 10.0, 0.0, 0.0))

    def off(run, motion):
        times = [x.time for x in motion.events if (x.kind, x.joint) == ("release", "r1") and x.time > 0.0]
        return abs(times[0] - 5.0 - 7.3e-3 * math.log(2.0)) if len(times) == 1 else math.nan

    return Run(scene, (0.0, 0.0, 0.0, 0.1), 0.0, 251, (
        Asked("the drift in 5 s", lambda _, m: np.abs(m.q[:251, 0, 1]).max(), at_most(0, "m")),
        Asked("the time of the only release", off, at_most(bound, "s off")),
    ), lambda k: force if k == 250 else -force, f"at {tolerance:g} m ", 5e-3)  # fmt: skip


def untouched(tolerance, asked):
    """Straight, and at rest but for the last slider: nothing turns."""
    springs = (e.LimitSpring(joint, 0.0, 0.3, 1e6) for joint in ("r1", "r2"))
    scene = rde.Scene(SLIDING, tuple(springs), tolerance=tolerance)
    return Run(scene, (0.0, 0.1, 0.0, 0.2925), (0.0, 0.0, 0.0, 1.0), 5, asked)


PRINTED = rde.Scene(UNEQUAL, (e.CentringSpring((400.0, 200.0), (0.0, 0.0), (0.5, 0.4)),), tolerance=1e-12)
# K x = w^2 M x of two sliders along one line; no torque turns the links.
SQUARES, SHAPES = np.linalg.eig(np.linalg.solve([[3.0, 0.5], [0.5, 0.5]], np.diag([800.0, 400.0])))


def swinging(square, shape):
    w, amplitude = math.sqrt(square), 0.05 * shape / np.abs(shape).max()

    def off(run, motion):
        x = (motion.q[-1, 0, [1, 3]] - (0.25, 0.2)) @ amplitude
        phase = math.atan2(-motion.qd[-1, 0, [1, 3]] @ amplitude / w, x)
        return abs((phase - 10.0 * w + math.pi) % (2.0 * math.pi) - math.pi) / (10.0 * w)

    start = (0.0, 0.25 + amplitude[0], 0.0, 0.2 + amplitude[1])
    asked = (Asked(f"the frequency of {w:.4g} rad/s", off, at_most(1e-10, "of itself off")),)
    return Run(PRINTED, start, 0.0, 500, asked)


LEVELS = np.array((4.0, 3.0, 2.0, 1.0))
"""Dry friction of the joints, N m."""
ALONE = (1e6, 1e6, 1e6, 1.0)
"""The same where only the last joint can move: its inertia is 1/4 kg m^2."""
FLYWHEEL = rde.Chain("R", (1.0,), (0.5,))


def dry(levels, arm=LAB, dt=0.02):
    return rde.Scene(arm, (e.CoulombFriction(levels),), control_dt=dt)


def angle_off(name, bound, exact, unit="rad off"):
    return Asked(name, lambda run, motion: abs(motion.q[-1, 0, -1] - exact), at_most(bound, unit))


REST = {
    "25": (resting(0.5, 11.0), resting(0.9, 15.0)),
    # A tolerance in metres says little about a force: 1e-8 s of it move the tip by 1e-20 m.
    "26": (pressed(1e-6, 1e-8), pressed(1e-12, 1e-10)),
    "31": (
        # A tolerance bounds errors of the tip. The energy in a stiff spring depends on digits beyond it.
        untouched(1e-7, (energy_kept(1e-6, name="at tolerance 1e-07 m the energy over the bounce"),)),
        untouched(1e-6, (tip("the tip after 5 intervals", 20000, 1e-6),)),
    ),
    "32": tuple(swinging(square, shape) for square, shape in zip(SQUARES, SHAPES.T, strict=True)),
    "33": (
        *(
            Run(dry(tuple(LEVELS), dt=dt), (0.3, -0.5, 1.0, 0.2), 0.0, round(10.0 / dt), (
                Asked("the drift in 10 s", lambda _, m: np.abs(m.q[-1] - m.q[0]).max(), at_most(0.0, "rad")),
            ), 0.9 * LEVELS, f"under 0.9 of the friction, in steps of {1e3 * dt:g} ms, ")
            for dt in (0.02, 0.005, 0.001)
        ),
        *(
            Run(dry(ALONE), ZERO, 0.0, 50, (
                angle_off(f"under {load:g} of the friction the angle after 1 s", 1e-13, travelled),
            ), (0.0, 0.0, 0.0, load))
            for load, travelled in ((1.01, 0.5 * 0.01 / 0.25), (1.0, 0.0))
        ),
        Run(dry(1.0, FLYWHEEL), (0.0,), 0.5, 50, (
            angle_off("pushed to 0.5 rad/s, where a joint has stopped after 1 s", 1e-13, 0.5 * 0.25 * 0.5**2),
        )),
    ),
}  # fmt: skip

# ---- numbers, and steps -----------------------------------------------------------------------------------

TURNS = np.array([0.0, 1e3, 1e5, 159154.0, 1e6, 1e11])[:, None]


def accelerations_from_rest(run, motion):
    """In a nanosecond from rest a rate becomes the acceleration times 1e-9, to the last digits."""
    worst = 0.0
    for q, found in zip(run.q, motion.qd[-1] / 1e-9, strict=True):
        exact = Accelerations(LAB, q.tolist(), ZERO, ZERO, 9.81).exact()
        worst = max(worst, *(abs(float(a - b)) for a, b in zip(found.tolist(), exact, strict=True)))
    return worst / 9.81


def joint_2(run, motion):
    return np.abs(motion.q[..., 1] - motion.q[..., 0]).max()


def two_halves(subject):
    """Sliders between their stops, every seventh at one; and a smooth motion."""
    rng = np.random.default_rng(6)
    q = np.column_stack([rng.uniform(-3, 3, 64), rng.uniform(0, 0.3, 64)] * 2)
    q[::7, 1] = 0.3
    start = q, rng.normal(0, 2, (64, 4))
    efforts, how = rng.uniform(-20, 20, (64, 4)), {"integrator": "rk4", "control_dt": 0.01}
    for name, one in (("stops", stopped(UNEQUAL, 0.5, **how)), ("a smooth scene", falling(**how))):
        two = replace(one, substeps=2, control_dt=0.02)
        ends = [subject.motion(Run(x, *start, n, efforts=efforts)) for x, n in ((one, 20), (two, 10))]
        differing = np.count_nonzero(np.subtract(*(np.hstack([x.q[-1], x.qd[-1]]) for x in ends)))
        yield Figure(f"with {name} the differing numbers, of 512,", differing, at_most(0))


NUMBERS = {
    "18": (
        Run(rde.Scene(LAB, (), tolerance=1e-6), ZERO, 1e-310, 50, (
            rates("the rate after 1 s", 1e-310),
            Asked("the most evaluations of an interval", lambda _, m: m.evaluations.max(), at_most(12)),
            UNFLAGGED,
        )),
    ),
    "19": (
        Run(
            falling(integrator="rk4", control_dt=1e-9), BENT[0] + 2.0 * np.pi * TURNS, 0.0, 1,
            (Asked("up to 6e11 rad the acceleration", accelerations_from_rest, at_most(1e-14, "of g off")),),
        ),
    ),
    "39": (  # all links turn together, so joints move little
        Run(
            rde.Scene(LAB, (e.LimitSpring("joint2", -2.0, 2.0, 500.0),), tolerance=1e-9),
            (2.5, 2.7, 2.6, 2.8), 3.0, 300,
            (Asked("the second joint angle", joint_2, at_most(2.0, "rad")), energy_kept(1e-6)),
        ),
    ),
    "40": tuple(
        Run(
            falling(arm, tolerance=1e-12), q, (1.0, -2.0, 1.5, -1.0), 50, (energy_kept(1e-10),),
            name=f"{arm.kind}: ",
        )
        for arm, q in (
            (rde.FourR(UNEQUAL.masses, (0.3, 0.5, 0.4, 0.6)), (0.2, 1.0, -0.5, 2.0)),
            (UNEQUAL, (0.2, 0.1, -0.5, 0.2)),
        )
    ),
    "37": (two_halves,),
}  # fmt: skip

ROWS = MASSES | CHAOS | STOPS | REST | NUMBERS
CASES = [
    Case(
        number, theme, rows=ROWS[number],
        **words | {"caught": tuple(getattr(naive, name) for name in words.get("caught", ()))},
    )
    for theme, some in THEMES.items()
    for number, words in some.items()
]  # fmt: skip
"""All cases, in the order of the page."""
