"""Gymnasium and stable-baselines3 environments of all tasks."""
