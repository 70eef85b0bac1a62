"""Events of sliders at their stops: reversed within one step, released, and found by few trial steps."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from catalogue import RPRP, advanced, stops
from catalogue import tips_after as end_of

import redundant_envs as rde
from redundant_envs.simulator.events import crossings
from redundant_envs.simulator.events.boundary import BoundedCoordinate
from redundant_envs.simulator.numerics.methods import Watched
from studies.interval_families import FAMILIES, LaneSamples
from studies.intervals import judge_family, tips_after
from studies.stop_families import NAMED, StopFamily

REACH = rde.load_scene("rprp_reach")

FOUND = json.loads(Path(__file__).with_name("found_intervals.json").read_text(encoding="utf-8"))
CAUGHT = [np.array([x[name] for x in FOUND["undone within the interval"]]) for name in ("q", "qd", "efforts")]
"""Of random actions in the reach task: a slider meets its stop and leaves it, or leaves it and is back, or
the other slider's release decides, all within 20 ms."""
STATE = "joints", "rates", "efforts"
CASCADES = LaneSamples(*(np.array([x[name] for x in FOUND["cascades"]]) for name in STATE), {})
"""Of a light slider between near stops: 55 to 200 impacts in 50 ms, which magnify errors 1e10 times; these
intervals were off by 2 to 200 tolerances."""
BEYOND = FOUND["beyond their tolerance"]
"""Of a million intervals of ``study intervals``: these were off by 1.9 to 2.7 tolerances without a flag."""


def scene(restitution=0.5, **kwargs):
    return rde.Scene(RPRP, (rde.effects.Gravity(), stops(RPRP, restitution)), **kwargs)


@pytest.mark.long
@pytest.mark.parametrize("tolerance", [1e-6, None])
def test_events_undone_within_the_interval_are_found(tolerance):
    (fine, known), (coarse, found) = (
        advanced(dataclasses.replace(REACH, **how), *CAUGHT)
        for how in ({"tolerance": None, "substeps": 64}, {"tolerance": tolerance})
    )
    np.testing.assert_allclose(coarse.q, fine.q, rtol=0, atol=1e-6)
    more = found.events - known.events  # under a tolerance lower bounces may count, too
    assert (more >= 0 if tolerance else more == 0).all()
    assert not (found.numerics | known.numerics).any()


MANY_IMPACTS = StopFamily(control_dt=0.1, travel=0.02, restitution=0.99)


@pytest.mark.long
@pytest.mark.parametrize(
    ("family", "count", "judged", "flagged"), [(NAMED[0], 1024, 0.99, 1), (MANY_IMPACTS, 4096, 0.98, 40)]
)
def test_no_interval_of_a_family_hides_an_impact(family, count, judged, flagged):
    """Of every thousand, up to 43 did, and of 4096 with up to 256 impacts in 0.1 s two. Few are given up.
    ``study impacts`` judges a million."""
    tally = judge_family(family, count, seed=3)
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


def test_a_release_near_the_end_of_an_euler_step_is_found_in_it():
    """The only stage of the step is at its start, so the force of the stop is computed at its end, too."""
    q, efforts = [-1.2, 0.3, -1.2, 0.3], [30.0, -20.0, 8.0, -3.0]
    motion = rde.simulate(scene(0.0, integrator="euler"), q, [0.0] * 4, np.linspace(0.02, 0.6, 30), efforts)
    steps = [x.time / 0.02 for x in motion.events if x.kind == "release" and x.time > 0.0]
    assert steps
    assert all(abs(n - round(n)) > 1e-3 for n in steps)


@pytest.mark.quick("{'integrator': 'euler'}-10-100")
@pytest.mark.parametrize(
    ("kwargs", "mean", "most"),
    [({"integrator": "euler"}, 10, 100), ({"integrator": "rk4", "control_dt": 0.25}, 320, 1900)],
    ids=str,
)
def test_no_search_stalls_in_steps_that_are_too_long(kwargs, mean, most):
    """Means were 47 and 417 evaluations when no search was made to end."""
    batch = rde.BatchSimulator(scene(**{"control_dt": 0.1, **kwargs}), 4000)
    rng = np.random.default_rng(3)
    q = np.column_stack([rng.uniform(-3, 3, 4000), rng.uniform(0, 0.3, 4000)] * 2)
    batch.set_state(q, rng.normal(0, 2, (4000, 4)))
    efforts = rng.uniform(-20, 20, (4000, 4))
    for _ in range(2):
        status = batch.advance(efforts)
        assert not status.numerics.any()
        assert status.evaluations.mean() < mean
        assert status.evaluations.max() < most


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
    lane = {name: np.array([found[name]]) for name in STATE}
    drawn = LaneSamples(**lane, parameters={name: np.array([x]) for name, x in found["parameters"].items()})
    (exact, sure), (tip, status) = (
        tips_after(family, family.scene(**how), drawn) for how in ({"integrator": "dop853"}, {})
    )
    assert not (sure.numerics | status.numerics).any()
    assert np.linalg.norm(tip - exact) < 0.7 * family.tolerance


ENDS = {found["what"]: found for found in FOUND["ends of another program"]}


@pytest.mark.quick("a rest with dry friction that is found late")
@pytest.mark.parametrize("what", ENDS)
def test_intervals_end_where_another_program_ends_them(what):
    """Each was off by tolerances when it was found."""
    found, made = ENDS[what], rde.Scene.from_dict(ENDS[what]["scene"])
    tips, status = end_of(made, *([found[name]] for name in ("q", "qd", "efforts")))
    assert not status.numerics.any()
    assert np.linalg.norm(tips[0] - found["tip"]) <= found["most"]


@pytest.mark.parametrize(("most", "hidden"), [(0.8, False), (0.96, True), (1.2, False)])
def test_a_quantity_may_pass_a_whole_number_between_stages_and_come_back(most, hidden):
    """A parabola through the stages exceeds them by a tenth of their range at most."""
    met = crossings.meets_kink(Watched(0.2, 0.7, 0.2, most), True, crossings.Overshoot(0.1, 0.1))
    assert met == (most > 1.0, hidden)
