"""Instants of effects divide an interval into pieces, which end as intervals of these lengths would."""

import dataclasses
import math

import numpy as np
import pytest
from catalogue import FOUR_R, RPRP, assert_same_bits
from late_command import LateCommand, SampledBrake
from wall import Wall

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.compiler.backends.torch import torch
from redundant_envs.model.batch import Numerics

LENGTH = 0.02
STOPS = e.PrismaticStop((-0.1, -0.1), (0.1, 0.15), 0.5)
STEPS = {
    "rk8": {},
    "rk4": {"integrator": "rk4", "substeps": 3},
    "1e-6": {"tolerance": 1e-6},
    "dop853": {"integrator": "dop853"},
}
ON = pytest.mark.parametrize("steps", STEPS.values(), ids=STEPS)
BOTH = pytest.mark.parametrize("arm", [FOUR_R, RPRP], ids=["4R", "RPRP with stops"])


def scenes(arm, *effects, **steps):
    """A scene, and the same with effects that have instants."""
    own = (e.Gravity(), STOPS) if arm is RPRP else (e.Gravity(),)
    plain = rde.Scene(arm, own, control_dt=LENGTH, **steps)
    return plain, dataclasses.replace(plain, effects=(*effects, *own))


def starts(arm, lanes=24, seed=8):
    """States, and commands of five intervals."""
    rng = np.random.default_rng(seed)
    q, qd = rng.uniform(-1.0, 1.0, (lanes, 4)), 2.0 * rng.normal(size=(lanes, 4))
    q[:, np.array(arm.prismatic)] *= 0.1
    return q, qd, rng.uniform(-4.0, 4.0, (5, lanes, 4))


def simulators(*given):
    """Simulators of some scenes in the same states, and commands."""
    q, qd, commands = starts(given[0].robot)
    made = [rde.BatchSimulator(scene, len(q)) for scene in given]
    for batch in made:
        batch.set_state(q, qd)
    return (*made, commands)


# ---- pieces --------------------------------------------------------------------------------------------


@pytest.mark.quick("0.0-0-rk8-4R")
@BOTH
@ON
@pytest.mark.parametrize(("seconds", "acts"), [(0.0, 0), (-0.001, 1), (LENGTH, 1), (math.inf, 1)])
def test_an_instant_at_the_start_or_outside_of_the_interval_costs_nothing_and_changes_no_bit(
    arm, steps, seconds, acts
):
    whole, late, commands = simulators(*scenes(arm, LateCommand(seconds), **steps))
    for before, command in zip((np.zeros_like(commands[0]), *commands), commands, strict=False):
        status, expected = late.advance(command), whole.advance(before if acts else command)
        assert_same_bits((late.q, late.qd, *status), (whole.q, whole.qd, *expected))


@pytest.mark.quick("rk8-4R")
@BOTH
@ON
def test_lanes_of_one_block_have_their_own_pieces_or_none(arm, steps):
    """Sliders begin at rest at their stops, some pressed onto them and some pulled away."""
    times = np.array([0.0, 0.013, LENGTH, 0.007, 0.3, 1e-9, 0.0199, 0.0])
    made = scenes(arm, LateCommand(0.007), SampledBrake(0.5, 0.6), e.Lag(0.03), **steps)[1]
    q, qd, commands = starts(arm, len(times), seed=3)
    if arm is RPRP:
        q[:4, [1, 3]], qd[:4] = (0.1, 0.15), 0.0
        q[2, [0, 2]] = np.pi
        commands[:, :4, 1::2] *= 20.0
    lanes = [rde.BatchSimulator(made, 1) for _ in times]
    block = rde.BatchSimulator(made, len(times))
    for batch, rows in [(block, slice(None)), *((one, slice(k, k + 1)) for k, one in enumerate(lanes))]:
        batch.set_parameters({"late_command.seconds": times[rows]})
        batch.set_state(q[rows], qd[rows])
    for command in commands:
        status = block.advance(command)
        alone = [one.advance(command[k : k + 1]) for k, one in enumerate(lanes)]
        for name in ("q", "qd"):
            assert_same_bits(getattr(block, name), [getattr(one, name)[0] for one in lanes])
        for found, expected in zip(status, zip(*alone, strict=True), strict=True):
            assert_same_bits([found], [np.concatenate(expected)])


SEVERAL = {
    "in another order": (0.011, 0.002, 0.017, 0.006),
    "equal ones": (0.006, 0.013, 0.006, 0.013),
    "at the start, beyond the end, and two": (0.0, 0.05, 0.004, -0.5),
}


def delays(times):
    """Effects with an instant each."""
    kinds = (type(f"late{k}", (LateCommand,), {"key": f"late{k}"}) for k in range(len(times)))
    return tuple(kind(time) for kind, time in zip(kinds, times, strict=True))


