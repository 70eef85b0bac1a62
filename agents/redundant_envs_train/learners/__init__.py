"""Learners: stable-baselines3's algorithms with leaner loops and averaged policies."""
