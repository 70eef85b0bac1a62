"""Scenes: an arm and its effects, their numbers, ranges of these, and files."""
