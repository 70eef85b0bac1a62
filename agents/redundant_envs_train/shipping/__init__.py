"""Trained policies and episodes as files that need neither torch nor this package."""
