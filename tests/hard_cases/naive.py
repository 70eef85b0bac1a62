"""Deliberately naive variants, each with one textbook mistake that the hard cases must find."""

import dataclasses
import math

import numpy as np

from redundant_envs.effects import CoulombFriction, Lag, SmoothCoulombFriction
from redundant_envs.effects.hooks import Force, Impact, at_each_joint
from redundant_envs.language.algebra import maximum, minimum, physics, where
from redundant_envs.model.batch import Event
from redundant_envs.model.energy import at_joints, scene_quantities
from tests.oracles.printed import misprints

from .hard_case import Motion, Subject

# ---- accelerations --------------------------------------------------------------------------------------


def solved(matrix, vector):
    """x of A x = b for a batch; NaN where A is singular."""
    try:
        return np.linalg.solve(matrix, vector[..., None])[..., 0]
    except np.linalg.LinAlgError:
        return np.full_like(vector, np.nan)


class DenseSolve(Subject):
    """Forms M and solves it by Gaussian elimination: loses as many digits as M is badly conditioned."""

    name = "dense solve"
    added = 0.0

    def accelerations(self, arm, q, qd, Q, g=0.0):
        mass = arm.mass_matrix(q) + self.added * np.eye(4)
        return solved(mass, Q - arm.bias_forces(q, qd) - arm.gravity_forces(q, g))


class RegularisedMass(DenseSolve):
    """Adds a little to the diagonal of M, so that it is "never singular": another arm moves."""

    name = "regularised mass matrix"
    added = 1e-8


class InvertedJacobian(Subject):
    """Moves in Cartesian space: accelerations of two points of the arm, and from them by the inverse of
    their Jacobian those of the joints; J J^T for poses. Dies where the arm is stretched or folded."""

    name = "inverted Jacobian"

    def accelerations(self, arm, q, qd, Q, g=0.0):
        tip = arm.jacobian(np.asarray(q, float))
        # Of the second and the fourth mass point, (..., 4, 4): two links carry the second.
        J = np.concatenate([np.where(np.arange(4) < 2, tip, 0.0), tip], axis=-2)
        forces = Q - arm.bias_forces(q, qd) - arm.gravity_forces(q, g)
        return solved(J, np.einsum("...ij,...j->...i", J, solved(arm.mass_matrix(q), forces)))

    def pose_at(self, scene, start, goal):
        q = np.array(start, float)
        for _ in range(60):
            J = scene.robot.jacobian(q)
            q = q + J.T @ solved(J @ J.T, goal - scene.robot.forward_kinematics(q))
        return q


# ---- what is kept ---------------------------------------------------------------------------------------


class WrappedAngles(Subject):
    """Wraps every angle into -pi to pi: where one link is wrapped and the next is not, the joint between
    them has turned once around."""

    name = "wrapped angles"

    def keep(self, batch):
        wrapped, sliders = np.mod(batch.q + np.pi, 2.0 * np.pi) - np.pi, batch.scene.robot.sliders()
        wrapped[..., sliders] = batch.q[..., sliders]
        batch.set_state(wrapped, batch.qd)


class SinglePrecision(Subject):
    """Keeps states in float32."""

    name = "single precision"

    def keep(self, batch):
        batch.set_state(*(np.float64(np.float32(x)) for x in (batch.q, batch.qd)))


# ---- steps ----------------------------------------------------------------------------------------------


class EqualSteps(Subject):
    """Equal steps of RK4, without any check of their error."""

    longest = 1e-3
    """Of a step, s."""
    stages = 4

    def motion(self, run):
        scene, (q, qd) = run.scene, run.start()
        count = math.ceil(scene.control_dt / (run.longest or self.longest) * (1.0 - 1e-12))
        h = scene.control_dt / count
        motion = Motion.begun(q, qd, run.intervals)
        motion.evaluations[:] = self.stages * count
        lag = next((x.time_constant[0] for x in scene.effects if isinstance(x, Lag)), 0.0)
        effort = np.zeros(q.shape)
        for k in range(run.intervals):
            for i in range(count):
                effort = effort + (run.command(k) - effort) * (-math.expm1(-h / lag) if lag else 1.0)

                def acceleration(q, qd, effort=effort):
                    return self.scene_accelerations(scene, q, qd, effort)

                q, qd = self.step(acceleration, q, qd, h)
                self.at_stops(scene, q, qd, k * scene.control_dt + (i + 1) * h, motion)
            motion.q[k + 1], motion.qd[k + 1] = q, qd
        return motion

    def scene_accelerations(self, scene, q, qd, efforts):
        """With gravity and the forces of effects; of actuators and stops nothing is known here."""
        arm, x = scene.robot, scene_quantities(scene, q, qd)
        t = sum((at_joints(scene, a, "function", x) for a in scene.attached.of(Force)), efforts)
        Q = t if scene.actuation == "generalized" else t @ arm.motor_map.T
        return self.accelerations(arm, q, qd, Q, x["ay"])

    def step(self, acceleration, q, qd, h):
        a1 = acceleration(q, qd)
        v2 = qd + 0.5 * h * a1
        a2 = acceleration(q + 0.5 * h * qd, v2)
        v3 = qd + 0.5 * h * a2
        a3 = acceleration(q + 0.5 * h * v2, v3)
        v4 = qd + h * a3
        a4 = acceleration(q + h * v3, v4)
        return q + h / 6.0 * (qd + 2.0 * v2 + 2.0 * v3 + v4), qd + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)

    def at_stops(self, scene, q, qd, time, motion):
        """Modify the end of a step; here there are no stops."""


