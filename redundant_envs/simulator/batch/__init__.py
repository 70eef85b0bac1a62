"""Batches of lanes in compiled kernels."""
