"""Problems of sliders at their stops; ``complementary`` solves them by trying every set that may act."""

import numpy as np
import pytest

from redundant_envs.events.contacts import Contact, resolve_contacts
from tests.oracles.independent_stops import complementary as complementary

SLIDERS = pytest.mark.parametrize("count", [1, 2, 3], ids=["one slider", "two", "three"])


def mobility(rng, count):
    """A symmetric and positive definite matrix."""
    a = rng.normal(size=(count, count))
    return a @ a.T + 0.01 * np.eye(count)


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
