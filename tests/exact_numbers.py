"""The physics dialect on mpmath's numbers: importing this module registers them."""

import operator

import mpmath

from redundant_envs.language.algebra import Primitives, register_numbers

register_numbers(
    Primitives(
        mpmath.sqrt, mpmath.exp, mpmath.log, mpmath.floor, lambda x: mpmath.cos_sin(x)[::-1],
        lambda condition, a, b: a if condition else b, operator.not_,
    ),
    mpmath.mpf,
)  # fmt: skip


def exactly(values):
    """Numbers by name, with as many digits as mpmath has now."""
    return {name: mpmath.mpf(value) for name, value in values.items()}
