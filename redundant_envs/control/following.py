"""Computed torque along references of all lanes, where a slider that rests at a stop leans on it; and joint
velocities, whose controller counts such a slider as free."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.nominal import NominalModel
from redundant_envs.control.time_law import Motion

Array = NDArray[np.float64]
AT_STOP = 1e-3  # m from a stop within which a slider at rest leans on it


class Following:
    """Computed torque along references, of the kind of :class:`~redundant_envs.control.ComputedTorque`.

    Parameters
    ----------
    model : NominalModel
    frequency : float
        Of the critically damped error dynamics, rad/s.
    """

    def __init__(self, model: NominalModel, frequency: float = 14.0) -> None:
        self.model, self.frequency, self.dt = model, frequency, model.scene.control_dt
        self.motion: Motion | None = None
        self.decide(1)

    def decide(self, steps: float) -> None:
        """Say for how many control steps an action holds; one, unless this is called."""
        self.span = steps * self.dt

    def begin(self, motion: Motion, index: NDArray[np.intp] | None = None) -> None:
        """Take references, of all lanes or of those in ``index``; the last pose is held at their end. Those
        of one controller have equal numbers of steps."""
        if index is None or self.motion is None:
            self.motion = Motion(*(x.copy() for x in motion))
            return
        for mine, new in zip(self.motion, motion, strict=True):
            mine[index] = new

    def reference(self, t: Array | float) -> tuple[Array, Array, Array]:
        """phi, its rates and accelerations, (n, joints) each, at the times t (n,) since each one began."""
        assert self.motion is not None
        count, steps, _ = self.motion.phi.shape
        k = np.broadcast_to(np.rint(np.divide(t, self.dt)).astype(np.intp), count)
        lane, at = np.arange(count), np.minimum(k, steps - 1)
        phi, phid, phidd = (x[lane, at] for x in self.motion)
        return phi, phid, phidd

    def accelerations(self, t: Array | float, phi: Array, phid: Array) -> Array:
        """Accelerations (n, joints) of the reference with proportional-derivative feedback."""
        place, rate, wanted = self.reference(t)
        w = self.frequency
        return wanted + 2.0 * w * (rate - phid) + w * w * (place - phi)

    def action(self, t: Array | float, q: Array, qd: Array) -> NDArray[np.float32]:
        """Actions (n, joints) in [-1, 1] at times ``t`` [s] since each reference began."""
        model = self.model
        phi, phid = q @ model.b, qd @ model.b
        efforts = model.efforts(phi, phid, self.accelerations(t, phi, phid))
        efforts = leaning(model, efforts, phi, resting=(self.reference(t)[2] == 0.0).all(axis=1))
        return normalized(model, efforts)


class VelocityFollowing(Following):
    """Joint velocities that bring the arm to where references are when an action ends."""

    def action(self, t: Array | float, q: Array, qd: Array) -> NDArray[np.float32]:
        """Actions (n, joints) in [-1, 1] at times ``t`` [s] since each reference began."""
        ahead = horizon(self.model, self.span)
        return towards(self.model, self.reference(np.add(t, ahead))[0], q @ self.model.b, ahead)


def horizon(model: NominalModel, span: float) -> float:
    """Time [s] in which joint velocities that hold for ``span`` bring the arm to where it should be then: the
    controller below them follows in 1 / gain, and with less they overshoot."""
    return span + 1.0 / model.gain


def towards(model: NominalModel, place: Array, phi: Array, seconds: float) -> NDArray[np.float32]:
    """Joint velocities from poses phi to others in some seconds, as actions in [-1, 1]."""
    assert model.speeds is not None
    rates = (place - phi) / (seconds * model.speeds)
    actions: NDArray[np.float32] = np.clip(rates, -1.0, 1.0).astype(np.float32)
    return actions


def leaning(model: NominalModel, efforts: Array, phi: Array, resting: NDArray[np.bool_]) -> Array:
    """Efforts without the part that a stop takes over: a lower stop pushes outwards, an upper one inwards."""
    if not model.slides.any():
        return efforts
    low, high = model.travel
    efforts = np.where(resting[:, None] & (phi < low + AT_STOP), np.minimum(efforts, 0.0), efforts)
    return np.where(resting[:, None] & (phi > high - AT_STOP), np.maximum(efforts, 0.0), efforts)


def normalized(model: NominalModel, efforts: Array) -> NDArray[np.float32]:
    """Efforts as actions in [-1, 1]: those beyond a limit saturate, as the motors do."""
    actions: NDArray[np.float32] = np.clip(efforts / model.limits, -1.0, 1.0).astype(np.float32)
    return actions
