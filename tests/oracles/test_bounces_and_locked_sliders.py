"""Oracles O14 and O15: bounces, and sliders locked at their stops."""

import numpy as np
from oracle_cases import UNEQUAL, G, assert_within, largest, motion

import redundant_envs as rde
from redundant_envs.effects import Gravity, PrismaticStop


def test_o14_bounces_shrink_by_e_squared_and_end_in_zeno_time():
    """RPRP hanging, r_1 falls 0.3 m: heights h_n = e^(2n) h_0, at rest after sqrt(2 h/g) (1 + e)/(1 - e).

    m_4 is next to nothing and r_2 has no stop, so that r_1 falls freely. That time is of the last impact and
    of all bounces that it leaves out; the slider is put to rest sooner, at bounces of a nanometre, and then
    is at its stop to the last bit. Without gravity and at e = 1 impacts on a stop are 2 d / v apart.
    """
    masses, drop = (1.0, 1.0, 1.0, 1e-12), 0.3
    arm = rde.RPRP(masses, (0.5, 0.5))
    q0 = np.array([-0.5 * np.pi, 0.0, -0.5 * np.pi, 0.1])
    found = {}
    for e, seconds in ((0.5, 0.8), (0.9, 4.8)):
        stops = PrismaticStop((-1.0, None), (drop, None), e)
        made = rde.Scene(arm, (Gravity(G), stops), tolerance=1e-12)
        run = rde.simulate(made, q0, np.zeros(4), [seconds])
        hits = [x for x in run.events if x.kind == "upper impact"]
        rest = [x for x in run.events if x.kind == "rest"]
        speeds, times = np.array([x.speed for x in hits]), np.array([x.time for x in hits])
        n = np.arange(len(hits))
        fall = np.sqrt(2.0 * drop / G)
        end = fall * (1.0 + e) / (1.0 - e)
        # The last impact leaves a speed of e v: what it would still have bounced counts.
        last = times[-1] + 2.0 * e * speeds[-1] / (G * (1.0 - e))
        assert len(rest) == 1
        found |= {
            f"heights, e = {e}": largest(speeds**2 / (2.0 * G) - drop * e ** (2 * n), drop),
            f"times, e = {e}": largest(times - fall * (1.0 + 2.0 * e * (1.0 - e**n) / (1.0 - e))),
            f"end, e = {e}": abs(last - end),
            f"early, e = {e}": end - rest[0].time,
            f"away, e = {e}": abs(run.q[-1, 1] - drop),
        }
    d, v = 0.4, 1.3
    stops = PrismaticStop((0.0, None), (d, None), 1.0)
    made = rde.Scene(arm, (Gravity(0.0), stops), tolerance=1e-12)
    run = rde.simulate(made, [0.0, 0.1, 0.0, 0.1], [0.0, v, 0.0, 0.0], [2.0])
    times = np.array([x.time for x in run.events])
    assert len(times) == 6
    found["elastic period"] = largest(times - ((d - 0.1) + d * np.arange(6)) / v)
    bounds = {
        "heights, e = 0.5": 2e-15, "times, e = 0.5": 5e-13, "end, e = 0.5": 2e-12, "early, e = 0.5": 1e-4,
        "heights, e = 0.9": 1e-14, "times, e = 0.9": 2e-12, "end, e = 0.9": 1.5e-11, "early, e = 0.9": 1e-3,
        "away, e = 0.5": 0.0, "away, e = 0.9": 0.0, "elastic period": 5e-15,
    }  # fmt: skip
    assert_within(bounds, found)


def double_pendulum(first, second, q, qd):
    """Two links with masses at distances ``{distance: mass}`` along them: angles from +x, (..., 2)."""
    (a, b), (wa, wb) = np.moveaxis(q, -1, 0), np.moveaxis(qd, -1, 0)
    length = max(first)
    carried = sum(second.values())
    inertia_a = sum(m * x**2 for x, m in first.items()) + carried * length**2
    moment_a = sum(m * x for x, m in first.items()) + carried * length
    inertia_b, moment_b = (sum(m * x**k for x, m in second.items()) for k in (2, 1))
    c, s = length * moment_b * np.cos(a - b), length * moment_b * np.sin(a - b)
    fa, fb = -s * wb**2 - moment_a * G * np.cos(a), s * wa**2 - moment_b * G * np.cos(b)
    det = inertia_a * inertia_b - c**2
    return np.stack([(inertia_b * fa - c * fb) / det, (inertia_a * fb - c * fa) / det], axis=-1)


def test_o15_locked_sliders_leave_a_double_pendulum():
    """A compiled motion of 0.25 s whose sliders rest at stops, pressed there, against short classical
    Runge-Kutta steps of the textbook's."""
    rng = np.random.default_rng(5)
    pose, rates = rng.uniform(-np.pi, np.pi, (200, 2)), rng.uniform(-2.0, 2.0, (200, 2))
    arm = UNEQUAL["RPRP"]
    m, l = arm.masses, arm.lengths
    first, second = {l[0]: m[0], l[0] + 0.2: m[1]}, {l[1]: m[2], l[1] + 0.1: m[3]}
    stops = PrismaticStop((-0.2, -0.2), (0.2, 0.1), 0.0)
    made = rde.Scene(arm, (Gravity(G), stops), tolerance=1e-12)
    start, going = np.insert(pose, (1, 2), (0.2, 0.1), axis=1), np.insert(rates, (1, 2), 0.0, axis=1)
    q, qd = motion(made, start, going, 0.25, [0.0, 500.0, 0.0, 500.0], duration=0.25 / 16)

    def slope(y):
        return np.stack([y[1], double_pendulum(first, second, *y)])

    y, h = np.stack([pose, rates]), 0.25 / 1000
    for _ in range(1000):
        k1 = slope(y)
        k2 = slope(y + 0.5 * h * k1)
        k3 = slope(y + 0.5 * h * k2)
        k4 = slope(y + h * k3)
        y = y + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    found = {
        "angles": largest(q[:, [0, 2]] - y[0]),
        "rates": largest(qd[:, [0, 2]] - y[1]),
        "sliders": largest(q[:, [1, 3]] - [0.2, 0.1]),
    }
    assert_within({"angles": 2e-12, "rates": 6e-11, "sliders": 0.0}, found)
