"""Effects from outside that have states: lags, and commands that are held."""

import copy
import dataclasses
import pickle

import numpy as np
from actuator_lag import ActuatorLag
from arms import ARMS
from held_command import HeldCommand

import redundant_envs as rde

e = rde.effects


def test_a_lag_follows_its_equation():
    """Constant commands: the effort is command (1 - exp(-t / T)), and its work closes the energy balance."""
    scene = rde.Scene(ARMS["4R"], (e.Gravity(), ActuatorLag(0.05)), tolerance=1e-9)
    batch = rde.BatchSimulator(scene, 3, track_work=True)
    command = np.array([5.0, -3.0, 2.0, 1.0])
    before = energy_of(scene, batch)
    for _ in range(10):
        batch.advance(np.tile(command, (3, 1)))
    assert np.abs(batch.z - command * (1.0 - np.exp(-0.2 / 0.05))).max() < 1e-9
    assert np.abs(energy_of(scene, batch) - batch.work - before).max() < 1e-8


def energy_of(scene, batch):
    arm = scene.robot
    return arm.kinetic_energy(batch.q, batch.qd) + arm.potential_energy(batch.q)


def test_a_short_lag_makes_error_control_take_more_steps():
    counts = []
    for constant in (1.0, 1e-4):
        batch = rde.BatchSimulator(rde.Scene(ARMS["4R"], (ActuatorLag(constant),), tolerance=1e-6), 8)
        status = batch.advance(np.ones((8, 4)))
        assert not status.numerics.any()
        counts.append(status.evaluations.max())
    assert counts[1] > 20 * counts[0]
    assert np.abs(batch.z - 1.0).max() < 1e-9


def test_commands_of_the_interval_before_act_to_the_bit():
    free = rde.Scene(ARMS["RPRP"], (e.Gravity(),), tolerance=1e-6)
    late = dataclasses.replace(free, effects=(*free.effects, HeldCommand()))
    commands = np.random.default_rng(0).normal(size=(6, 5, 4))
    a, b = rde.BatchSimulator(free, 5), rde.BatchSimulator(late, 5)
    for k in range(6):
        a.advance(commands[k - 1] if k else None)
        b.advance(commands[k])
        assert np.array_equal(a.q, b.q)
        assert np.array_equal(b.z, commands[k])


def test_links_act_in_their_stated_order_whatever_the_order_of_effects():
    chain = (HeldCommand(), ActuatorLag(0.03), e.EffortLimits(1.5))
    results = []
    for effects in (chain, chain[::-1]):
        batch = rde.BatchSimulator(rde.Scene(ARMS["3R"], effects, integrator="rk4", substeps=4), 4)
        for _ in range(5):
            batch.advance(np.full((4, 3), 4.0))
        results.append(batch)
    lagged = results[0].z[0, 3:]
    assert (
        np.abs(lagged - 4.0 * (1.0 - np.exp(-0.08 / 0.03))).max() < 1e-4
    )  # the first interval has no command
    assert lagged.min() > 1.5  # what acts is less: limits come last
    assert np.array_equal(results[0].q, results[1].q)
    free = rde.BatchSimulator(rde.Scene(ARMS["3R"], chain[:2], integrator="rk4", substeps=4), 4)
    for _ in range(5):
        free.advance(np.full((4, 3), 4.0))
    assert np.abs(free.qd - results[0].qd).max() > 0.1


def test_states_of_effects_are_saved_restored_copied_and_begin_anew():
    scene = rde.Scene(ARMS["RRP"], (ActuatorLag(0.1), HeldCommand()), tolerance=1e-6)
    batch = rde.BatchSimulator(scene, 9)
    efforts = np.random.default_rng(1).normal(size=(9, 3))
    batch.advance(efforts)
    batch.advance(efforts)
    saved, twin = batch.save(), pickle.loads(pickle.dumps(copy.deepcopy(batch)))
    batch.advance(efforts)
    twin.advance(efforts)
    assert np.array_equal(batch.z, twin.z)
    after = batch.z
    batch.restore(saved)
    batch.advance(efforts)
    assert np.array_equal(batch.z, after)
    batch.set_state(np.zeros((1, 3)), np.zeros((1, 3)), index=[4])
    assert not batch.z[4].any()
    assert np.array_equal(np.delete(batch.z, 4, 0), np.delete(after, 4, 0))
    alone = rde.BatchSimulator(scene, 1)
    for _ in range(3):
        alone.advance(efforts[6])
    assert np.array_equal(alone.z[0], after[6])


def test_lanes_have_time_constants_of_their_own():
    batch = rde.BatchSimulator(rde.Scene(ARMS["3R"], (ActuatorLag(0.1),), tolerance=1e-8), 3)
    constants = np.array([0.06, 0.1, 1.0])
    batch.set_parameters({"actuator_lag.time_constant": constants})
    batch.advance(np.ones((3, 3)))
    assert np.abs(batch.z - (1.0 - np.exp(-0.02 / constants))[:, None]).max() < 1e-9
