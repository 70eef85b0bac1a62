"""Contact resolution: which of one, two and three sliders are struck, come to rest and are released.

``complementary`` solves the problems by trying every set that may act.
"""

import numpy as np
import pytest

from redundant_envs.language.limits import ROUNDING
from redundant_envs.simulator.events import contacts
from redundant_envs.simulator.events.contacts import Contact, Happening, resolve_contacts
from studies.another_account import complementary

SLIDERS = pytest.mark.parametrize("count", [1, 2, 3], ids=["one slider", "two", "three"])


def mobility(rng, count):
    """A symmetric and positive definite matrix."""
    a = rng.normal(size=(count, count))
    return a @ a.T + 0.01 * np.eye(count)


def as_lists(*arrays):
    return [x.tolist() for x in arrays]


def contact(velocity=0.0, side=1.0, resting=False, acceleration=0.0, force=0.0, released=False, away=False):
    """A slider at the stop of a side, at 0.3 m; or away from both."""
    position, lower, upper = (0.15, 0.0, 0.3) if away else (0.3, 0.0, 0.3) if side > 0.0 else (0.3, 0.3, 0.6)
    return Contact(position, velocity, side if resting else 0.0, lower, upper, acceleration, force, released)


def resolved(contacts, w, restitution=0.5):
    """Contacts of stops of one restitution, resolved once."""
    alike = [c._replace(restitution=restitution) for c in contacts]
    return resolve_contacts(0.0, alike, np.asarray(w).tolist())


@SLIDERS
def test_struck_sliders_have_the_speeds_of_impulses_that_solve_the_complementarity_problem(count):
    """Those that rest or move onto their stops are struck; one that moves away has no support. Away from
    stops there is no impulse."""
    rng = np.random.default_rng(6)
    seen = set()
    for _ in range(500):
        w, e = mobility(rng, count), rng.uniform(0, 1)
        sides, v = rng.choice([-1.0, 1.0], count), rng.normal(size=count)
        away, resting = rng.random(count) < 0.2, rng.random(count) < 0.3
        resting &= ~away
        v[resting] = 0.0
        u = np.where(away, 0.0, sides * v)
        if not (u > 0).any():
            continue
        states = zip(*as_lists(v, sides, resting, away), strict=True)
        got = resolved([contact(*x[:3], away=x[3]) for x in states], w, e)
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
        struck = (p > 0) & (u > 0)
        assert got.impacts == np.count_nonzero(struck)
        kinds = np.where(struck, np.where(sides > 0, Happening.UPPER_IMPACT, Happening.LOWER_IMPACT), 0)
        left = resting & (sides * np.array(got.velocities) < 0.0)
        assert got.happened == np.where(left, Happening.RELEASE, kinds).tolist()
        assert (np.array(got.active_stops) != 0.0).tolist() == (resting & ~left).tolist()
        seen.add(tuple(p > 0))
    assert len(seen) == 2**count - 1


@SLIDERS
def test_of_sliders_that_rest_those_leave_whose_stops_would_pull_in_the_end(count):
    """Each decision changes the forces on the others: all are decided together, as before a common step."""
    rng = np.random.default_rng(7)
    seen = set()
    for _ in range(300):
        w, sides, force = mobility(rng, count), rng.choice([-1.0, 1.0], count), rng.normal(size=count)
        at = [contact(0.0, s, resting=True, force=f) for s, f in zip(*as_lists(sides, force), strict=True)]
        got = resolved(at, w)
        holds = complementary(np.outer(sides, sides) * w, -sides * (w @ force))  # accelerations without stops
        if not (sides * force > 0.0).any():
            holds = -sides * force  # all are pushed: nothing changes
        stays = holds > 0.0
        assert (np.array(got.active_stops) != 0.0).tolist() == stays.tolist()
        assert got.happened == np.where(stays, Happening.NONE, Happening.RELEASE).tolist()
        assert got.going_on
        np.testing.assert_allclose(got.forces, -sides * holds, rtol=1e-8, atol=1e-10)
        assert contacts.leaving(at, w) == (~stays).tolist()
        seen.add(tuple(stays))
    assert len(seen) == 2**count


@pytest.mark.parametrize("known", [False, True], ids=["fresh", "known to rest"])
@pytest.mark.parametrize(("press", "supported"), [(2.0, True), (0.0, True), (-2.0, False)])
def test_a_slider_that_stands_still_is_looked_at_before_another_one_strikes(known, press, supported):
    """It comes to rest, or is released, and then the other one strikes."""
    w = [[2.0, -1.0], [-1.0, 2.0]]  # the impulse that sends the second back drives the first onto its stop

    def first(rests):
        held = {"resting": True, "force": -0.5 * press} if rests else {"acceleration": press}
        return contact(0.0, 1.0, **held)

    striking = contact(1.0, 1.0)
    got = resolved([first(known), striking], w, 1.0)
    rests = press > 0.0 or (known and supported)
    if rests != known:
        assert (got.happened[0], got.impacts) == (Happening.REST if rests else Happening.RELEASE, 0.0)
        assert got.velocities == [0.0, 1.0]
        assert not got.going_on
        got = resolved([first(rests)._replace(released=got.released[0]), striking], w, 1.0)
    assert got.strikes
    assert got.impacts == 1.0
    assert got.velocities == [0.0 if supported else pytest.approx(1.0), -1.0]


@pytest.mark.parametrize(("height", "rests"), [(0.5, True), (2.0, False)])
@pytest.mark.parametrize(("side", "stop", "unit"), [(1.0, 4096.0, 4096.0), (-1.0, 0.0, 1.0)])
def test_an_elastic_slider_rests_where_its_bounce_is_lost_in_rounding(side, stop, unit, height, rests):
    """Less than four ulps of the position of its stop."""
    speed = (2.0 * height * ROUNDING * unit) ** 0.5
    c = contact(-side * speed, side, acceleration=side)._replace(position=stop, lower=0.0, upper=4096.0)
    assert (resolved([c], [[1.0]], 1.0).active_stops[0] != 0.0) is rests


def struck_by_turns(u, W, restitution, most=100_000):
    """Outward speeds after impacts of one slider at a time, at stops without any gap; None if they go on."""
    u = u.copy()
    for _ in range(most):
        if (u <= 1e-13).all():
            return u
        k = int(np.argmax(u))
        u -= W[:, k] * (1.0 + restitution) * u[k] / W[k, k]
    return None


@pytest.mark.quick("0.0", "1.0")
@pytest.mark.parametrize("restitution", [0.0, 0.1, 1.0])
def test_sliders_that_strike_by_turns_end_where_single_impacts_end(restitution):
    """One moves onto its stop, the other away from its own: never struck together, but in turn; a chain that
    never ends stops both."""
    rng = np.random.default_rng(5)
    chains = ended = 0
    for _ in range(150):
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
    assert chains >= 150
    assert ended > 100
