"""Tuning: Optuna searches the settings of a learner, judged by the learning curves of whole trainings."""

from .study import tune

__all__ = ["tune"]
