"""Instants of effects divide an interval into pieces, which end as intervals of these lengths would."""

import copy
import dataclasses
import math

import gymnasium as gym
import numpy as np
import pytest
from catalogue import ARMS, FOUR_R, RPRP, assert_same_bits
from late_command import LateCommand, SampledBrake

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.algebra import physics
from redundant_envs.compiler.backends.torch import torch
from redundant_envs.model.batch import Numerics
from redundant_envs.simulator.lane.direct import cross_interval, fields_of, in_steps
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.interval import Interval
from redundant_envs.simulator.lane.memory import Lane

LENGTH = 0.02
STOPS = e.PrismaticStop((-0.1, -0.1), (0.1, 0.15), 0.5)
STEPS = {
    "rk8": {"integrator": "rk8"},
    "rk4, 3 substeps": {"integrator": "rk4", "substeps": 3},
    "1e-6": {"tolerance": 1e-6},
    "dop853": {"integrator": "dop853"},
}
LATER = "dop853", "rk4, 3 substeps"
"""Of an arm with stops these take long; one without has them."""
ON = pytest.mark.parametrize("steps", STEPS.values(), ids=STEPS)
LATE_AND_SAMPLED = LateCommand(0.007), SampledBrake(0.5, 0.6), e.Lag(0.03)
"""Two instants of an interval, and a state that steps integrate: one scene, compiled once, for all tests."""
BOTH = pytest.mark.parametrize("arm", [FOUR_R, RPRP], ids=["4R", "RPRP with stops"])
ON_ARMS = pytest.mark.parametrize(
    ("arm", "steps"),
    [
        pytest.param(
            arm, steps, id=f"{arm.kind}, {how}", marks=[pytest.mark.long] * (arm is RPRP and how in LATER)
        )
        for arm in (FOUR_R, RPRP) for how, steps in STEPS.items()
    ],
)  # fmt: skip


def bare(arm, **steps):
    effects = (e.Gravity(), STOPS) if arm is RPRP else (e.Gravity(),)
    return rde.Scene(arm, effects, control_dt=LENGTH, **steps)


def with_effects(scene, *effects):
    return dataclasses.replace(scene, effects=(*effects, *scene.effects))


def starts(arm, lanes=24, seed=8):
    rng = np.random.default_rng(seed)
    q, qd = rng.uniform(-1.0, 1.0, (lanes, 4)), 2.0 * rng.normal(size=(lanes, 4))
    q[:, np.array(arm.prismatic)] *= 0.1
    return q, qd, rng.uniform(-4.0, 4.0, (5, lanes, 4))


def simulators(*scenes, lanes=24):
    """Simulators in the same states, and commands of some intervals."""
    q, qd, commands = starts(scenes[0].robot, lanes)
    made = [rde.BatchSimulator(scene, lanes) for scene in scenes]
    for batch in made:
        batch.set_state(q, qd)
    return (*made, commands)


# ---- one instant ---------------------------------------------------------------------------------------


@pytest.mark.quick("0.013-rk8-4R")
@BOTH
@ON
@pytest.mark.parametrize("seconds", [0.013, 1e-9])
def test_an_interval_ends_as_its_pieces_do_one_after_the_other(arm, steps, seconds):
    plain = bare(arm, **steps)
    late, by_hand, commands = simulators(with_effects(plain, LateCommand(seconds)), plain)
    before = np.zeros_like(commands[0])
    for command in commands:
        status = late.advance(command)
        pieces = [by_hand.advance_partly(*x) for x in ((before, seconds), (command, LENGTH - seconds))]
        assert_same_bits((late.q, late.qd), (by_hand.q, by_hand.qd))
        assert_same_bits([status.evaluations], [sum(piece.evaluations for piece in pieces)])
        assert_same_bits(
            [status.numerics, status.events], [0 * status.numerics, pieces[0].events + pieces[1].events]
        )
        before = command


