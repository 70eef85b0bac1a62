"""Scenes whose programs are long: refused at once, compiled without deep calls."""

import json
import re

import pytest
from compiled import on_columns
from numpy.testing import assert_array_equal

import redundant_envs as rde
from redundant_envs.__main__ import main
from redundant_envs.algebra import all_of, where
from redundant_envs.tracing import graph

e = rde.effects
ARM = rde.Chain("RR", (1.0, 1.0), (1.0, 1.0))


def test_a_chain_of_conditions_is_as_long_as_it_likes():
    def every(x):
        return where(all_of(x > float(k) for k in range(2000)), 1.0, 0.0)

    assert_array_equal(on_columns(every, [1998.5, 1999.5])[0], [0.0, 1.0])


def test_a_program_of_too_many_operations_is_refused_with_its_largest_effect(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(graph, "MOST_OPERATIONS", 8_000)
    planes = [e.HalfPlane(point=(0.0, -3.0 - i), name=f"p{i}") for i in range(20)]
    disc = e.Disc((1.0, 1.0), 0.1, along_links=True)
    scene = rde.Scene(ARM, (*planes, disc), tolerance=1e-6)
    said = r"more than 8000 operations.*of its 21 effects '\w+' has the most, about \d+: leave"
    for refuses in (rde.BatchSimulator, rde.listing, rde.bill):
        with pytest.raises(ValueError, match=said):
            refuses(scene)
    path = tmp_path / "long.yaml"
    path.write_text(json.dumps(scene.to_dict()))
    for asked in ("--cost", "--bill"):
        assert main(["scene", str(path), asked]) == 2
        assert re.search(said, capsys.readouterr().err)
