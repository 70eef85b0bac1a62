"""The number of trial steps that find events of sliders at their stops, and first guesses of their times."""

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.events.boundary import BoundedCoordinate
from redundant_envs.events.crossings import Crossing
from redundant_envs.events.first_event import Encounter, first_event
from redundant_envs.events.search import (
    Search,
    Trial,
    earliest_event,
    other_event,
    position_at_event,
    sought_boundary,
)
from redundant_envs.numerics.methods import Watched

ARM = rde.RPRP((2.0, 1.5, 1.0, 0.5), (0.3, 0.5))


def scene(restitution=0.5, upper=(0.3, 0.3), **kwargs):
    effects = (rde.effects.Gravity(), rde.effects.PrismaticStop((0.0, 0.0), upper, restitution))
    return rde.Scene(ARM, effects, **{"control_dt": 0.02, "tolerance": None, **kwargs})


def random_states(count, seed=1):
    rng = np.random.default_rng(seed)
    q = np.column_stack([rng.uniform(-3, 3, count), rng.uniform(0, 0.3, count)] * 2)
    q[::7, 1] = 0.3
    return q, rng.normal(0, 2, (count, 4)), rng.uniform(-20, 20, (count, 4))


# ---- the first guess -----------------------------------------------------------------------------


def slider_along(motion, h, upper, lower=-9.0):
    """A free slider whose position is a polynomial of time, in a step of h."""
    v, a = motion.deriv(), motion.deriv(2)
    seen = [a(t) for t in np.linspace(0.0, h, 13)]
    watched = Watched(seen[0], seen[-1], min(seen), max(seen))
    return BoundedCoordinate(motion(h), v(h), motion(0.0), v(0.0), watched, 0.0, lower, upper)


def first_guess(motion, h, upper, turns=0.0):
    """Time at which ``first_event`` predicts such a slider at its upper stop."""
    slider = slider_along(motion, h, upper)
    encounter = Encounter(0.0, slider, 0.0, 0.0, Crossing.NONE, turns, False, 1.0)
    found = first_event(encounter, h, 1.0 / h, True)
    assert (found.side, found.turns) == (1.0, False)
    return found.time


def test_the_first_guess_of_an_impact_is_the_zero_of_the_quintic():
    rng = np.random.default_rng(2)
    h, upper, worst = 0.02, 0.1, []
    while len(worst) < 500:
        motion = np.polynomial.Polynomial(rng.normal(size=6) * [0.0, 1.0, 20.0, 500.0, 5e3, 1e5])
        motion = motion - motion(h) + upper + abs(rng.normal(0, 0.005))
        roots = (motion - upper).roots()
        roots = roots.real[(abs(roots.imag) < 1e-12) & (roots.real > 0.0) & (roots.real < h)]
        slope = motion.deriv()(np.linspace(0.0, h, 50))
        if motion(0.0) < upper and len(roots) == 1 and (slope > 0.1).all():
            worst.append(abs(first_guess(motion, h, upper) - roots[0]) / h)
    assert np.median(worst) < 1e-14
    assert np.quantile(worst, 0.95) < 1e-7
    assert np.quantile(worst, 0.98) < 1e-5  # of speeds that change fivefold; a guess may be a bad one


@pytest.mark.parametrize("speed", [0.0, -0.1])
def test_one_that_begins_at_its_stop_and_comes_back_comes_later(speed):
    h, upper = 0.02, 0.1
    motion = np.polynomial.Polynomial([upper, speed, -50.0, 5000.0])
    back = (50.0 + np.sqrt(2500.0 - 20000.0 * speed)) / 10000.0
    assert abs(motion(back) - upper) < 1e-15
    turns = motion.deriv().roots().max()
    assert first_guess(motion, h, upper, turns) == pytest.approx(back, abs=0.1 * h)


def test_an_impact_takes_less_than_two_pieces_to_be_found():
    batch = rde.BatchSimulator(scene(), 2000)
    q, qd, efforts = random_states(2000)
    q[::7, 1] = 0.1
    batch.set_state(q, qd)
    status = batch.advance(efforts)
    once = status.events == 1  # the common step, the pieces towards the impact, one to the end
    assert once.sum() > 200
    pieces = status.evaluations[once] / 12.0 - 2.0
    assert (pieces >= 1.0).all()
    assert pieces.mean() < 1.7  # from the cubic through both ends it was 1.96


@pytest.mark.parametrize(
    ("kwargs", "mean", "most"),
    [({"integrator": "euler"}, 10, 100), ({}, 250, 3000),
     ({"integrator": "rk4", "control_dt": 0.25}, 320, 1900)],
    ids=str,
)  # fmt: skip
def test_no_search_stalls_in_steps_that_are_too_long(kwargs, mean, most):
    """In steps of 0.1 s means were 47, 146 and 417 evaluations when no search was made to end."""
    batch = rde.BatchSimulator(scene(**{"control_dt": 0.1, **kwargs}), 4000)
    q, qd, efforts = random_states(4000, 3)
    batch.set_state(q, qd)
    for _ in range(2):
        status = batch.advance(efforts)
        assert not status.numerics.any()
        assert status.evaluations.mean() < mean
        assert status.evaluations.max() < most


# ---- release -------------------------------------------------------------------------------------


def resting(count, push=(0.0, -30.0, 0.0, -30.0), **kwargs):
    """Arms whose sliders have come to rest at their lower stops."""
    batch = rde.BatchSimulator(scene(0.0, **kwargs), count)
    q = np.tile([0.3, 0.0, -0.4, 0.0], (count, 1))
    q[:, 0] += np.linspace(0.0, 1.0, count)
    batch.set_state(q, np.zeros((count, 4)))
    batch.advance(np.tile(push, (count, 1)))
    assert (batch.q[:, [1, 3]] == 0.0).all()
    assert (batch.qd[:, [1, 3]] == 0.0).all()
    return batch