@pytest.mark.quick("0.0-0-rk8-4R")
@BOTH
@ON
@pytest.mark.parametrize(("seconds", "acts"), [(0.0, 0), (-0.001, 1), (LENGTH, 1), (0.3, 1), (math.inf, 1)])
def test_an_instant_at_the_start_or_outside_of_the_interval_costs_nothing_and_changes_no_bit(
    arm, steps, seconds, acts
):
    plain = bare(arm, **steps)
    late, whole, commands = simulators(with_effects(plain, LateCommand(seconds)), plain)
    for before, command in zip((np.zeros_like(commands[0]), *commands), commands, strict=False):
        status, expected = late.advance(command), whole.advance(before if acts else command)
        assert_same_bits((late.q, late.qd, *status), (whole.q, whole.qd, *expected))


def test_one_rk8_step_in_two_pieces_takes_24_evaluations():
    late, commands = simulators(with_effects(bare(FOUR_R), LateCommand(0.007)))
    assert (late.advance(commands[0]).evaluations == 24).all()


def test_an_instant_that_is_no_number_does_not_happen():
    no_number = physics(lambda seconds: seconds - seconds)

    class Never(LateCommand):
        def hooks(self, arm):
            return (e.Instant(no_number, {"seconds": ".seconds"}), *super().hooks(arm)[1:])

    plain = bare(FOUR_R)
    never, whole, commands = simulators(with_effects(plain, Never(math.inf)), plain)
    never.advance(commands[0])
    whole.advance()
    assert_same_bits([never.q], [whole.q])


@pytest.mark.long
def test_lanes_have_instants_of_their_own():
    scene = with_effects(bare(RPRP, tolerance=1e-6), LateCommand(0.0))
    times = np.concatenate([np.linspace(-0.005, 0.025, 22), [0.0, LENGTH]])
    many, commands = simulators(scene)
    many.set_parameters({"late_command.seconds": times})
    alone = [copy.deepcopy(many) for _ in range(3)]
    for command in commands:
        many.advance(command)
    for k, batch in zip((3, 9, 22), alone, strict=True):
        batch.set_parameters({"late_command.seconds": times[k]})
        for command in commands:
            batch.advance(command)
        assert_same_bits([batch.q[k], batch.qd[k]], [many.q[k], many.qd[k]])
    assert len(np.unique(many.q[:, 0])) == len(times)


# ---- states that are updated at an instant -------------------------------------------------------------


@pytest.mark.quick("rk8")
@ON
def test_a_state_is_updated_at_an_instant_from_the_motion_there(steps):
    plain = bare(FOUR_R, **steps)
    braked, free, commands = simulators(with_effects(plain, SampledBrake(0.0, 0.3)), plain)
    free.advance_partly(commands[0], 0.3 * LENGTH)
    braked.advance(commands[0])
    assert_same_bits([braked.z[:, 0]], [(free.qd @ FOUR_R.motor_map)[:, 0]])


def test_what_was_read_acts_from_the_instant_on():
    braked, free, commands = simulators(
        *(with_effects(bare(FOUR_R), SampledBrake(k, 0.5)) for k in (2.0, 0.0))
    )
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


def test_the_control_interval_of_functions_stays_when_a_simulator_advances_by_less():
    braked, commands = simulators(with_effects(bare(FOUR_R), SampledBrake(2.0, 0.5)))
    braked.advance_partly(commands[0], 0.4 * LENGTH)
    assert (braked.z == 0.0).all()
    braked.advance_partly(commands[0], 0.6 * LENGTH)
    assert (braked.z != 0.0).all()


# ---- several instants ----------------------------------------------------------------------------------


def keyed(name, *arguments):
    kind = type(name, (LateCommand,), {"key": name})
    return kind(*arguments)


SEVERAL = {
    "four in order": (0.002, 0.006, 0.011, 0.017),
    "four in another": (0.011, 0.002, 0.017, 0.006),
    "equal ones": (0.006, 0.013, 0.006, 0.013),
    "at the start, beyond the end, and two": (0.0, 0.05, 0.004, -0.5),
    "all at the start": (0.0, 0.0, 0.0, 0.0),
}


