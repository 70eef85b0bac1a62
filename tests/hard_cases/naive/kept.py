"""Mistakes in what is kept: wrapped angles, single precision, a summed clock, a snapshot of q and qd."""

import numpy as np
from subject import Subject


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


class SummedClock(Subject):
    """Adds dt to the time at every step: rounding adds up, too."""

    name = "clock by addition"

    def instants(self, count, dt):
        times, t = np.empty(count), 0.0
        for k in range(count):
            times[k] = t
            t += dt
        return times


class SavedPositions(Subject):
    """Saves only positions and velocities: sliders at rest, and commands in a delay, are forgotten."""

    name = "snapshot of q and qd"

    def save(self, batch):
        return batch.q, batch.qd

    def restore(self, batch, snapshot):
        batch.set_state(*snapshot)
