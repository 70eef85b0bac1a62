"""The bill of all effects: its config, its refusals, and its files. No speed is asserted."""

import csv

import pytest
import yaml

import redundant_envs as rde
from redundant_envs.effects import OWN
from redundant_envs.envs import cost
from redundant_envs.scenes.files import config_folder
from redundant_envs.scenes.scene import scene_names
from redundant_envs_train.config import checked
from studies import effects
from studies.__main__ import main

SHIPPED = yaml.safe_load((config_folder("studies") / "effects.yaml").read_text(encoding="utf-8"))
STUDY = checked(effects.Study, SHIPPED)


def test_every_effect_of_the_package_has_an_entry_and_is_timed_beside_a_bare_arm():
    assert {type(entry.effect).__name__ for entry in STUDY.entries.values()} == {*OWN}
    for entry in STUDY.entries.values():
        assert all(isinstance(effect, cost.BARE) for effect in entry.arm.effects)
        assert entry.zero is None or (type(entry.zero) is type(entry.effect) and entry.zero != entry.effect)
    every = effects.pairs_of(STUDY)
    assert [*every] == ["bare FourR", "bare RPRP", *STUDY.entries, *scene_names()]
    assert every["LimitSpring"].without == rde.load_scene("four_r_reach")
    assert every["rprp_reach"] == (rde.load_scene("rprp_reach"), every["bare RPRP"].scene)
    some = effects.pairs_of(STUDY, ["Gravity", "rprp_stops"])
    assert [*some] == ["bare FourR", "Gravity", "rprp_stops"]


@pytest.mark.long
def test_the_study_writes_its_files_and_judges_its_ceilings(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(effects, "OWN", {"ViscousFriction": rde.effects.ViscousFriction})
    monkeypatch.setattr(effects, "ceilings_of", lambda kind: [effects.Ceilings(step=1e6, tolerance=1e-6)])
    config = tmp_path / "config.yaml"
    config.write_text(yaml.safe_dump({**SHIPPED, "lanes": 16, "turns": 2, "scenes": {}}), encoding="utf-8")
    words = ["effects", "ViscousFriction", "--config", str(config), "--out", str(tmp_path)]
    assert main(words) == 0
    assert "1 of 2 ceilings hold; not ViscousFriction at 1e-6 m (" in capsys.readouterr().out
    with (tmp_path / "effects.csv").open(encoding="utf-8") as file:
        rows = [(r["at"], r["of"], r["ceiling"], r["held"]) for r in csv.DictReader(file)]
    assert rows == [
        ("one rk8 step", "bare FourR", "", ""),
        ("one rk8 step", "ViscousFriction", "1000000.0", "True"),
        ("1e-6 m", "bare FourR", "", ""),
        ("1e-6 m", "ViscousFriction", "1e-06", "False"),
    ]
