"""The equations of sliders at stops: held, struck, pressed, against dense systems and tried sets."""

import numpy as np
import pytest
from contact_problems import complementary, contact, mobility, resolved

import redundant_envs as rde
from redundant_envs.integrators import contacts
from redundant_envs.integrators.contacts import Event
from redundant_envs.integrators.events import Phase
from redundant_envs.simulator.dynamics import Dynamics

UNEQUAL = rde.RPRP((2.0, 1.5, 1.0, 0.5), (0.3, 0.5))
STOPPED = Dynamics(rde.Scene(UNEQUAL, (rde.effects.PrismaticStop((0.0, 0.0), (0.3, 0.3)),)))
sliders = pytest.mark.parametrize("count", [1, 2, 3], ids=["one slider", "two", "three"])


@pytest.mark.parametrize("held", [(0, 0), (1, 0), (0, 1), (1, 1)])
def test_held_dynamics_is_the_constrained_system(held):
    """M qdd + h + G = Q + hold, with qdd = 0 of the held sliders: solved as a dense system."""
    rng = np.random.default_rng(0)
    arm = UNEQUAL
    for _ in range(50):
        q, qd, Q = rng.uniform(-3, 3, 4), rng.uniform(-4, 4, 4), rng.uniform(-20, 20, 4)
        qd[[1, 3]] *= 1 - np.array(held)
        known = {**arm.parameter_values(), "ax": 0.0, "ay": 9.81, "held2": held[0], "held4": held[1]}
        known |= {f"Q{k + 1}": Q[k] for k in range(4)}
        x = STOPPED.quantities([*q, *qd], known, held=True)
        free = arm.bias_forces(q, qd) + arm.gravity_forces(q) - Q
        system = np.zeros((6, 6))
        system[:4, :4] = arm.mass_matrix(q)
        right = np.zeros(6)
        right[:4] = -free
        for k, joint in enumerate((1, 3)):
            if held[k]:
                system[4 + k, joint] = 1.0
                system[joint, 4 + k] = -1.0
            else:
                system[4 + k, 4 + k] = 1.0
        expected = np.linalg.solve(system, right)
        got = x.each(f"qdd{k}" for k in range(1, 5))
        np.testing.assert_allclose(got, expected[:4], rtol=0, atol=1e-12 * np.abs(expected).max())
        for k, name in enumerate(("hold2", "hold4")):
            if held[k]:
                assert x[name] == pytest.approx(expected[4 + k], abs=1e-12 * np.abs(expected).max())


def test_slider_mobility_is_two_columns_of_the_inverse():
    arm = UNEQUAL
    q = np.random.default_rng(1).uniform(-3, 3, (50, 4))
    x = STOPPED.quantities(q.T, arm.parameter_values(), held=True)
    names = [f"W{i}{k}" for k in (2, 4) for i in range(1, 5)]
    inverse = np.linalg.inv(arm.mass_matrix(q))
    got = np.stack(x.each(names), axis=1).reshape(-1, 2, 4)
    expected = np.stack([inverse[:, :, 1], inverse[:, :, 3]], axis=1)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


# ---- impulses ------------------------------------------------------------------------------------


@sliders
def test_impulses_solve_the_complementarity_problem(count):
    """No stop pulls, none is entered, and only those that act decide; at no stop there is no impulse."""
    rng = np.random.default_rng(2)
    struck = set()
    for _ in range(2000):
        w = mobility(rng, count)
        sides = rng.choice([-1.0, 0.0, 1.0], count)
        u, restitution = np.abs(sides) * rng.normal(size=count), rng.uniform(0, 1)
        if not (u > 0).any():
            continue  # nothing strikes: nobody asks
        at = np.flatnonzero(sides)
        outward = np.outer(sides, sides) * w
        d = u + restitution * np.maximum(u, 0.0)
        expected = np.zeros(count)
        expected[at] = complementary(outward[np.ix_(at, at)], d[at])
        p = contacts.impulses(u.tolist(), sides.tolist(), w.tolist(), restitution)
        np.testing.assert_allclose(p, expected, rtol=1e-9, atol=1e-12)
        struck.add(tuple(expected > 0.0))
    assert len(struck) == 2**count - 1


