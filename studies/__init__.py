"""Measurements of the library: speed, energy, and their figures."""