@pytest.mark.long
@pytest.mark.parametrize("times", SEVERAL.values(), ids=SEVERAL)
@pytest.mark.parametrize("steps", [STEPS["rk8"], STEPS["1e-6"]], ids=["rk8", "1e-6"])
def test_instants_happen_in_the_order_of_time(times, steps):
    plain = bare(RPRP, **steps)
    delays = tuple(keyed(f"late{k}", time) for k, time in enumerate(times))
    late, by_hand, commands = simulators(with_effects(plain, *delays), plain)
    ends = sorted({t for t in times if 0.0 < t < LENGTH} | {LENGTH})
    waiting = [0.0 * commands[0]] * len(times)
    for command in commands:
        evaluations, start = 0, 0.0
        for end in ends:
            reaching = [command]
            for time, before in zip(times, waiting, strict=True):
                reaching.append(reaching[-1] if 0.0 <= time <= start else before)
            evaluations = evaluations + by_hand.advance_partly(reaching[-1], end - start).evaluations
            start = end
        waiting = reaching[:-1]
        status = late.advance(command)
        assert_same_bits((late.q, late.qd), (by_hand.q, by_hand.qd))
        assert_same_bits([status.evaluations], [evaluations])


# ---- the tolerance and faults --------------------------------------------------------------------------


@pytest.mark.long
def test_pieces_share_the_tolerance():
    """Each piece may have its share of the error, and both together no more than the whole interval."""
    scene = with_effects(bare(RPRP, tolerance=1e-10), LateCommand(0.011))
    late, commands = simulators(scene, lanes=24)
    exact, _ = simulators(with_effects(bare(RPRP, integrator="dop853"), LateCommand(0.011)))
    for command in 5.0 * commands:
        exact.set_state(late.q, late.qd)
        exact.restore({**exact.save()})
        late.set_state(late.q, late.qd)
        status = late.advance(command)
        exact.advance(command)
        assert (status.error_estimate <= 1e-10)[status.numerics == 0].all()
        gap = np.linalg.norm(RPRP.forward_kinematics(late.q) - RPRP.forward_kinematics(exact.q), axis=1)
        assert (gap <= 1e-10)[status.numerics == 0].all()


@pytest.mark.long
def test_a_piece_that_is_given_up_gives_up_its_interval():
    falling = rde.RPRP((1.0,) * 4, (0.5,) * 2)
    scene = rde.Scene(falling, (LateCommand(0.01), e.Gravity(), wall()), tolerance=1e-6)
    batch = rde.BatchSimulator(scene, 2)
    q, qd = np.array([[-1.2, 0.2, -1.3, 0.1]] * 2), np.zeros((2, 4))
    batch.set_state(q, qd)
    pressed = np.array([[0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]])
    for _ in range(100):
        before = batch.q, batch.qd
        status = batch.advance(pressed)
        if (status.numerics & Numerics.EVENT_BUDGET).any():
            break
    lost = (status.numerics & Numerics.EVENT_BUDGET) != 0
    assert lost.any()
    assert_same_bits([batch.q[lost], batch.qd[lost]], [x[lost] for x in before])


def wall():
    @physics
    def height(tip_y, ground):
        return tip_y - ground

    @dataclasses.dataclass(frozen=True)
    class Floor(e.Effect):
        ground: float = -1.3
        restitution: float = 0.2

        def hooks(self, arm):
            return (e.Gap(height, ".restitution", {"ground": ".ground"}),)

    return Floor()


def test_lanes_that_are_not_finite_end_alone():
    late, commands = simulators(with_effects(bare(FOUR_R, tolerance=1e-6), LateCommand(0.007)))
    alone = copy.deepcopy(late)
    bad = commands[0].copy()
    bad[5] = np.nan
    status = late.advance(bad)
    alone.advance(commands[0])
    assert np.flatnonzero(~status.finite).tolist() == [5]
    assert_same_bits([np.delete(late.q, 5, axis=0)], [np.delete(alone.q, 5, axis=0)])


# ---- everywhere alike ----------------------------------------------------------------------------------


