"""Files of users and plain data of programs: whatever they hold, one short ValueError, at once."""

import dataclasses
import math
import os
import sys

import gymnasium as gym
import numpy as np
import pytest
import yaml
from refusals import refusal, short

import redundant_envs as rde
from redundant_envs.__main__ import main
from redundant_envs.scenes import config_folder
from redundant_envs.scenes.files import LARGEST_FILE, parse_yaml, read_yaml, text_value
from redundant_envs.scenes.scene import scene_data, scene_names
from redundant_envs_train.config import load
from studies import accuracy_config, throughput

e = rde.effects
EFFECTS = "effects:\n- {type: Gravity}\n"
ROBOT = "robot: {type: FourR, masses: [1, 1, 1, 1], lengths: [1, 1, 1, 1]}\n"
BOMB = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 10)
)
BAD = {
    "aliases": (BOMB, "line 1: it has an anchor"),
    "merge key": (ROBOT + "<<: {control_dt: 0.1}\n", "line 2: scene has the unknown key '<<'"),
    "python tag": (ROBOT + "x: !!python/object/apply:os.system [ls]\n", "line 2: it has the tag"),
    "syntax": (ROBOT + "effects: [{type: Gravity\n", "line 3: it is not valid YAML"),
    "flow depth": ("[" * 5000 + "]" * 5000, "line 1: it is nested more than"),
    "long integer": (ROBOT + f"control_dt: {'9' * 400}\n", "line 2: control_dt is 9999"),
    "list as type": ("robot:\n  type: [FourR]\n", "line 2: robot.type is ['FourR']"),
    "list as key": (ROBOT + "[a]: 1\n", "line 2: a key is a list"),
    "key twice": (ROBOT + ROBOT, "line 2: the key 'robot' is there twice"),
    "not UTF-8": (ROBOT.encode() + b"# \xff\n", "line 2: it is not UTF-8"),
    "UTF-16": (ROBOT.encode("utf-16"), "line 1: it is not UTF-8"),
    "character beyond Unicode": (ROBOT + 'x: "\\UFFFFFFFF"\n', "line 2: it is not valid YAML"),
    "empty": ("", "scene is None; give a mapping"),
    "two documents": (ROBOT + "---\n" + ROBOT, "line 2: it is not valid YAML"),
    "many values": (f"a: [{'1,' * 5_000}]", "line 1: it holds more than"),
    "large": ("#" * (LARGEST_FILE + 1), "more than the 32768 that are read"),
    "unknown inner key": (ROBOT + EFFECTS + "- type: Gravity\n  gee: 1\n", "line 5: effects[1]"),
    "effect number": (ROBOT + "effects:\n- type: Gravity\n  g: up\n", "line 4: Gravity.g is 'up'"),
    "bool": (ROBOT + "substeps: true\n", "line 2: substeps is True"),
    "long text": (ROBOT + f"integrator: {'x' * 30_000}\n", "line 2: integrator is 'xxx"),
}
READERS = {
    "scene": rde.load_scene,
    "training": load,
    "throughput": throughput.load_study,
    "accuracy": accuracy_config.load_study,
}
MAX_CALLS = 1_000_000
"""Of functions, Python's own included: less than a second of any processor."""


def at_once(function, *arguments):
    """What a function returns after a limited number of calls, which no load and no processor changes."""
    made = 0

    def count(frame, event, called):
        nonlocal made
        made += event in ("call", "c_call")

    sys.setprofile(count)
    try:
        return function(*arguments)
    finally:
        sys.setprofile(None)
        assert made < MAX_CALLS


@pytest.mark.parametrize(("content", "words"), BAD.values(), ids=BAD)
def test_a_bad_file_is_one_error_with_file_and_line(content, words, tmp_path, capsys):
    path = tmp_path / "mine.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    for name, reader in READERS.items():
        message = refusal(at_once, reader, path) if name == "scene" else refusal(reader, path)
        assert str(path) in message
        assert short(message)
        assert name != "scene" or words in message
    for command in (["scene", str(path)], ["verify", str(path)], ["simulate", "--scene", str(path)]):
        assert main(command) == 2
        assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    "value", ["*a", "&a 1", "!!python/name:os.system", "[" * 5000, "{a: 1, a: 2}", r'"\UFFFFFFFF"']
)
def test_a_bad_override_is_refused(value):
    with pytest.raises(ValueError, match=r"^command line: the value .*, line 1: ") as error:
        load("configs/training/rprp_reach_ppo.yaml", [f"seed={value}"])
    assert short(str(error.value))


