"""Events of sliders at their stops: reversed within one step, released, and found by few trial steps."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from catalogue import RPRP, stops

import redundant_envs as rde
from redundant_envs.simulator.events import crossings
from redundant_envs.simulator.events.boundary import BoundedCoordinate
from redundant_envs.simulator.events.first_event import Encounter, Event
from redundant_envs.simulator.events.search import Search, Trial, last_piece, sought_boundary
from redundant_envs.simulator.numerics.methods import Watched
from studies.interval_families import FAMILIES, Draw
from studies.intervals import judge_family, tips_after
from studies.stop_families import NAMED, StopFamily

REACH = rde.load_scene("rprp_reach")

FOUND = json.loads(Path(__file__).with_name("found_intervals.json").read_text(encoding="utf-8"))
CAUGHT = [np.array([x[name] for x in FOUND["undone within the interval"]]) for name in ("q", "qd", "efforts")]
"""Of random actions in the reach task: a slider meets its stop and leaves it, or leaves it and is back, or
the other slider's release decides, all within 20 ms."""
CASCADES = Draw(*(np.array([x[n] for x in FOUND["cascades"]]) for n in ("joints", "rates", "efforts")), {})
"""Of a light slider between near stops: 55 to 200 impacts in 50 ms, which magnify errors 1e10 times; these
intervals were off by 2 to 200 tolerances."""


BEYOND = FOUND["beyond their tolerance"]
"""Of a million intervals of ``study intervals``: these were off by 1.9 to 2.7 tolerances without a flag."""


def scene(restitution=0.5, upper=0.3, **kwargs):
    effects = (rde.effects.Gravity(), stops(RPRP, restitution, upper=upper))
    return rde.Scene(RPRP, effects, **kwargs)


def advanced(scene, q, qd, efforts):
    """States after an interval, (n, 8), and its status."""
    batch = rde.BatchSimulator(scene, len(q))
    batch.set_state(q, qd)
    status = batch.advance(efforts)
    return np.concatenate([batch.q, batch.qd], axis=1), status


@pytest.mark.long
@pytest.mark.parametrize("tolerance", [1e-6, None])
def test_events_undone_within_the_interval_are_found(tolerance):
    (fine, known), (coarse, found) = (
        advanced(dataclasses.replace(REACH, **how), *CAUGHT)
        for how in ({"tolerance": None, "substeps": 64}, {"tolerance": tolerance})
    )
    np.testing.assert_allclose(coarse[:, :4], fine[:, :4], rtol=0, atol=1e-6)
    more = found.events - known.events  # under a tolerance lower bounces may count, too
    assert (more >= 0 if tolerance else more == 0).all()
    assert not (found.numerics | known.numerics).any()


MANY_IMPACTS = StopFamily(control_dt=0.1, travel=0.02, restitution=0.99)


@pytest.mark.long
@pytest.mark.parametrize(
    ("family", "count", "seed", "judged", "flagged"),
    [
        *((NAMED[k], 1024, k, 0.99, 1) for k in range(3)),
        *(pytest.param(NAMED[k], 1024, k, 0.99, 1, marks=pytest.mark.long) for k in range(3, len(NAMED))),
        (MANY_IMPACTS, 4096, 3, 0.98, 40),
    ],
)
def test_no_interval_of_a_family_hides_an_impact(family, count, seed, judged, flagged):
    """Of every thousand, up to 43 did, and of 4096 with up to 256 impacts in 0.1 s two. Few are given up.
    ``study impacts`` judges a million."""
    tally = judge_family(family, count, seed=seed)
    assert tally.judged >= judged * tally.intervals
    assert tally.missed == 0
    assert tally.flagged <= flagged


@pytest.mark.parametrize("side", [1.0, -1.0], ids=["upper", "lower"])
def test_a_slider_that_leaves_a_single_stop_at_zero_may_come_back_to_it(side):
    """All limits and positions are 0 there, but the scale of rounding must not become 0."""
    ends = (-np.inf, 0.0) if side > 0.0 else (0.0, np.inf)
    watched = Watched(0.0, 0.0, -60.0, 60.0)
    slider = BoundedCoordinate(-1e-3 * side, 0.1 * side, 0.0, 0.0, watched, 0.0, *ends)
    beyond = crossings.excursions(slider, 0.02, -60.0, 60.0)
    assert beyond[0 if side > 0.0 else 1] > 0.0


