"""Mutants of the equations, the numerics, the events and the lanes: does a test see each?"""