def test_what_is_no_file_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe.yaml")
    (tmp_path / "folder.yaml").mkdir()
    (tmp_path / "zero.yaml").symlink_to("/dev/zero")
    (tmp_path / "lost.yaml").symlink_to(tmp_path / "nothing")
    for name, words in (
        ("pipe", "a device or a pipe"),
        ("zero", "a device or a pipe"),
        ("lost", "no such file"),
        ("folder", "a folder; give a file in it"),
        ("x" * 5000, "no such file"),
        ("a\0b", "no such file"),
    ):
        path = tmp_path / f"{name}.yaml"
        for reader in READERS.values():
            message = refusal(reader, path)
            assert words in message
            assert short(message)
        assert main(["scene", str(path)]) == 2


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-6", 1e-6), ("1E6", 1e6), (".5", 0.5), ("5.", 5.0), ("1_000", 1000), ("010", 10), ("+3", 3),
        ("true", True), ("null", None), ("", None), (".inf", math.inf), ("yes", "yes"), ("rk8", "rk8"),
        ("1e", "1e"), ("'1'", "1"), ("0x10", "0x10"), ("[1e-3, a]", [1e-3, "a"]),
    ],
)  # fmt: skip
def test_values_are_read_as_yaml_1_2_reads_them(text, value):
    read = text_value(text, "it")
    assert read == value
    assert type(read) is type(value)


@pytest.mark.quick("cheap_sensors")
@pytest.mark.parametrize("name", scene_names())
def test_files_of_the_package_and_what_scenes_print_are_read_as_before(name, tmp_path):
    path = config_folder("scenes") / f"{name}.yaml"
    data = yaml.safe_load(path.read_text())
    for _ in range(2):  # read, and then kept in the folder of the user
        assert repr(read_yaml(path, "scene")) == repr(scene_data(name)) == repr(data)
    printed = tmp_path / "printed.yaml"
    printed.write_text(yaml.safe_dump(rde.load_scene(name).to_dict()))
    assert rde.load_scene(printed) == rde.load_scene(name)


@pytest.mark.quick("a: 1\\n")
@pytest.mark.parametrize(
    "unit", ["a: 1\n", "- 1\n", "[", "{", "'", "x ", "- - ", "? ", "#\n", "|\n", "!", "1,"]
)
def test_the_longest_file_is_read_or_refused_at_once(unit):
    """Bytes, not values, decide how long the reader takes."""
    assert short(refusal(at_once, parse_yaml, unit * (LARGEST_FILE // len(unit)), "text") or "")


def with_scene(**changes):
    return {"robot": {"type": "FourR", "masses": [1] * 4, "lengths": [1] * 4}, **changes}


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (with_scene(robot=5), "robot is 5; give a mapping"),
        (with_scene(effects={"type": "Gravity"}), "effects is {'type': 'Gravity'}"),
        (with_scene(effects=[{"type": 5}]), "effects[0].type is 5"),
        (with_scene(integrator=["rk8"]), "integrator is ['rk8']"),
        (with_scene(actuation=np.zeros(3)), "actuation is array"),
        (with_scene(substeps=2**70), "substeps is 1180591620717411303424; give at most 1000000"),
        (with_scene(substeps=10**5000), "substeps is <int"),
        (with_scene(control_dt=1e300), "control_dt is 1e+300 s; it must lie in"),
        (with_scene(tolerance=True), "tolerance is True"),
        (5, "scene is 5; give a mapping"),
    ],
    ids=lambda v: v if isinstance(v, str) else "",
)
def test_bad_plain_data_is_one_short_error(data, words):
    message = refusal(at_once, rde.Scene.from_dict, data)
    assert words in message
    assert short(message)


@pytest.mark.parametrize(
    ("given", "tolerance"),
    [({}, 1e-6), ({"integrator": "rk8"}, None), ({"substeps": 2}, None), ({"tolerance": None}, None)],
)
def test_plain_data_that_say_nothing_of_steps_have_the_usual_tolerance(given, tolerance, tmp_path):
    data = yaml.safe_load(ROBOT + EFFECTS) | given
    (path := tmp_path / "scene.yaml").write_text(yaml.safe_dump(data))
    assert rde.Scene.from_dict(data).tolerance == rde.load_scene(path).tolerance == tolerance


def test_a_control_interval_in_milliseconds_is_told_once_for_each_scene(tmp_path):
    data = scene_data("four_r_reach") | {"control_dt": 20}
    (path := tmp_path / "scene.yaml").write_text(yaml.safe_dump(data))
    for make in (
        lambda: rde.Scene.from_dict(data),
        lambda: rde.load_scene(path),
        lambda: gym.make("redundant_envs/FourRReach-v0", scene=str(path)),
        lambda: rde.Scene(rde.load_scene("four_r_reach").robot, control_dt=20),
    ):
        with pytest.warns(UserWarning, match=r"control_dt is 20, in seconds,.* for 20 ms give 0\.02") as told:
            scene = make()
        assert len(told) == 1
    assert told[0].filename == __file__
    dataclasses.replace(scene, substeps=3, tolerance=None)  # a change of something else is silent
