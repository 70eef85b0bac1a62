"""Fixtures: a test that takes one of them runs for every id, kind of environment, or way to copy."""

import pytest
from catalogue import COPIES, EACH_ID
from faces import FACES, GOAL_IDS, KINDS, PLAIN_IDS


def fixture(values, ids=None):
    return pytest.fixture(params=values, ids=ids)(lambda request: request.param)


env_id, plain_id, goal_id = fixture(EACH_ID), fixture(PLAIN_IDS), fixture(GOAL_IDS)
kind, face = fixture(KINDS), fixture(FACES)
WAYS = ("deepcopy", "pickle", "cloudpickle")
way = fixture([COPIES[name] for name in WAYS], WAYS)
