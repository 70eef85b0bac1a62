"""Delayed commands act at the instants that their delay says, to the bit."""

import dataclasses

import numpy as np
import pytest
from catalogue import FOUR_R, RPRP, advanced, assert_same_bits

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.effects.command_delay import rest, whole_intervals

DT = 0.02
STEPS = {"rk8": {"integrator": "rk8"}, "1e-6": {"tolerance": 1e-6}, "dop853": {"integrator": "dop853"}}
FRACTIONS = {0.013: (0, 0.013), 0.02: (1, 0.0), 0.033: (1, 0.033 - DT), 0.06: (3, 0.0)}
"""Delays, s: whole intervals, and the rest."""


def pair(arm, seconds, lanes=12, **steps):
    """A simulator with a delay, one without, and commands of some intervals."""
    own = (e.PrismaticStop((-0.1, -0.1), (0.1, 0.15), 0.5),) if arm is RPRP else ()
    bare = rde.Scene(arm, (e.Gravity(), *own), control_dt=DT, **steps)
    delayed = dataclasses.replace(bare, effects=(e.CommandDelay(seconds, 0.1), *bare.effects))
    rng = np.random.default_rng(5)
    q, qd = rng.uniform(-1.0, 1.0, (lanes, 4)), rng.normal(size=(lanes, 4))
    q[:, np.array(arm.prismatic)] *= 0.1
    made = (advanced(scene, q, qd, intervals=0)[0] for scene in (delayed, bare))
    return (*made, rng.uniform(-4.0, 4.0, (7, lanes, 4)))


@pytest.mark.quick("0.02-4R-rk8")
@pytest.mark.parametrize("steps", STEPS.values(), ids=STEPS)
@pytest.mark.parametrize("arm", [FOUR_R, RPRP], ids=["4R", "RPRP with stops"])
@pytest.mark.parametrize("seconds", FRACTIONS)
def test_a_delay_has_the_bits_of_commands_that_are_held_back_by_hand(arm, steps, seconds):
    delayed, bare, commands = pair(arm, seconds, **steps)
    n, r = FRACTIONS[seconds]
    sent = [0.0 * commands[0]] * (n + 1)
    for command in commands:
        sent = [command, *sent]
        status = delayed.advance(command)
        evaluations = bare.advance_partly(sent[n + 1], r).evaluations if r else 0
        evaluations = evaluations + bare.advance_partly(sent[n], DT - r).evaluations
        if "tolerance" in steps and r > 0.0:  # pieces have shares of the tolerance, and may need more steps
            np.testing.assert_allclose(delayed.q, bare.q, rtol=0.0, atol=1e-12)
            np.testing.assert_allclose(delayed.qd, bare.qd, rtol=0.0, atol=1e-11)
        else:
            assert_same_bits((delayed.q, delayed.qd), (bare.q, bare.qd))
            assert_same_bits([status.evaluations], [evaluations])


@pytest.mark.long
@pytest.mark.parametrize(("seed", "tolerance"), [(0, 1e-3), (1, 1e-5)])
def test_an_error_made_before_an_instant_is_small_enough_at_the_end_of_the_interval(seed, tolerance):
    dt, delay, lanes = 0.2, 0.06, 48
    arm = rde.FourR((0.5,) * 4, (0.9065, 0.78, 0.1136, 0.1136))
    bare = rde.Scene(arm, (), tolerance=1e-3 * tolerance, control_dt=dt, actuation="generalized")
    delayed = dataclasses.replace(bare, effects=(e.CommandDelay(delay, 0.1),), tolerance=tolerance)
    rng = np.random.default_rng(seed)
    q, qd = rng.uniform(-3.0, 3.0, (lanes, 4)), rng.normal(0.0, 2.0, (lanes, 4))
    before, now = rng.uniform(-15.0, 15.0, (2, lanes, 4))
    batch, _ = advanced(delayed, q, qd, before)
    finer, _ = advanced(bare, batch.q, batch.qd, intervals=0)
    faults = batch.advance(now).numerics
    faults = faults | finer.advance_partly(before, delay).numerics
    faults = faults | finer.advance_partly(now, dt - delay).numerics
    off = np.linalg.norm(arm.forward_kinematics(batch.q) - arm.forward_kinematics(finer.q), axis=1)
    assert (faults == 0).mean() > 0.5
    assert off[faults == 0].max() <= tolerance