@pytest.mark.quick("FourR, rk8")
@ON_ARMS
def test_compiled_code_arrays_tensors_and_single_numbers_agree(arm, steps):
    scene = with_effects(bare(arm, **steps), *LATE_AND_SAMPLED)
    batch, commands = simulators(scene, lanes=4)
    batch.advance(commands[0])
    dynamics = Dynamics(scene)
    names = (*arm.coordinates, *arm.rates, *dynamics.effect_states, *dynamics.commands)
    columns = np.concatenate([batch.q, batch.qd, batch.z, commands[1]], axis=1).T
    batch.advance(commands[1])
    found = (*batch.q.T, *batch.qd.T, *batch.z.T)
    for convert in (np.ascontiguousarray, lambda x: torch.tensor(np.ascontiguousarray(x))):
        fields = fields_of(dynamics) | {n: convert(x) for n, x in zip(names, columns, strict=True)}
        lanes = cross_interval(Interval(dynamics), fields)
        for name, expected in zip(names, found, strict=False):
            np.testing.assert_allclose(lanes[name], expected, rtol=1e-12, atol=1e-12)
    for k in range(4):
        fields = fields_of(dynamics) | {n: float(x[k]) for n, x in zip(names, columns, strict=True)}
        lane = cross_interval(Interval(dynamics), fields)
        for name, expected in zip(names, found, strict=False):
            assert float(lane[name]) == pytest.approx(expected[k], rel=1e-12, abs=1e-12)


def test_lanes_wait_at_the_end_of_an_interval_in_which_no_instant_happens():
    """A piece without a length is divided by, which is an error for numbers that lanes share."""
    dynamics = Dynamics(with_effects(bare(FOUR_R, tolerance=1e-6), LateCommand(1.0), *LATE_AND_SAMPLED[1:]))
    starts = dict(zip(dynamics.states, (0.1, 0.2, 0.3, 0.4, 1.0, 2.0, 3.0, 4.0, 0.0), strict=False))
    one, two = (
        cross_interval(Interval(dynamics), fields_of(dynamics) | start)
        for start in (starts, {name: np.full(2, value) for name, value in starts.items()})
    )
    for name in dynamics.states:
        assert float(one[name]) == pytest.approx(two[name][0], rel=1e-12, abs=1e-12)


@pytest.mark.quick("rk4")
@pytest.mark.parametrize("steps", [STEPS["rk4, 3 substeps"], STEPS["1e-6"]], ids=["rk4", "1e-6"])
def test_differentiable_steps_are_those_of_the_simulator_and_know_the_time_of_an_instant(steps):
    scene = with_effects(bare(FOUR_R, **steps), *LATE_AND_SAMPLED)
    batch, commands = simulators(scene, lanes=6)
    commands = 5.0 * commands
    batch.advance(commands[0])
    before = [torch.tensor(x) for x in (batch.q, batch.qd, commands[1])]
    z, step = torch.tensor(batch.z), rde.torch_step(scene)
    batch.advance(commands[1])
    for found, expected in zip(step(*before, z=z), (batch.q, batch.qd, batch.z), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)

    def moved(seconds):
        return step(*before, {"late_command.seconds": seconds}, z=z)[1].sum()

    seconds = torch.tensor(0.007, dtype=torch.float64, requires_grad=True)
    moved(seconds).backward()
    with torch.no_grad():
        slope = (moved(seconds + 1e-6) - moved(seconds - 1e-6)) / 2e-6
    assert float(seconds.grad) == pytest.approx(float(slope), rel=1e-6)
    assert abs(slope) > 1.0


@pytest.mark.long
@pytest.mark.parametrize("steps", [STEPS["rk8"], STEPS["1e-6"]], ids=["rk8", "1e-6"])
def test_saved_and_copied_simulators_and_threads_continue_to_the_same_bits(steps):
    scene = with_effects(bare(RPRP, **steps), *LATE_AND_SAMPLED)
    batch, commands = simulators(scene)
    batch.advance(commands[0])
    snapshot, twin = batch.save(), copy.deepcopy(batch)
    threads = rde.BatchSimulator(scene, 24, threads=2)
    for other in (batch, twin, threads):
        other.restore(snapshot)
    for command in commands[1:]:
        for other in (batch, twin, threads):
            other.advance(command)
    assert_same_bits((batch.q, batch.qd, batch.z), (twin.q, twin.qd, twin.z))
    assert_same_bits((batch.q, batch.qd, batch.z), (threads.q, threads.qd, threads.z))


# ---- what a trajectory tells ---------------------------------------------------------------------------


def test_efforts_within_an_interval_know_whether_the_instant_has_passed():
    scene = with_effects(bare(FOUR_R), LateCommand(0.007))
    given = np.arange(1.0, 5.0)
    times = np.array([0.0, 0.006, 0.007, 0.015, LENGTH, 0.026, 0.028])
    found = rde.simulate(
        scene, np.zeros(4), np.zeros(4), times, lambda t, q, qd: given * (1.0 + round(t / LENGTH))
    )
    share = [0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 2.0]
    assert_same_bits([found.efforts], [np.outer(share, given)])


