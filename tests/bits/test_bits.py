"""The bits of a scene's motion, as they were recorded: on every machine the same."""

import json

import pytest
from recorded_scenes import RECORD, RECORDED, digest

SHORT = (
    "4R all rk8", "4R all 1e-6", "RPRP generalized rk8", "stops 1e-6, inelastic", "stops rk4, inelastic",
    "stops dop853", "4R all rk8, work", "FourRReach-v0", "RPRPReach-v0",
)  # fmt: skip


@pytest.mark.parametrize(
    "name", [n if n in SHORT else pytest.param(n, marks=pytest.mark.long) for n in RECORDED]
)
def test_bits_are_those_recorded(name):
    function, arguments = RECORDED[name]
    assert digest(function(*arguments)) == json.loads(RECORD.read_text(encoding="utf-8"))[name]


def test_every_scene_is_recorded():
    assert list(json.loads(RECORD.read_text(encoding="utf-8"))) == list(RECORDED)
