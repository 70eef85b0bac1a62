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


def test_every_effect_of_the_package_has_an_entry():
    assert [*dict.fromkeys(type(entry.effect).__name__ for entry in STUDY.entries.values())] == [*OWN]
    assert [name for name in STUDY.entries if name not in OWN] == [
        "Disc along links",
        "HalfPlane along links",
    ]
    assert STUDY.lanes == 4096
    for entry in STUDY.entries.values():
        assert all(isinstance(effect, cost.BARE) for effect in entry.arm.effects)
        assert entry.zero is None or (type(entry.zero) is type(entry.effect) and entry.zero != entry.effect)


def test_bare_arms_effects_and_scenes_are_timed_or_those_that_are_named():
    every = effects.pairs_of(STUDY)
    assert [*every] == ["bare FourR", "bare RPRP", *STUDY.entries, *scene_names()]
    assert every["bare FourR"].scene == rde.load_scene("four_r_reach")
    assert every["LimitSpring"].without == rde.load_scene("four_r_reach")
    assert every["rprp_reach"] == (rde.load_scene("rprp_reach"), every["bare RPRP"].scene)
    some = effects.pairs_of(STUDY, ["Gravity", "rprp_stops"])
    assert [*some] == ["bare FourR", "Gravity", "rprp_stops"]


@pytest.mark.long
def test_the_study_writes_its_files_and_judges_its_ceilings(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(effects, "OWN", {"ViscousFriction": rde.effects.ViscousFriction})
    monkeypatch.setattr(effects, "ceilings_of", lambda kind: [effects.Ceilings(step=1e6, tolerance=1e-6)])
    config = tmp_path / "config.yaml"
    data = {**SHIPPED, "lanes": 16, "turns": 2, "scenes": {}}
    config.write_text(yaml.safe_dump(data), encoding="utf-8")
    words = ["effects", "ViscousFriction", "--config", str(config), "--out", str(tmp_path)]
    assert main(words) == 0
    out = capsys.readouterr().out
    assert "1 of 2 ceilings hold; not ViscousFriction at 1e-6 m (" in out
    with (tmp_path / "effects.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == effects.COLUMNS
    assert [(row["at"], row["of"]) for row in rows] == [
        (at, of) for at in ("one rk8 step", "1e-6 m") for of in ("bare FourR", "ViscousFriction")
    ]
    assert [(row["ceiling"], row["held"]) for row in rows[1::2]] == [
        ("1000000.0", "True"),
        ("1e-06", "False"),
    ]
    assert [(row["ceiling"], row["held"]) for row in rows[::2]] == [("", "")] * 2
    for kind in ("png", "svg"):
        assert (tmp_path / f"effects.{kind}").stat().st_size > 1000
    panels = effects.figure(STAGED).axes
    assert [panel.get_title(loc="left") for panel in panels] == [f"at {at}" for at in cost.TOLERANCES]
    assert [label.get_text() for label in panels[0].get_yticklabels()] == ["b", "a"]
    assert (
        effects.verdict(STAGED)
        == "2 of 4 ceilings hold; not a at 1e-6 m (3.0 > 2.0), b at 1e-6 m (3.0 > 2.0)"
    )


STAGED = [
    {"at": at, "of": of, "times_bare": times, "ceiling": most, "held": times <= most if most else ""}
    for at, times in (("one rk8 step", 1.5), ("1e-6 m", 3.0))
    for of, most in (("bare FourR", ""), ("a", 2.0), ("b", 2.0))
]


def test_each_example_has_a_row_of_ceilings(tmp_path, monkeypatch):
    page = effects.PAGES / "disc.md"
    kept = [row for row in page.read_text(encoding="utf-8").splitlines() if "along_links=True" not in row]
    (tmp_path / page.name).write_text("\n".join(kept), encoding="utf-8")
    monkeypatch.setattr(effects, "PAGES", tmp_path)
    with pytest.raises(ValueError, match=r"disc.md has ceilings of 1 examples of 2; give each a row"):
        effects.ceilings_of(rde.effects.Disc)


@pytest.mark.quick("change0-lanes is 0; give a whole number from 1")
@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"lanes": 0}, "lanes is 0; give a whole number from 1"),
        ({"seconds": 0.0}, "seconds is 0.0; give a number from 1e-09"),
        ({"wrong": 1}, "wrong is unknown; valid: lanes"),
        ({"scenes": []}, r"scenes is \[\]; give a mapping"),
        (
            {"scenes": {"nowhere": {"step": 1.0, "tolerance": 1.0}}},
            "unknown key 'nowhere'; valid: cheap_sensors",
        ),
        ({"scenes": {"four_r_free": {"step": 1.0}}}, "scenes.four_r_free.tolerance is missing"),
        (
            {"scenes": {"four_r_free": {"step": 1.0, "tolerance": 0.0}}},
            "scenes.four_r_free.tolerance is 0.0; give a number from",
        ),
    ],
)
def test_configs_are_refused(change, said):
    with pytest.raises(ValueError, match=said):
        checked(effects.Study, {**SHIPPED, **change})
    with pytest.raises(ValueError, match="turns is missing; give the turns of a scene"):
        checked(effects.Study, {k: v for k, v in SHIPPED.items() if k != "turns"})
