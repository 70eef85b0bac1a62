"""The exponential function of arrays is our own: exact to one ulp, the same everywhere."""

import hashlib

import mpmath
import numpy as np
import pytest

from redundant_envs import algebra
from redundant_envs.backends.numpy import exp


def test_it_is_exact_to_one_unit_in_the_last_place():
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.uniform(-708.0, 709.0, 3000), rng.uniform(-1.0, 1.0, 3000)])
    exact = np.array([float(mpmath.exp(mpmath.mpf(float(v)))) for v in x])
    assert (np.abs(exp(x) - exact) <= np.spacing(exact)).all()


def test_its_bits_are_those_of_every_machine():
    x = np.linspace(-740.0, 700.0, 100_001)
    assert hashlib.sha256(exp(x).astype("<f8").tobytes()).hexdigest()[:16] == "f978317a98362c2a"


@pytest.mark.filterwarnings("ignore:overflow")
def test_its_ends_are_those_of_the_function():
    found = algebra.exp(np.array([np.nan, np.inf, -np.inf, 0.0, 800.0, -800.0]))
    np.testing.assert_array_equal(found, [np.nan, np.inf, 0.0, 1.0, np.inf, 0.0])
    assert algebra.exp(np.float64(0.0)) == 1.0
    assert algebra.exp(np.array(1.0)).shape == ()
