"""Fixtures: a test that takes one of them runs for every id, kind of environment, or way to copy."""

import pytest
from catalogue import COPIES, IDS
from faces import FACES, GOAL_IDS, KINDS, PLAIN_IDS


def fixture(name, values, ids=None):
    @pytest.fixture(params=values, name=name, ids=ids)
    def one(request):
        return request.param

    return one


env_id, plain_id = fixture("env_id", IDS), fixture("plain_id", PLAIN_IDS)
goal_id = fixture("goal_id", GOAL_IDS)
kind, face = fixture("kind", KINDS), fixture("face", FACES)
WAYS = ("deepcopy", "pickle", "cloudpickle")
way = fixture("way", [COPIES[name] for name in WAYS], WAYS)
