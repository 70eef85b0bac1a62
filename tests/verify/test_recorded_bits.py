"""The bits of a scene's motion are those of the record, on every machine."""

import json

import pytest

from redundant_envs.__main__ import main
from redundant_envs.verify import recorded_bits
from redundant_envs.verify.recorded_bits import SHORT
from tests.verify import aimed


@pytest.mark.quick("4R all 1e-6", "stops dop853", "RPRPReach-v0")
@pytest.mark.parametrize(
    "name", [n if n in SHORT else pytest.param(n, marks=pytest.mark.long) for n in aimed.RECORDED]
)
def test_bits_are_those_recorded(name):
    assert aimed.found(name) == aimed.recorded()[name]


def test_every_scene_is_recorded():
    assert list(aimed.recorded()) == list(aimed.RECORDED)
    assert set(SHORT) <= set(recorded_bits.RECORDED)


@pytest.mark.long
def test_verify_says_whether_this_machine_has_the_recorded_bits(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(recorded_bits, "SHORT", ("4R all rk8", "4R all 1e-6"))
    assert main(["verify", "--bits", "short"]) == 0
    assert "2 of 2 recorded motions have the same bits" in capsys.readouterr().out
    changed = aimed.recorded() | {"4R all 1e-6": "0"}
    monkeypatch.setattr(recorded_bits, "RECORD", tmp_path / "record.json")
    recorded_bits.RECORD.write_text(json.dumps(changed), encoding="utf-8")
    assert main(["verify", "--bits", "short"]) == 1
    assert "4R all 1e-6: other bits" in capsys.readouterr().out
