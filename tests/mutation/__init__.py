"""Mutants of the equations, the integrators and the simulator: does a test see each?"""
