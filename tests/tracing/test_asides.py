"""Results aside: operations that only they need change no bit of the other results."""

import numpy as np
import pytest
from compiled import recorded
from test_passes import random_results

from redundant_envs.tracing.graph import Operation, reached
from redundant_envs.tracing.passes.join import join_products


def test_results_aside_do_not_change_how_others_are_joined():
    def function(a, b, c):
        p = a * b
        return p + c, c - p, p

    for asides, names in (((), "+-*"), ((2,), "+-*"), ((1, 2), "fma - *"), ((0, 2), "+ fma *")):
        results = recorded(function)
        join_products(results, asides)
        assert [n.name for n in results] == (names.split() if " " in names else list(names))


@pytest.mark.parametrize("seed", range(8))
def test_random_results_are_joined_as_if_those_aside_were_not_there(seed):
    numbers = {}  # equal expressions have the same

    def told(results):
        known = {}
        for n in reached(results):
            text = (n.name, n.extra, *(known[a] if isinstance(a, Operation) else a for a in n.arguments))
            known[n] = f"%{numbers.setdefault(text, len(numbers))}"
        return [known[r] for r in results]

    beside, alone = (random_results(np.random.default_rng(seed), 60) for _ in range(2))
    asides = (0, 3, 5)
    alone = [r for k, r in enumerate(alone) if k not in asides]
    join_products(alone)
    join_products(beside, asides)
    assert any(n.name == "fma" for n in reached(alone))
    assert told([r for k, r in enumerate(beside) if k not in asides]) == told(alone)