@sliders
def test_impulses_do_not_know_the_order_of_the_sliders(count):
    rng = np.random.default_rng(12)
    for _ in range(300):
        w, order = mobility(rng, count), rng.permutation(count)
        sides, u = rng.choice([-1.0, 1.0], count), rng.normal(size=count)
        if not (u > 0).any():
            continue
        p = contacts.impulses(u.tolist(), sides.tolist(), w.tolist(), 0.5)
        others = w[np.ix_(order, order)].tolist()
        again = contacts.impulses(u[order].tolist(), sides[order].tolist(), others, 0.5)
        np.testing.assert_allclose(np.array(p)[order], again, rtol=1e-9, atol=1e-12)


@sliders
def test_halting_stops_those_that_must_stand_still_and_pushes_no_other(count):
    rng = np.random.default_rng(3)
    for _ in range(500):
        w, v = mobility(rng, count), rng.normal(size=count)
        still = rng.random(count) < 0.5
        push = np.array(contacts.halting(v.tolist(), still.tolist(), w))
        assert (push[~still] == 0.0).all()
        scale = np.abs(w).max() * np.abs(push).max(initial=1.0)
        np.testing.assert_allclose((v + w @ push)[still], 0.0, atol=1e-12 * scale)


@sliders
def test_pressed_is_the_one_set_in_which_no_stop_pulls_and_none_is_entered(count):
    rng = np.random.default_rng(4)
    seen = set()
    for _ in range(2000):
        w, free = mobility(rng, count), rng.normal(size=count)
        expected = complementary(w, free) > 0.0
        assert contacts.pressed(free.tolist(), w) == expected.tolist()
        seen.add(tuple(expected))
    assert len(seen) == 2**count


@sliders
def test_the_equations_on_arrays_are_those_on_numbers(count):
    rng = np.random.default_rng(5)
    many = [mobility(rng, count) for _ in range(64)]
    w = np.moveaxis(many, 0, -1)
    v, sides = rng.normal(size=(count, 64)), rng.choice([-1.0, 1.0], (count, 64))
    v[0] = np.abs(v[0])
    still = rng.random((count, 64)) < 0.5

    def table(columns):
        return np.array(np.broadcast_arrays(*columns, np.zeros(64))[:-1], dtype=float)

    got = contacts.impulses(v, sides, list(w), 0.3), contacts.halting(v, still, w), contacts.pressed(v, w)
    for k in range(64):
        one = (
            contacts.impulses(v[:, k].tolist(), sides[:, k].tolist(), many[k].tolist(), 0.3),
            contacts.halting(v[:, k].tolist(), still[:, k].tolist(), many[k]),
            contacts.pressed(v[:, k].tolist(), many[k]),
        )
        for columns, numbers in zip(got, one, strict=True):
            np.testing.assert_allclose(table(columns)[:, k], np.array(numbers, dtype=float), rtol=1e-12)


# ---- a contact resolved --------------------------------------------------------------------------


@sliders
def test_struck_sliders_have_the_speeds_of_the_impulses(count):
    """Those that rest or move onto their stops are struck; one that moves away has no support."""
    rng = np.random.default_rng(6)
    tried = 0
    for _ in range(1000):
        w, e = mobility(rng, count), rng.uniform(0, 1)
        sides, v = rng.choice([-1.0, 1.0], count), rng.normal(size=count)
        resting = rng.random(count) < 0.3
        v[resting] = 0.0
        u = sides * v
        if not (u > 0).any():
            continue
        got = resolved(
            [contact(*x) for x in zip(v.tolist(), sides.tolist(), resting.tolist(), strict=True)], w, e
        )
        by_turns = count == 2 and not resting.any() and (u < 0).any()
        if by_turns and contacts.collapses(u.tolist(), sides.tolist(), w, e):
            np.testing.assert_allclose(got.velocities, 0.0, atol=1e-12)
            continue
        acting = np.flatnonzero(resting | (u > 0))
        outward = np.outer(sides, sides) * w
        d = u + e * np.maximum(u, 0.0)
        p = np.zeros(count)
        p[acting] = complementary(outward[np.ix_(acting, acting)], d[acting])
        after = v - w @ (sides * p)
        assert got.strikes
        assert not got.going_on
        np.testing.assert_allclose(got.velocities, after, atol=1e-10 * max(1.0, np.abs(after).max()))
        np.testing.assert_allclose(got.impulses, -sides * p, rtol=1e-9, atol=1e-12)
        assert got.impacts == np.count_nonzero((p > 0) & (u > 0))
        kinds = np.where((p > 0) & (u > 0), np.where(sides > 0, Event.UPPER_IMPACT, Event.LOWER_IMPACT), 0)
        left = resting & (sides * np.array(got.velocities) < 0.0)
        assert got.happened == np.where(left, Event.RELEASE, kinds).tolist()
        assert (np.array(got.active_stops) != 0.0).tolist() == (resting & ~left).tolist()
        tried += 1
    assert tried > 300