class ExplicitEuler(EqualSteps):
    """Position and velocity by the slopes at the start of a step: energy grows without bound."""

    name = "explicit Euler"
    longest = 5e-3
    stages = 1

    def step(self, acceleration, q, qd, h):
        return q + h * qd, qd + h * acceleration(q, qd)


class FixedSteps(EqualSteps):
    """RK4 with 10 ms, because that was always enough: nothing checks whether it still is."""

    name = "fixed steps of 10 ms"
    longest = 1e-2


class EstimateWithoutFloor(EqualSteps):
    """Takes twice the steps until two results agree, and trusts them from the first step on: what neither
    has touched, no estimate sees."""

    name = "estimate without a floor"
    longest = 1e3

    def step(self, acceleration, q, qd, h):
        coarse = super().step(acceleration, q, qd, h)
        for doublings in range(1, 11):
            fine, count = (q, qd), 2**doublings
            for _ in range(count):
                fine = super().step(acceleration, *fine, h / count)
            if np.abs(fine[0] - coarse[0]).max() <= 1e-6:
                break
            coarse = fine
        return fine


class PrintedReport(EqualSteps):
    """The report's five wrong terms, as printed."""

    name = "the report as printed"
    longest = 2e-3

    def accelerations(self, arm, q, qd, Q, g=0.0):
        right = {"M": arm.mass_matrix(q), "h": arm.bias_forces(q, qd)}
        for name, entry, misprint in misprints(arm.kind, arm.masses, arm.lengths, q.T, qd.T):
            right[name][..., *entry] += misprint
        return solved(right["M"], Q - right["h"] - arm.gravity_forces(q, g))


# ---- stops ----------------------------------------------------------------------------------------------


def stops_of(scene):
    """Of each slider its coordinate, its ends, which may be infinite, and the restitution."""
    values, stops = scene.parameters(), scene.attached.of(Impact)
    names = ((x, x.hook.lower, x.hook.upper, x.hook.restitution) for x in stops)
    return [(x.hook.joint, *(values[x.parameter(name)] for name in own)) for x, *own in names]


class ImpulseAtStepEnd(EqualSteps):
    """The right impulse at the wrong time: at the end of the step in which a slider is found outside."""

    name = "impulse at the end of a step"

    def at_stops(self, scene, q, qd, time, motion):
        for stop in stops_of(scene):
            k, lower, upper, _ = stop
            outside = (q[:, k] > upper) & (qd[:, k] > 0.0) | (q[:, k] < lower) & (qd[:, k] < 0.0)
            for i in np.flatnonzero(outside):
                kind, joint = "upper impact" if qd[i, k] > 0.0 else "lower impact", scene.robot.joints[k]
                motion.events.append(Event(time, kind, joint, abs(qd[i, k]), int(i)))
            self.strike(scene.robot, q, qd, stop, outside)

    def strike(self, arm, q, qd, stop, outside):
        """Modify the given states: the impulse moves the whole arm."""
        k, *_, restitution = stop
        along = np.linalg.inv(arm.mass_matrix(q[outside]))[..., k]
        qd[outside] -= (1.0 + restitution) * qd[outside][:, [k]] / along[:, [k]] * along


class FlippedVelocity(ImpulseAtStepEnd):
    """At a stop the slider's own velocity changes its sign; nothing else is affected."""

    name = "flipped velocity"

    def strike(self, arm, q, qd, stop, outside):
        k, lower, upper, restitution = stop
        q[:, k] = np.clip(q[:, k], lower, upper)
        qd[outside, k] *= -restitution


# ---- friction -------------------------------------------------------------------------------------------


class OtherFriction(Subject):
    """Has another friction in place of a scene's."""

    def motion(self, run):
        (dry,) = run.scene.effects
        scene = dataclasses.replace(run.scene, effects=(self.other(dry.level),))
        return super().motion(dataclasses.replace(run, scene=scene))


class SmoothedFriction(OtherFriction):
    """Makes the jump of dry friction at rest smooth, v / sqrt(v^2 + e^2): a loaded joint creeps."""

    name = "smoothed friction"

    def other(self, level):
        return SmoothCoulombFriction(level, 0.05)  # rad/s: its own steps would be unstable at less


def bound(k):
    return {"rate": f"phid{k + 1}", "level": f".level[{k}]"}


against_rate = physics(lambda rate, level: where(rate > 0.0, -level, where(rate < 0.0, level, 0.0)))


@physics
def against_load(rate, effort, level):
    holding = minimum(maximum(-effort, -level), level)
    return where(abs(rate) < 0.01, holding, where(rate > 0.0, -level, level))


@dataclasses.dataclass(frozen=True)
class SignOfRate(CoulombFriction):
    """Opposes the sign of the rate, and does nothing at rest."""

    hooks = at_each_joint(lambda self, k, _: Force(k, against_rate, bound(k)))


@dataclasses.dataclass(frozen=True)
class DeadBand(CoulombFriction):
    """Opposes the rate outside a band of 0.01 rad/s, and balances the effort of the motor in it."""

    hooks = at_each_joint(lambda self, k, _: Force(k, against_load, bound(k) | {"effort": f"command{k + 1}"}))


class ChatteringFriction(OtherFriction):
    """Takes the sign of the rate at each evaluation: a loaded joint trembles, and moves on."""

    name = "sign of the rate"
    other = SignOfRate


class KarnoppFriction(OtherFriction):
    """Takes small rates for none (Karnopp 1985): a joint that should have come to rest drifts on."""

    name = "dead band of rates"
    other = DeadBand
