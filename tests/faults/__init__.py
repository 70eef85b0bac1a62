"""Faults that were mended: brought back one at a time, each must turn the test red that was made for it."""