@pytest.mark.long
@pytest.mark.parametrize("times", SEVERAL.values(), ids=SEVERAL)
def test_instants_happen_in_the_order_of_time(times):
    by_hand, late, commands = simulators(*scenes(RPRP, *delays(times)))
    ends = sorted({t for t in times if 0.0 < t < LENGTH} | {LENGTH})
    waiting = [0.0 * commands[0]] * len(times)
    for command in commands:
        start = 0.0
        for end in ends:
            reaching = [command]
            for time, before in zip(times, waiting, strict=True):
                reaching.append(reaching[-1] if 0.0 <= time <= start else before)
            by_hand.advance_partly(reaching[-1], end - start)
            start = end
        waiting = reaching[:-1]
        late.advance(command)
        assert_same_bits((late.q, late.qd), (by_hand.q, by_hand.qd))


def test_a_fifth_instant_is_refused():
    assert rde.Scene(FOUR_R, delays((0.001, 0.002, 0.003, 0.004)))
    with pytest.raises(ValueError, match=r"5 instants, of late0, .*; a scene may have 4: .*leave some out"):
        rde.Scene(FOUR_R, delays((0.0, 0.001, 0.002, 0.003, 0.004)))


# ---- states that are renewed at an instant -------------------------------------------------------------


def test_what_was_read_acts_from_the_instant_on():
    braked, free = (scenes(FOUR_R, SampledBrake(k, 0.5))[1] for k in (2.0, 0.0))
    braked, free, commands = simulators(braked, free)
    sampled = np.zeros(24)
    for command in commands:
        free.set_state(braked.q, braked.qd)
        braked.advance(command)
        free.advance_partly(command - 2.0 * sampled[:, None] * [1.0, 0.0, 0.0, 0.0], 0.5 * LENGTH)
        sampled = (free.qd @ FOUR_R.motor_map)[:, 0]
        free.advance_partly(command - 2.0 * sampled[:, None] * [1.0, 0.0, 0.0, 0.0], LENGTH - 0.5 * LENGTH)
        np.testing.assert_allclose(braked.q, free.q, rtol=0.0, atol=1e-13)
        np.testing.assert_allclose(braked.z[:, 0], sampled, rtol=0.0, atol=1e-11)
    assert np.abs(sampled).max() > 1.0


def test_the_instant_of_an_interval_that_is_crossed_in_parts_stays_where_it_is_and_none_is_at_its_end():
    half, end, commands = simulators(*(scenes(FOUR_R, SampledBrake(2.0, k))[1] for k in (0.5, 1.0)))
    half.advance_partly(commands[0], 0.4 * LENGTH)
    assert not half.z.any()
    half.advance_partly(commands[0], 0.6 * LENGTH)
    assert half.z.all()
    end.advance(commands[0])
    assert not end.z.any()


# ---- the tolerance, faults and what is told ------------------------------------------------------------


@pytest.mark.long
def test_a_piece_that_is_given_up_gives_up_its_interval():
    """The arm falls against a wall, at which it bounces without end."""
    effects = LateCommand(0.01), e.Gravity(9.81, (1.0, 0.0)), Wall(1.3, 0.2)
    batch = rde.BatchSimulator(rde.Scene(rde.RPRP((1.0,) * 4, (0.5,) * 2), effects, tolerance=1e-6))
    batch.set_state([0.37, 0.2, 0.27, 0.1], np.zeros(4))
    for _ in range(100):
        before = batch.q, batch.qd
        status = batch.advance()
        if status.numerics[0] & Numerics.EVENT_BUDGET:
            break
    assert status.numerics[0] & Numerics.EVENT_BUDGET
    assert_same_bits((batch.q, batch.qd), before)


def test_a_differentiable_step_knows_the_time_of_an_instant():
    scene = scenes(FOUR_R, LateCommand(0.007), **STEPS["rk4"])[1]
    q, qd, commands = (torch.tensor(x) for x in starts(FOUR_R, 6))
    step, z = rde.torch_step(scene), 5.0 * commands[0]

    def moved(seconds):
        return step(q, qd, 5.0 * commands[1], {"late_command.seconds": seconds}, z=z)[1].sum()

    seconds = torch.tensor(0.007, dtype=torch.float64, requires_grad=True)
    moved(seconds).backward()
    with torch.no_grad():
        slope = (moved(seconds + 1e-6) - moved(seconds - 1e-6)) / 2e-6
    assert float(seconds.grad) == pytest.approx(float(slope), rel=1e-6)
    assert abs(slope) > 1.0


def test_efforts_within_an_interval_know_whether_the_instant_has_passed():
    given, times = np.arange(1.0, 5.0), np.array([0.0, 0.006, 0.007, 0.015, LENGTH, 0.026, 0.028])
    found = rde.simulate(
        scenes(FOUR_R, LateCommand(0.007))[1], np.zeros(4), np.zeros(4), times,
        lambda t, q, qd: given * (1.0 + round(t / LENGTH)),
    )  # fmt: skip
    assert_same_bits([found.efforts], [np.outer([0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 2.0], given)])
