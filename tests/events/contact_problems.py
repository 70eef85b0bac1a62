"""Problems of sliders at their stops, and their solutions by trying every set of stops that may act."""

import itertools

import numpy as np
import pytest

from redundant_envs.events.contacts import Contact, resolve_contacts

SLIDERS = pytest.mark.parametrize("count", [1, 2, 3], ids=["one slider", "two", "three"])


def mobility(rng, count):
    """A symmetric and positive definite matrix."""
    a = rng.normal(size=(count, count))
    return a @ a.T + 0.01 * np.eye(count)


def sets(count):
    for size in range(count + 1):
        yield from (list(s) for s in itertools.combinations(range(count), size))


def complementary(w, d):
    """The one x >= 0 with w x - d >= 0 and x (w x - d) = 0."""
    fitting = []
    for acting in sets(len(d)):
        x = np.zeros(len(d))
        if acting:
            x[acting] = np.linalg.solve(w[np.ix_(acting, acting)], d[acting])
        idle = [k for k in range(len(d)) if k not in acting]
        if (x >= 0.0).all() and ((w @ x - d)[idle] >= 0.0).all():
            fitting.append(x)
    assert len(fitting) == 1
    return fitting[0]


def as_lists(*arrays):
    return [x.tolist() for x in arrays]


def contact(velocity=0.0, side=1.0, resting=False, acceleration=0.0, force=0.0, released=False, away=False):
    """A slider at the stop of a side, at 0.3 m; or away from both."""
    position, lower, upper = (0.15, 0.0, 0.3) if away else (0.3, 0.0, 0.3) if side > 0.0 else (0.3, 0.3, 0.6)
    return Contact(position, velocity, side if resting else 0.0, lower, upper, acceleration, force, released)


def resolved(contacts, w, restitution=0.5):
    """Contacts of stops of one restitution, resolved once."""
    alike = [c._replace(restitution=restitution) for c in contacts]
    return resolve_contacts(0.0, alike, np.asarray(w).tolist())