PULLS = [(0.0, 60.0, 0.0, -30.0), (0.0, -60.0, 0.0, 40.0), (0.0, 60.0, 0.0, 40.0)]


@pytest.mark.parametrize("pull", PULLS, ids=str)
def test_sliders_that_an_effort_lets_go_take_the_common_step_alone_and_are_logged(pull):
    batch, fine = resting(9), resting(9, substeps=32)
    status = batch.advance(np.tile(pull, (9, 1)))
    np.testing.assert_array_equal(status.evaluations, 12)
    leave = [f > 0.0 for f in (pull[1], pull[3])]
    assert ((batch.q[:, [1, 3]] > 0.0) == leave).all()
    fine.advance(np.tile(pull, (9, 1)))
    np.testing.assert_allclose(batch.q, fine.q, rtol=0, atol=1e-11)
    q, efforts = [0.3, 0.0, -0.4, 0.0], lambda t, q, qd: (0.0, -30.0, 0.0, -30.0) if t < 0.01 else pull
    trajectory = rde.simulate(scene(0.0), q, [0.0] * 4, [0.02, 0.04], efforts)
    released = {x.joint for x in trajectory.events if x.kind == "release" and x.time == 0.02}
    assert released == {joint for joint, leaves in zip(("r1", "r2"), leave, strict=True) if leaves}
    np.testing.assert_allclose(trajectory.q[-1], batch.q[0], rtol=0, atol=1e-13)


@pytest.mark.parametrize("kwargs", [{"tolerance": 1e-6}, {"integrator": "rk4", "control_dt": 0.1}], ids=str)
def test_one_that_is_let_go_and_comes_back_in_the_same_step_is_not_beyond_its_stop(kwargs):
    """With the log of events and without: the same motion to the last bit."""
    count = 2000
    plain, logged = (
        rde.BatchSimulator(scene(0.0, (0.25, 0.25), **kwargs), count, track_work=track)
        for track in (False, True)
    )
    rng = np.random.default_rng(8)
    q, qd, _ = random_states(count, 8)
    q[:, [1, 3]] = rng.choice([0.0, 0.1, 0.25], (count, 2))
    qd[:, [1, 3]] *= q[:, [1, 3]] == 0.1
    qd[:, [0, 2]] *= 4.0
    for batch in (plain, logged):
        batch.set_state(q, qd)
    for _ in range(5):
        efforts = rng.uniform(-20, 20, (count, 4))
        a, b = plain.advance(efforts), logged.advance(efforts)
        sliders = plain.q[a.numerics == 0][:, [1, 3]]  # such long steps may diverge, and are flagged
        assert len(sliders) > 0.99 * count
        assert (sliders >= 0.0).all()
        assert (sliders <= 0.25).all()
        np.testing.assert_array_equal(plain.q, logged.q)
        np.testing.assert_array_equal(plain.qd, logged.qd)
        np.testing.assert_array_equal(a.events, b.events)
        np.testing.assert_array_equal(a.evaluations, b.evaluations)
        last: dict[tuple[int, str], str] = {}
        for x in logged.events(0.0):
            # A released slider has to come to rest before it is released again.
            assert (x.kind, last.get((x.lane, x.joint))) != ("release", "release")
            last[x.lane, x.joint] = x.kind
        assert "release" in last.values()


@pytest.mark.parametrize(
    ("position", "velocities", "at"),
    [
        (-7.8e-32, (-1.0, 0.0, 1.0), 0.0),
        (0.25 + 6e-17, (-1.0, 0.0, 1.0), 0.25),
        (0.1, (1.0,), 0.1),  # on its way
        (0.25 - 5e-16, (1.0,), 0.25),  # there in no time
        (0.25 - 5e-16, (-1.0,), 0.25 - 5e-16),  # but not backwards
    ],
)
def test_a_slider_a_rounding_error_beyond_its_stop_is_put_on_it(position, velocities, at):
    for velocity in velocities:
        s = BoundedCoordinate(position, velocity, 0.1, 0.0, None, 0.0, 0.0, 0.25)
        assert position_at_event(s, position, False, 5.0, 0.02) == at


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (1, 2, 0)], ids=str)
def test_of_three_sliders_the_first_that_comes_to_its_stop_is_looked_for(order):
    """They glide beyond theirs at three times; a search for another one's event changes to the first."""
    h = 0.02
    times = np.array([0.004, 0.009, 0.014])[list(order)]
    glides = [np.polynomial.Polynomial([0.3 - t, 1.0]) for t in times]
    sliders = [slider_along(glide, h, 0.3, 0.0) for glide in glides]
    encounters = [
        Encounter(float(k), s, 0.0, 0.0, Crossing.ENDS_BEYOND, h, False, 1.0) for k, s in enumerate(sliders)
    ]
    trial = Trial(h, h, h, encounters, [first_event(e, h, 1.0 / h, True) for e in encounters])
    first = order.index(0)
    aim = earliest_event(trial)
    assert (aim.exists, aim.target, aim.side, aim.turns) == (True, first, 1.0, False)
    assert aim.h == pytest.approx(0.004, abs=1e-12)
    # Towards the last of them: the trial step shows that two others came before.
    last = order.index(2)
    search = Search(float(last), 1.0, 0.0, h, 0.0, 0.006, 1.0)
    other = other_event(trial, search, sought_boundary(search, trial))
    assert other.exists
    assert other.target != last
    assert other.h < h
    # Towards the first of them there is none before.
    search = search._replace(target=float(first))
    trial = trial._replace(encounters=encounters[first : first + 1], events=trial.events[first : first + 1])
    assert not other_event(trial, search, sought_boundary(search, trial)).exists
