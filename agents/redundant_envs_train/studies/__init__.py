"""Studies that need learners, or that are compared with them."""