@pytest.mark.long
def test_events_at_stops_are_told_at_their_times_in_all_pieces():
    plain = bare(RPRP, tolerance=1e-9)
    q, qd = np.array([0.3, 0.05, -0.4, 0.1]), np.array([0.5, 7.0, 0.2, -9.0])
    whole, late = (
        rde.simulate(scene, q, qd, np.arange(16) * LENGTH).events
        for scene in (plain, with_effects(plain, LateCommand(0.009)))
    )
    assert [(x.kind, x.joint) for x in late] == [(x.kind, x.joint) for x in whole]
    assert len(whole) > 3
    np.testing.assert_allclose([x.time for x in late], [x.time for x in whole], rtol=0.0, atol=1e-7)


# ---- environments --------------------------------------------------------------------------------------


def test_an_environment_counts_the_evaluations_of_all_pieces():
    scene = with_effects(bare(FOUR_R), LateCommand(0.007), e.EffortLimits((4.0, 4.0, 2.0, 2.0)))
    env = gym.make("redundant_envs/FourRReach-v0", scene=scene.to_dict())
    env.reset(seed=0)
    for k in range(1, 4):
        *_, info = env.step(np.ones(4, np.float32))
        assert info["evaluations"] == 24 * k


# ---- refused -------------------------------------------------------------------------------------------


def effect_with(*hooks):
    @dataclasses.dataclass(frozen=True)
    class Own(e.Effect):
        number: float = 1.0

        def hooks(self, arm):
            return hooks

    return Own()


POSITION, RATE = physics(lambda phi1: phi1), physics(lambda phid1: phid1)
NUMBER = physics(lambda number: number)
CHANGES = physics(lambda phi1, passed: -phi1 * passed)
CHANGING_ENERGY = physics(lambda phi1, passed: 0.5 * phi1**2 * passed)
AFTER = e.Instant(NUMBER, {"number": ".number"})


def force_with(state=None, function=POSITION, **more):
    return e.Force(0, function, states=() if state is None else (state,), **more)


def read(when, **kind):
    return e.State("read", "rad", when=when, **(kind or {"update": POSITION}))


REFUSED = {
    "two instants": ((AFTER, AFTER), "has 2 instants; give one"),
    "passed without one": (
        (force_with(function=CHANGES),),
        "takes 'passed', and the effect has no instant; add",
    ),
    "a state without one": ((force_with(read("instant")),), "'read' has when='instant'; give 'interval' or"),
    "an unknown time": ((AFTER, force_with(read("noon"))), "when='noon'; give 'interval' or 'instant'"),
    "an integrated state": (
        (AFTER, force_with(read("instant", derivative=RATE))),
        "when='instant' and no update; give one",
    ),
    "a time that follows the motion": ((e.Instant(POSITION),), "phi1; an instant may depend on parameters"),
    "a time that follows a state": (
        (e.Instant(NUMBER, {"number": ".read"}), force_with(read("interval"))),
        "an instant may depend on parameters and control_dt alone",
    ),
    "a potential that changes at an instant": (
        (AFTER, force_with(function=CHANGES, potential=CHANGING_ENERGY)),
        "passed; it may depend on the position alone",
    ),
}


@pytest.mark.parametrize(("hooks", "words"), REFUSED.values(), ids=REFUSED)
def test_a_wrong_instant_is_refused(hooks, words):
    with pytest.raises(ValueError, match=words):
        rde.Scene(FOUR_R, (effect_with(*hooks),))


def test_a_fifth_instant_is_refused():
    delays = tuple(keyed(f"late{k}", 0.001 * k) for k in range(5))
    assert rde.Scene(FOUR_R, delays[:4])
    with pytest.raises(
        ValueError, match=r"5 instants, of late0, .*late4; a scene may have 4: .*leave some out"
    ):
        rde.Scene(FOUR_R, delays)


