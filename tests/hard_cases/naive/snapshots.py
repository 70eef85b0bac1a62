"""A mistake in saving a simulation."""

from subject import Subject


class SavedPositions(Subject):
    """Saves positions and velocities: who rests at a stop, and what still waits in a delay, is forgotten."""

    name = "snapshot of q and qd"

    def save(self, batch):
        return batch.q, batch.qd

    def restore(self, batch, snapshot):
        batch.set_state(*snapshot)
