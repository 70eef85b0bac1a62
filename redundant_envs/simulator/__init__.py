"""The motion of lanes: steps, events, what a lane does in an interval, and batches of lanes."""
