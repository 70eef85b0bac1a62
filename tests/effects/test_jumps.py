"""Velocities jump by impulses and where masses come and go: momentum, energy, stops, and what is undone."""

import dataclasses
from dataclasses import dataclass

import numpy as np
import pytest
from catalogue import FOUR_R, RPRP, advanced
from one_joint import WITH

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.language.algebra import physics

ARMS = pytest.mark.parametrize("arm", [FOUR_R, RPRP], ids=["4R", "RPRP"])
Q, QD = np.array((0.3, 0.2, -0.4, 0.1)), np.array((1.0, -0.4, 0.5, 0.3))

once = physics(lambda ready: 0.0 * ready)
blow = physics(lambda ready, x, y: (ready * x, ready * y))
knock = physics(lambda ready, y: ready * y)
dialled = physics(lambda delay: delay)


@dataclass(frozen=True)
class Blow(e.Effect):
    """An impulse at the start of an interval: (x, y) at a point [N s], or y on a joint [N m s]."""

    place: int | e.Point
    x: float
    y: float
    later: bool = False  # in the second interval, not in the first

    static = ("place", "later")

    def hooks(self, arm):
        update, initial = (physics(lambda ready: 1.0 - ready), 0.0) if self.later else (once, 1.0)
        state = e.State("ready", "1", update=update, bind={"ready": ".ready"}, initial=initial)
        bind = {"ready": ".ready", "x": ".x", "y": ".y"}
        if isinstance(self.place, e.Point):
            return (e.Impulse(self.place, blow, bind, (state,)),)
        return (e.Impulse(self.place, knock, {n: bind[n] for n in ("ready", "y")}, (state,)),)


class BlowInside(Blow):
    """The same a while after the start of each interval, per lane."""

    key = "blow"

    def hooks(self, arm):
        (hook,) = super().hooks(arm)
        return dataclasses.replace(hook, when="instant"), e.Instant(dialled, {"delay": ".x"})


# ---- impulses ------------------------------------------------------------------------------------------


@pytest.mark.quick("4R-Point(number=1)-rk4")
@WITH
@pytest.mark.parametrize("place", [e.Point(1), 2], ids=str)
@ARMS
def test_an_impulse_changes_momentum_by_itself_and_its_work_is_booked(arm, place, how):
    """A motion that an impulse begins is that of a start with the velocities after it."""
    scene = rde.Scene(arm, (e.Gravity(), Blow(place, 0.5, -0.3)), **how)
    if isinstance(place, e.Point):
        k = place.number + 1
        known = arm.parameter_values() | dict(zip(arm.coordinates, Q, strict=True))
        slopes = arm.evaluate([f"{a}{k}{j}" for a in "XY" for j in range(1, 5)], known)
        push = np.array([np.broadcast_to(s, ()) for s in slopes]).reshape(2, 4).T @ (0.5, -0.3)
    else:
        push = arm.motor_map[:, place] * -0.3
    after = QD + np.linalg.solve(arm.mass_matrix(Q), push)
    times, plain = [0.0, 0.02, 0.03, 0.1], dataclasses.replace(scene, effects=(e.Gravity(),))
    found, expected = rde.simulate(scene, Q, QD, times), rde.simulate(plain, Q, after, times)
    np.testing.assert_allclose(found.q[1:], expected.q[1:], atol=1e-13)
    np.testing.assert_allclose(found.qd[1:], expected.qd[1:], atol=1e-12)
    work = expected.kinetic_energy[0] - found.kinetic_energy[0]
    np.testing.assert_allclose(found.work, [0.0, work, work, work], atol=1e-13)
    assert abs(work) > 0.01


@pytest.mark.quick("4R-rk4")
@WITH
@ARMS
def test_an_impulse_at_an_instant_divides_the_motion_there(arm, how):
    """Lanes have it at different times, one at the start, one never; by hand an interval is cut there."""
    plain, times = rde.Scene(arm, (e.Gravity(),), **how), [0.0, 0.004, 0.013, 0.5]
    scene = dataclasses.replace(plain, effects=(*plain.effects, BlowInside(1, 0.0, -0.3)))
    found, _ = advanced(scene, [Q] * 4, QD, None, {"blow.x": times}, track_work=True)
    for k, time in enumerate(times):
        hand, _ = advanced(plain, Q, QD, intervals=0, track_work=True)
        if 0.0 < time < 0.02:
            hand.advance_partly(None, time)
        work = hand.work[0]
        if time < 0.02:
            jump = np.linalg.solve(arm.mass_matrix(hand.q[0]), arm.motor_map[:, 1] * -0.3)
            work -= 0.3 * arm.motor_map[:, 1] @ (hand.qd[0] + 0.5 * jump)
            hand.set_state(hand.q, hand.qd + jump)
        hand.advance_partly(None, 0.02 - time) if 0.0 < time < 0.02 else hand.advance()
        np.testing.assert_allclose(found.q[k], hand.q[0], atol=1e-12)
        np.testing.assert_allclose(found.qd[k], hand.qd[0], atol=1e-11)
        assert found.work[k] == pytest.approx(work + hand.work[0] * (time < 0.02), abs=1e-12)


