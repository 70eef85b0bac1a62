"""Gymnasium and stable-baselines3 faces of the reach task."""
