"""Studies that need learners, or that stand beside them."""
