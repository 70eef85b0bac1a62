"""The Runge-Kutta tables: nodes, weights, every order condition from rooted trees.

``verify`` measures the orders of compiled motions.
"""

import math
from functools import cache

import pytest

from redundant_envs.scenes.tableaus import METHODS, RK8

NAMES = sorted(set(METHODS) - {"dop853"})  # its stages are rk8's


@cache
def trees(order):
    """Rooted trees with ``order`` nodes; a tree is the sorted tuple of its subtrees."""
    return ((),) if order == 1 else tuple(sorted({t for small in trees(order - 1) for t in grown(small)}))


def grown(tree):
    """Trees with one leaf more."""
    yield tuple(sorted((*tree, ())))
    for k, sub in enumerate(tree):
        yield from (tuple(sorted((*tree[:k], t, *tree[k + 1 :]))) for t in grown(sub))


def size(tree):
    return 1 + sum(size(t) for t in tree)


def density(tree):
    """gamma of the tree."""
    return size(tree) * math.prod(density(t) for t in tree)


def stage_weights(method, tree, magnitude=False):
    """Weight of a tree at every stage, or the sum of magnitudes behind it."""
    result = [1.0] * method.stages
    for sub in tree:
        inner = stage_weights(method, sub, magnitude)
        for i, row in enumerate(method.a):
            products = [a * w for a, w in zip(row, inner, strict=False)]
            result[i] *= math.fsum(abs(p) for p in products) if magnitude else math.fsum(products)
    return result


def weight(method, weights, tree):
    """Elementary weight and the round-off that it may carry."""
    parts = stage_weights(method, tree)
    sizes = stage_weights(method, tree, magnitude=True)
    value = math.fsum(b * w for b, w in zip(weights, parts, strict=True))
    scale = math.fsum(abs(b) * w for b, w in zip(weights, sizes, strict=True))
    return value, 1.2e-16 * size(tree) * scale


def test_numbers_of_trees():
    """1, 1, 2, 4, 9, 20, 48, 115, 286 (Hairer, Norsett, Wanner, table II.2.2)."""
    assert [len(trees(n)) for n in range(1, 10)] == [1, 1, 2, 4, 9, 20, 48, 115, 286]


@pytest.mark.parametrize(("name", "stages"), [("euler", 1), ("rk4", 4), ("rk8", 12)])
def test_shape(name, stages):
    """Explicit, one node and one weight per stage; rows sum to the nodes, to rounding."""
    method = METHODS[name]
    assert (method.name, len(method.a), len(method.c), method.stages) == (name, *[stages] * 3)
    for i, (row, c) in enumerate(zip(method.a, method.c, strict=True)):
        assert len(row) <= i
        assert abs(math.fsum(row) - c) <= 1e-16 + 2.3e-16 * max((abs(a) for a in row), default=0.0)
    errors = [method.error6, method.error5, method.error3]
    assert [len(e) for e in errors] == [12 if name == "rk8" else 0] * 3


CLAIMS = {  # weights, their order, and the share of 1 / density that they sum to
    **{name: (METHODS[name], METHODS[name].b, METHODS[name].order, 1.0) for name in NAMES},
    **{f"error{n}": (RK8, getattr(RK8, f"error{n}"), n, 0.0) for n in (6, 5, 3)},
}


def misses(method, weights, share, order):
    """Gaps in the conditions of an order, and what rounding allows."""
    found = [(*weight(method, weights, tree), tree) for tree in trees(order)]
    return [(abs(value - share / density(tree)), 1e-15 + noise) for value, noise, tree in found]


@pytest.mark.parametrize(("method", "weights", "order", "share"), CLAIMS.values(), ids=CLAIMS)
def test_every_tree_up_to_the_claimed_order_is_met_and_some_of_the_next_one_is_not(
    method, weights, order, share
):
    """Weights of a step sum to 1 / density; those of an estimate vanish."""
    for k in range(1, order + 1):
        assert all(gap <= most for gap, most in misses(method, weights, share, k))
    assert max(misses(method, weights, share, order + 1))[0] > 1e-6
