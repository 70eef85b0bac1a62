"""Passes over a graph, each with a name of its own."""
