"""A mistake in saving a simulation."""

from subject import Subject


class SavedPositions(Subject):
    """Saves only positions and velocities: sliders at rest, and commands in a delay, are forgotten."""

    name = "snapshot of q and qd"

    def save(self, batch):
        return batch.q, batch.qd

    def restore(self, batch, snapshot):
        batch.set_state(*snapshot)
