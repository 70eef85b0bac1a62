"""From Python to machine code: tracing, passes, and back ends."""
