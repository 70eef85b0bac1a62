"""Events of a lane: where they are in time, and what becomes of contacts."""
