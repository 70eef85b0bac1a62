"""Model-based controllers, the baseline of every table."""
