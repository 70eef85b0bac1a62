"""Things take turns when they are timed. No speed is asserted."""

import numpy as np
import pytest

from redundant_envs.support.timing import Times, by_turns


def samplers(**lengths):
    """Samplers with known times, and the order in which they are asked."""
    order = []
    return order, {name: lambda name=name: order.append(name) or lengths[name] for name in lengths}


def test_things_take_turns_and_those_with_fewer_have_them_at_equal_distances():
    order, things = samplers(a=1.0, b=2.0)
    found = by_turns(things, 6, {"b": 2})
    assert "".join(order) == "abaa" + "abaa"
    assert {name: len(times.samples) for name, times in found.items()} == {"a": 6, "b": 2}


def test_a_thing_that_takes_too_long_has_no_more_turns_but_always_one():
    _, things = samplers(slow=3.0, quick=0.5, parts=[0.5, 0.5])
    counts = {name: len(times.samples) for name, times in by_turns(things, 9, most=2.0).items()}
    assert counts == {"slow": 1, "quick": 4, "parts": 2}


def test_times_have_a_best_a_median_and_a_spread():
    times = Times(np.array([[1.0, 5.0], [2.0, 4.0], [6.0, 3.0], [3.0, 6.0], [4.0, 4.0]]))
    assert times.best.tolist() == [1.0, 3.0]
    assert times.median.tolist() == [3.0, 4.0]
    assert times.spread == pytest.approx((9.0 - 6.0) / 8.0)