def test_thousands_of_steps_around_an_instant_are_confirmed_without_a_flag():
    """They were given up: pieces were compared with themselves before the interval was, and got four times
    the steps."""
    rng = np.random.default_rng(5)
    q, qd = rng.uniform(-3.0, 3.0, (256, 4))[[0, 9]], rng.normal(0.0, 2.0, (256, 4))[[0, 9]]
    efforts = rng.uniform(-70.0, 70.0, (256, 4))[[0, 9]]
    arm = rde.FourR((0.5,) * 4, (0.9065, 0.78, 0.1136, 0.1136))
    delay = (e.CommandDelay(0.06, 0.4),)
    tips = []
    for how in ({"tolerance": 1e-3}, {"integrator": "dop853"}):
        scene = rde.Scene(arm, delay, control_dt=0.2, actuation="generalized", **how)
        batch, status = advanced(scene, q, qd, efforts)
        assert not status.numerics.any()
        assert status.evaluations.max() < 300_000
        tips.append(arm.forward_kinematics(batch.q))
    assert np.linalg.norm(tips[0] - tips[1], axis=1).max() <= 1e-4


@pytest.mark.parametrize(("seconds", "dt", "n"), [(0.3, 0.1, 3), (0.7, 0.1, 7), (1e-19, 0.1, 0)])
def test_a_delay_within_rounding_of_whole_intervals_is_these(seconds, dt, n):
    near = (seconds, np.nextafter(seconds, 1.0), np.nextafter(seconds, 0.0))
    assert [(whole_intervals(x, dt), rest(x, dt)) for x in near] == [(n, 0.0)] * 3
    assert rest((n + 1e-9) * dt, dt) == pytest.approx(1e-9 * dt, rel=1e-5)


def test_lanes_have_delays_of_their_own_which_may_change_in_a_motion():
    times = np.array([0.0, 0.005, 0.013, 0.02, 0.027, 0.04, 0.1, 0.0, 0.06, 0.079, 0.08, 0.099])
    delayed, bare, commands = pair(FOUR_R, 0.0)
    sent = [0.0 * commands[0]] * 8
    for k, command in enumerate(commands):
        delayed.set_parameters({"command_delay.seconds": np.roll(times, k)})
        delayed.advance(command)
        sent = [command, *sent]
        for lane, seconds in enumerate(np.roll(times, k).tolist()):
            n, r = int(whole_intervals(seconds, DT)), float(rest(seconds, DT))
            q, qd = bare.q, bare.qd
            if r:
                bare.advance_partly(sent[n + 1], r)
            bare.advance_partly(sent[n], DT - r)
            assert_same_bits([bare.q[lane], bare.qd[lane]], [delayed.q[lane], delayed.qd[lane]])
            bare.set_state(q, qd)
        bare.set_state(delayed.q, delayed.qd)


def test_a_control_interval_chooses_how_many_commands_are_kept():
    for longest, control_dt, kept in ((0.05, 0.02, 3), (0.05, 0.01, 6), (0.0, 0.02, 1)):
        scene = rde.Scene(FOUR_R, (e.CommandDelay(0.0, longest),), control_dt=control_dt)
        assert len(scene.states()) == 4 * kept


@pytest.mark.parametrize("kind", [e.CommandDelay, e.SensorDelay])
def test_a_delay_has_the_control_interval_of_its_scene_and_takes_no_other(kind):
    with pytest.raises(TypeError, match="control_dt"):
        kind(0.01, 0.05, control_dt=0.5)
    data = rde.Scene(FOUR_R, (kind(0.01, 0.05),), control_dt=0.02).to_dict()
    assert rde.Scene.from_dict({**data, "control_dt": 0.01}).effects[0].control_dt == 0.01
    data["effects"][0]["control_dt"] = 0.5
    with pytest.raises(ValueError, match="unknown key 'control_dt'; valid: seconds, longest"):
        rde.Scene.from_dict(data)
