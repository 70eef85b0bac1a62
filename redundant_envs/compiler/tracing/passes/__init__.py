"""Named passes over a graph."""