@pytest.mark.parametrize(
    "arm", [pytest.param(ARMS[k], marks=pytest.mark.long) for k in ("RRR", "PRPRP")], ids=str
)
def test_any_chain_has_instants(arm):
    plain = rde.Scene(arm, (e.Gravity(),), control_dt=LENGTH)
    count = len(arm.joints)
    late, by_hand = (rde.BatchSimulator(s, 3) for s in (with_effects(plain, LateCommand(0.004)), plain))
    commands = np.random.default_rng(1).normal(size=(2, 3, count))
    late.advance(commands[0])
    by_hand.advance_partly(None, 0.004)
    by_hand.advance_partly(commands[0], LENGTH - 0.004)
    assert_same_bits([late.q], [by_hand.q])


# ---- what one piece leaves to the next --------------------------------------------------------------------


@pytest.mark.quick("FourR, rk8")
@ON_ARMS
def test_lanes_of_one_block_have_their_own_pieces_or_none(arm, steps):
    """Sliders begin at rest at their stops, some pressed onto them and some pulled away."""
    times = np.array([0.0, 0.013, LENGTH, 0.007, 0.3, 1e-9, 0.0199, 0.0])
    made = with_effects(bare(arm, **steps), *LATE_AND_SAMPLED)
    q, qd, commands = starts(arm, len(times), seed=3)
    if arm is RPRP:
        q[:4, [1, 3]], qd[:4] = (0.1, 0.15), 0.0
        q[2, [0, 2]] = (
            np.pi
        )  # gravity pulls the sliders of this lane inwards or outwards, and commands change it
        commands[:, :4, 1::2] *= 20.0
    lanes = [rde.BatchSimulator(made, 1) for _ in times]
    block = rde.BatchSimulator(made, len(times))
    for batch, rows in [(block, slice(None)), *((one, slice(k, k + 1)) for k, one in enumerate(lanes))]:
        batch.set_parameters({"late_command.seconds": times[rows]})
        batch.set_state(q[rows], qd[rows])
    for command in commands:
        status = block.advance(command)
        alone = [one.advance(command[k : k + 1]) for k, one in enumerate(lanes)]
        for found, expected in ((block.q, [x.q for x in lanes]), (block.qd, [x.qd for x in lanes])):
            assert_same_bits([found], [np.concatenate(expected)])
        for found, expected in zip(status, zip(*alone, strict=True), strict=True):
            assert_same_bits([found], [np.concatenate(expected)])


def after_each_piece(scene, q, qd, efforts, names):
    """Fields of one lane after each piece of an interval."""
    interval = Interval(Dynamics(scene))
    states = dict(zip(interval.dynamics.states, (*q, *qd), strict=True))
    states |= interval.dynamics.effect_states.initial
    known = {
        **fields_of(interval.dynamics),
        **states,
        **dict(zip(interval.dynamics.commands, efforts, strict=True)),
    }
    return [{name: float(lane[name]) for name in names} for lane in in_steps(interval, known)][:-1]


@pytest.mark.long
def test_pieces_share_the_tolerance_and_their_errors_add_up():
    tolerance, seconds = 1e-11, 0.004
    made = with_effects(bare(FOUR_R, tolerance=tolerance), LateCommand(seconds))
    q, qd, commands = starts(FOUR_R, 96)
    for one in zip(q, 6.0 * qd, commands[0], strict=True):
        *_, first, second = after_each_piece(made, *one, ("error", "fault"))
        assert first["fault"] == second["fault"] == 0.0
        assert first["error"] <= tolerance * seconds / LENGTH
        assert first["error"] < second["error"] <= tolerance


def test_an_instant_at_the_end_of_the_interval_renews_nothing():
    made = with_effects(bare(FOUR_R), SampledBrake(2.0, share=1.0))
    batch, commands = simulators(made)
    batch.advance(commands[0])
    assert not batch.z.any()
    assert batch.qd.any()


def test_a_larger_fault_of_an_earlier_piece_is_kept():
    interval = Interval(Dynamics(with_effects(bare(FOUR_R, tolerance=1e-6), LateCommand(0.01))))
    lane = Lane(interval.layout(), lambda name: 0.0)
    for fault in (Numerics.EVENT_BUDGET, Numerics.TOLERANCE_NOT_REACHED):
        interval.program.control.note(lane, fault)
    assert lane.fault == Numerics.EVENT_BUDGET