@pytest.mark.long
def test_what_is_not_near_a_stop_does_not_meet_one():
    rng = np.random.default_rng(6)
    overshoot = crossings.Overshoot(between=0.1, at_ends=0.01)
    q0, q1 = rng.uniform(-0.2, 0.2, (2, 3000))
    v0, v1 = rng.normal(0.0, 3.0, (2, 3000))
    least, most = np.sort(rng.normal(0.0, 2000.0, (2, 3000)), axis=0)
    first, last = rng.uniform(least, most, (2, 3000))
    met, far = 0, 0
    for q, v, q_start, v_start, *seen in zip(q1, v1, q0, v0, first, last, least, most, strict=True):
        slider = BoundedCoordinate(q, v, q_start, v_start, Watched(*seen), 0.0, -0.2, 0.2)
        meets = crossings.crossing_of(slider, 0.02, overshoot) != crossings.Crossing.NONE
        near = crossings.may_meet(slider, 0.02, overshoot)
        assert near or not meets
        met, far = met + meets, far + (not near)
    assert min(met, far) > 100


def test_a_release_near_the_end_of_an_euler_step_is_found_in_it():
    """The only stage of the step is at its start, so the force of the stop is computed at its end, too."""
    q, efforts = [-1.2, 0.3, -1.2, 0.3], [30.0, -20.0, 8.0, -3.0]
    made = scene(0.0, integrator="euler")
    motion = rde.simulate(made, q, [0.0] * 4, np.linspace(0.02, 0.6, 30), efforts)
    steps = [x.time / 0.02 for x in motion.events if x.kind == "release" and x.time > 0.0]
    assert steps
    assert all(abs(n - round(n)) > 1e-3 for n in steps)


# ---- searches ------------------------------------------------------------------------------------------


def random_states(count, seed=1):
    rng = np.random.default_rng(seed)
    q = np.column_stack([rng.uniform(-3, 3, count), rng.uniform(0, 0.3, count)] * 2)
    q[::7, 1] = 0.3
    return q, rng.normal(0, 2, (count, 4)), rng.uniform(-20, 20, (count, 4))


@pytest.mark.long
def test_an_impact_takes_hardly_more_than_one_trial_step_to_be_found():
    q, qd, efforts = random_states(2000)
    q[::7, 1] = 0.1
    _, status = advanced(scene(), q, qd, efforts)
    once = status.events == 1  # the common step, the pieces towards the impact, one to the end
    assert once.sum() > 200
    pieces = status.evaluations[once] / 12.0 - 2.0
    assert (pieces >= 1.0).all()
    assert pieces.mean() < 1.15  # with a last piece that had to be straight it was 1.6


@pytest.mark.long
def test_the_common_step_is_the_first_trial_step_where_a_slider_rests_too():
    batch, pieces = resting(500), []
    for _ in range(12):
        status = batch.advance(np.tile((0.0, 60.0, 0.0, -60.0), (500, 1)))
        still = (batch.q[:, 3] == 0.0) & (batch.qd[:, 3] == 0.0)
        pieces += list(status.evaluations[(status.events == 1) & still] / 12.0 - 2.0)
    assert len(pieces) > 200
    assert min(pieces) >= 1.0
    assert np.mean(pieces) < 1.15  # when it was thrown away there it was 2.0


@pytest.mark.long
def test_a_cascade_of_impacts_is_within_its_tolerance_or_flagged():
    family = StopFamily(
        control_dt=0.05, effort=50.78106734486679, travel=0.08798962107726063, restitution=0.9, g=0.0,
        masses=(0.6657948893150493, 0.1024684138297729, 1.3163296764711991, 0.15332025342673344),
        lengths=(0.7871387042944776, 0.10470120608022544),
    )  # fmt: skip
    exact, trusted = tips_after(family, family.scene(integrator="dop853"), CASCADES)
    tip, status = tips_after(family, family.scene(), CASCADES)
    assert status.events.min() > 50
    assert not trusted.numerics.any()
    error = np.linalg.norm(tip - exact, axis=1)
    assert ((error <= family.tolerance) | (status.numerics != 0)).all()


@pytest.mark.long
@pytest.mark.parametrize("found", BEYOND, ids=lambda found: found["what"])
def test_intervals_that_were_beyond_their_tolerance_keep_it(found):
    family = next(family for family in FAMILIES if family.name == found["family"])
    lane = {name: np.array([found[name]]) for name in ("joints", "rates", "efforts")}
    drawn = Draw(**lane, parameters={name: np.array([x]) for name, x in found["parameters"].items()})
    (exact, sure), (tip, status) = (
        tips_after(family, family.scene(**how), drawn) for how in ({"integrator": "dop853"}, {})
    )
    assert not (sure.numerics | status.numerics).any()
    assert np.linalg.norm(tip - exact) < 0.7 * family.tolerance


