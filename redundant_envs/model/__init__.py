"""The public faces of simulation: batches, trajectories, programs."""