@sliders
def test_of_sliders_that_rest_those_leave_whose_stops_would_pull_in_the_end(count):
    """What one does changes the forces on the others, so all are decided at once."""
    rng = np.random.default_rng(7)
    seen = set()
    for _ in range(1000):
        w, sides, force = mobility(rng, count), rng.choice([-1.0, 1.0], count), rng.normal(size=count)
        at = [
            contact(0.0, s, resting=True, force=f)
            for s, f in zip(sides.tolist(), force.tolist(), strict=True)
        ]
        got = resolved(at, w)
        free = -sides * (w @ force)  # accelerations without any stop
        holds = complementary(np.outer(sides, sides) * w, free)
        if not (sides * force > 0.0).any():
            holds = -sides * force  # all are pushed: nothing changes
        stays = holds > 0.0
        assert (np.array(got.active_stops) != 0.0).tolist() == stays.tolist()
        assert got.happened == np.where(stays, Event.NONE, Event.RELEASE).tolist()
        assert got.going_on
        np.testing.assert_allclose(got.forces, -sides * holds, rtol=1e-8, atol=1e-10)
        leaves = contacts.leaving(at, w)
        assert leaves == (~stays).tolist()  # the same before a common step
        seen.add(tuple(stays))
    assert len(seen) == 2**count


@sliders
def test_a_slider_that_comes_to_rest_beside_others_that_rest(count):
    """It does not move, it sets off no other, and what no stop presses is let go."""
    rng = np.random.default_rng(8)
    rested = 0
    for _ in range(1000):
        w, sides = mobility(rng, count), rng.choice([-1.0, 1.0], count)
        force, slow = -sides * rng.uniform(0.1, 2.0, count), -1e-7 * rng.random() * sides[0]
        others = [
            contact(0.0, s, resting=True, force=f)
            for s, f in zip(sides[1:].tolist(), force[1:].tolist(), strict=True)
        ]
        press = rng.normal()
        free = sides * (np.array([sides[0] * press, *np.zeros(count - 1)]) - w[:, 1:] @ force[1:])
        got = resolved([contact(slow, sides[0], acceleration=sides[0] * press), *others], w)
        if press <= 0.0:
            assert got.active_stops[0] == 0.0
            continue
        stays = complementary(np.outer(sides, sides) * w, free) > 0.0
        assert (np.array(got.active_stops) != 0.0).tolist() == stays.tolist()
        if stays[0]:
            assert got.happened[0] == Event.REST
            np.testing.assert_allclose(np.array(got.velocities)[stays], 0.0, atol=1e-15)
            rested += 1
    assert rested > 300


def test_a_single_slider_bounces_rests_and_goes():
    """One stop, mobility 2: the formulas of a ball."""
    w = [[2.0]]
    got = resolved([contact(0.6, 1.0)], w, 0.5)
    assert got.velocities == [pytest.approx(-0.3)]
    assert got.impulses == [pytest.approx(-0.45)]
    assert (got.happened, got.speeds) == ([Event.UPPER_IMPACT], [0.6])
    got = resolved([contact(-1e-6, 1.0, acceleration=3.0)], w, 0.5)
    assert (got.velocities, got.active_stops, got.happened) == ([0.0], [1.0], [Event.REST])
    assert got.forces == [pytest.approx(-1.5)]
    assert resolved([contact(-1e-3, 1.0, acceleration=3.0)], w, 0.5).active_stops == [0.0]
    assert resolved([contact(-1e-6, 1.0, acceleration=3.0, released=True)], w, 0.5).active_stops == [0.0]
    got = resolved([contact(0.0, -1.0, resting=True, force=-0.1)], w, 0.5)
    assert (got.active_stops, got.happened, got.released) == ([0.0], [Event.RELEASE], [False])
    away = resolved([contact(0.6, away=True)], w, 0.5)
    assert (away.velocities, away.happened, away.going_on) == ([0.6], [Event.NONE], True)


