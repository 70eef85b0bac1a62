"""Trained policies as files that need neither torch nor this package."""