def moving(position, velocity, acceleration):
    """A slider between stops at 0 and 0.25 m after a trial step of 10 ms."""
    start = Watched(acceleration, acceleration, acceleration, acceleration)
    back = position - 0.01 * velocity
    return BoundedCoordinate(position, velocity, back, velocity, start, 0.0, 0.0, 0.25)


@pytest.mark.parametrize(
    ("time", "acceleration", "other", "possible"),
    [
        (1.9e-7, 1.0, 0.1, True),
        (2.1e-7, 1.0, 0.1, False),  # longer than 1e-5 of 20 ms
        (-1.9e-7, 1.0, 0.1, True),  # it ends beyond the stop
        (1.9e-7, 2e4, 0.1, False),  # its speed changes by 0.4 %
        (1.9e-7, 1.0, 0.25 - 1e-8, False),  # another slider is near a stop
        (3.9e-10, 2e4, 0.25 - 1e-12, True),  # but so near to its stop it is straight
    ],
)
def test_the_last_piece_to_a_stop_is_short_and_alone(time, acceleration, other, possible):
    sliders = moving(0.25 - time, 1.0, acceleration), moving(other, 0.5, 1.0)
    encounters = [Encounter(float(k), s, 0.0, 0.0, 0.0, 0.0, False, 1.0) for k, s in enumerate(sliders)]
    trial = Trial(0.01, 0.02, 0.02, 0.0, encounters, [Event(0.01, 1.0, False)] * 2)
    sought = sought_boundary(Search(0.0, 1.0, 0.0, 0.02, 0.0, 0.0, 0.0), trial)
    piece = last_piece(trial, sought)
    assert piece.possible == possible
    if possible:
        assert piece.time == pytest.approx(min(time, (0.25 - other) / 0.5), rel=1e-6)
        arrived = [True, False] if time < (0.25 - other) / 0.5 else [False, True]
        assert [position == 0.25 for position in piece.positions] == arrived


@pytest.mark.long
@pytest.mark.parametrize("how", [{"tolerance": 1e-12}, {"integrator": "dop853"}], ids=str)
def test_motions_behind_an_impact_are_as_exact_as_those_of_shorter_last_pieces(how):
    """Of the hundredth of a step of 20 ms; a last piece of first order would leave 1e-9 m/s."""
    q, qd, efforts = random_states(2000)
    (got, status), (fine, finer) = (advanced(scene(**x), q, qd, efforts) for x in (how, {"substeps": 100}))
    once = (status.events == 1) & (finer.events == 1)
    assert once.sum() > 200
    assert np.quantile(np.abs(got - fine)[once].max(axis=1), 0.99) < 2e-12


@pytest.mark.quick("{'integrator': 'euler'}-10-100")
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


@pytest.mark.long
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


@pytest.mark.long
@pytest.mark.parametrize("kwargs", [{"tolerance": 1e-6}, {"integrator": "rk4", "control_dt": 0.1}], ids=str)
def test_one_that_is_let_go_and_comes_back_in_the_same_step_is_not_beyond_its_stop(kwargs):
    rng, count = np.random.default_rng(8), 2000
    q, qd, _ = random_states(count, 8)
    q[:, [1, 3]] = rng.choice([0.0, 0.1, 0.25], (count, 2))
    qd[:, [1, 3]] *= q[:, [1, 3]] == 0.1
    qd[:, [0, 2]] *= 4.0
    batch = rde.BatchSimulator(scene(0.0, 0.25, **kwargs), count, track_work=True)
    batch.set_state(q, qd)
    for _ in range(5):
        status = batch.advance(rng.uniform(-20, 20, (count, 4)))
        sliders = batch.q[status.numerics == 0][:, [1, 3]]  # such long steps may diverge, and are flagged
        assert len(sliders) > 0.99 * count
        assert (sliders >= 0.0).all()
        assert (sliders <= 0.25).all()
        last: dict[tuple[int, str], str] = {}
        for x in batch.events(0.0):
            # A released slider has to come to rest before it is released again.
            assert (x.kind, last.get((x.lane, x.joint))) != ("release", "release")
            last[x.lane, x.joint] = x.kind
        assert "release" in last.values()