@sliders
def test_a_lane_that_is_not_at_a_stop_or_has_spent_its_budget_is_left_as_it_was(count):
    at = [contact(0.5, 1.0, resting=False)] * count
    w = np.eye(count)
    moving = resolved(at, w, phase=Phase.RUN)
    assert not moving.strikes
    assert not moving.given_up
    assert (moving.happened, moving.impacts) == ([Event.NONE] * count, 0.0)
    for spent in ({"changes": 512.0}, {"impacts": 257.0}):
        got = resolved(at, w, **spent)
        assert got.given_up
        assert not got.strikes
        assert not got.going_on
        assert got.happened == [Event.NONE] * count
    assert not resolved(at, w, changes=511.0, impacts=256.0).given_up


def struck_by_turns(u, W, restitution, most=100_000):
    """Outward speeds after impacts of one slider at a time, at stops without any gap; None if they go on."""
    u = u.copy()
    for _ in range(most):
        if (u <= 1e-13).all():
            return u
        k = int(np.argmax(u))
        u -= W[:, k] * (1.0 + restitution) * u[k] / W[k, k]
    return None


@pytest.mark.parametrize("restitution", [0.0, 0.02, 0.1, 0.3, 0.9, 1.0])
def test_sliders_that_strike_by_turns_end_where_single_impacts_end(restitution):
    """One moves onto its stop, the other away from its own: never struck together, but by turns; a chain that
    never ends stops both."""
    rng = np.random.default_rng(5)
    chains = ended = 0
    for _ in range(400):
        angle = rng.uniform(0.05, np.pi - 0.05)
        scale = 10.0 ** rng.uniform(-2.0, 2.0, 2)
        W = np.outer(scale, scale) * [[1.0, np.cos(angle)], [np.cos(angle), 1.0]]
        sides = rng.choice([-1.0, 1.0], 2)
        u = scale * rng.permutation([1.0, -(10.0 ** rng.uniform(-3.0, 0.5))])
        expected = struck_by_turns(u, W, restitution)
        rates, w = (sides * u).tolist(), (np.outer(sides, sides) * W).tolist()
        for _ in range(300):
            pair = [contact(v, s, acceleration=-s) for v, s in zip(rates, sides.tolist(), strict=True)]
            got = resolved(pair, w, restitution)
            if not got.strikes:
                break
            rates = got.velocities
            chains += 1
        u_end = sides * rates
        assert (u_end <= 1e-13 * max(1.0, scale.max())).all()
        if expected is None:  # slower than any count: it tends to rest at both stops
            continue
        ended += 1
        np.testing.assert_allclose(u_end / scale, expected / scale, atol=1e-9)
    assert chains >= 400
    assert ended > 300


def test_the_energy_of_an_impact_to_rounding():
    """(1 - e^2) v_j^2 / (2 W_jj), on the equation itself, without any motion."""
    rng = np.random.default_rng(4)
    for _ in range(1000):
        q, qd, restitution = rng.uniform(-3, 3, 4), rng.normal(0, 2, 4), rng.uniform(0, 1)
        qd[1] = abs(qd[1]) + 0.01
        M = UNEQUAL.mass_matrix(q)
        W = np.linalg.inv(M)
        pair = [contact(qd[1], 1.0), contact(qd[3], away=True)]
        got = resolved(pair, W[np.ix_((1, 3), (1, 3))], restitution)
        after = qd + W[:, [1, 3]] @ got.impulses
        assert got.velocities[0] == pytest.approx(after[1], abs=1e-12 * np.abs(qd).max())
        before = 0.5 * qd @ M @ qd
        lost = (1.0 - restitution**2) * qd[1] ** 2 / (2.0 * W[1, 1])
        assert abs(before - 0.5 * after @ M @ after - lost) <= 1e-12 * before
