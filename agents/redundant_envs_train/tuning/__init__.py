"""Tuning: a search over the settings of a learner, each trial a separate training."""
