"""Fixtures: a test that takes one of them runs for every id, kind of environment, or way to copy."""

import pytest
from catalogue import COPIES, IDS
from faces import FACES, GOAL_IDS, KINDS, PLAIN_IDS


def fixture(name, values):
    @pytest.fixture(params=values, name=name)
    def one(request):
        return request.param

    return one


env_id, plain_id = fixture("env_id", IDS), fixture("plain_id", PLAIN_IDS)
goal_id = fixture("goal_id", GOAL_IDS)
kind, face = fixture("kind", KINDS), fixture("face", FACES)


@pytest.fixture(params=["deepcopy", "pickle", "cloudpickle"])
def way(request):
    """A function that copies."""
    return COPIES[request.param]
