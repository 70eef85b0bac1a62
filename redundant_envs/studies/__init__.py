"""Measurements of the library: speed, energy, and the figures they give."""