@pytest.mark.quick("0.0-rk4")
@WITH
@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_a_slider_at_rest_is_sent_away_from_its_stop_or_strikes_it(how, restitution):
    """Gravity presses 2 kg onto the lower stop, where they have come to rest in the interval before."""
    stop, blow = e.PrismaticStop((0.0,), (1.0,), restitution), Blow(0, 0.0, 0.0, later=True)
    effects = e.Gravity(2.0, (-1.0, 0.0)), stop, blow
    scene = rde.Scene(rde.Chain("P", (2.0,)), effects, control_dt=0.1, **how)
    change = {"blow.y": [0.0, 0.6, -0.6]}
    found, status = advanced(scene, np.zeros((3, 1)), np.zeros((3, 1)), None, change, intervals=2)
    assert not status.numerics.any()
    assert found.q[0, 0] == found.qd[0, 0] == 0.0
    expected = [0.3 * 0.1 - 0.5 * 2.0 * 0.01, max(restitution * 0.3 * 0.1 - 0.01, 0.0)]
    np.testing.assert_allclose(found.q[1:, 0], expected, atol=1e-13)


# ---- masses that come and go ---------------------------------------------------------------------------


@pytest.mark.quick("4R-rk4")
@WITH
@ARMS
def test_momentum_is_kept_where_the_tip_picks_up_a_mass(arm, how):
    """M qd stays, with another M; the loss, and the potential energy of the object, are booked."""
    masses = np.array([0.0, 0.01, 0.7, 50.0])
    plain = rde.Scene(arm, (e.Gravity(),), **how)
    loaded = dataclasses.replace(plain, effects=(*plain.effects, e.PickUp(1.0, 0.05)))
    rng = np.random.default_rng(3)
    q, qd, efforts = Q + rng.normal(size=(4, 4)) * 0.1, rng.normal(size=(4, 4)), rng.normal(size=(4, 4))
    found, _ = advanced(loaded, q, qd, efforts, {"pick_up.mass": masses}, intervals=3, track_work=True)
    bare, _ = advanced(plain, q, qd, efforts, intervals=3, track_work=True)
    np.testing.assert_allclose(found.q, bare.q, atol=1e-14)
    np.testing.assert_array_equal(found.z[:, 0], masses)
    for here, mass, before, after, work in zip(
        found.q, masses, bare.qd, found.qd, found.work - bare.work, strict=True
    ):
        heavy = dataclasses.replace(arm, masses=(*arm.masses[:-1], arm.masses[-1] + mass))
        both = (arm, before), (heavy, after)
        momenta = [x.mass_matrix(here) @ v for x, v in both]
        assert np.abs(momenta[0] - momenta[1]).max() <= 1e-13 * np.abs(momenta[0]).max()
        energies = [x.kinetic_energy(here, v) + x.potential_energy(here) for x, v in both]
        assert work == pytest.approx(energies[1] - energies[0], abs=1e-13)
    assert np.abs(found.qd[3] - bare.qd[3]).max() > 0.1


@dataclass(frozen=True)
class Heavier(e.Effect):
    """A field in proportion to the mass that it moves."""

    k: float

    def hooks(self, arm):
        return (e.Field(physics(lambda m1, k: (-k * m1, 0.0))),)


def test_a_field_knows_the_mass_that_a_grasp_changes():
    """2 kg from rest at 6 m/s^2, then 3 kg with the same momentum at 9 m/s^2, for 0.1 s each."""
    effects = Heavier(3.0), e.PickUp(1.0, 0.1)
    scene = rde.Scene(rde.Chain("P", (2.0,), ()), effects, "rk4", control_dt=0.1)
    speeds = rde.simulate(scene, [0.0], [0.0], [0.1, 0.2]).qd[:, 0]
    np.testing.assert_allclose(speeds, [0.4, 1.3], rtol=1e-14)


def test_the_grasp_is_at_the_first_instant_not_before_its_time():
    times = {0.06: 3, 0.0600001: 4, 0.05: 3, 0.02: 1, 0.3: 15, 0.011: 1}
    scene = rde.Scene(FOUR_R, (e.PickUp(1.0, 1.0),), "rk4")
    batch = rde.BatchSimulator(scene, len(times))
    batch.set_parameters({"pick_up.at": [*times]})
    taken = []
    for _ in range(16):
        batch.advance()
        taken.append(batch.z[:, 0] > 0.0)
    assert (np.argmax(taken, axis=0) + 1).tolist() == [*times.values()]


def test_a_slider_at_rest_at_its_stop_may_leave_it_where_the_arm_grasps():
    """Two sliders along one line: the object slows the second, and the first one, at its stop, is free."""
    effects = e.PrismaticStop((0.0, None), (None, None), 0.0), e.PickUp(3.0, 0.01)
    scene = rde.Scene(rde.Chain("PP", (2.0, 1.0)), effects, control_dt=0.01, tolerance=1e-9)
    batch, _ = advanced(scene, [[0.0, 0.5]], [[0.0, 0.6]])
    momenta = np.array([[3.0 + 3.0, 1.0 + 3.0], [1.0 + 3.0, 1.0 + 3.0]]) @ batch.qd[0]
    np.testing.assert_allclose(momenta, [0.6, 0.6], rtol=1e-13)  # all of it is the second mass's
