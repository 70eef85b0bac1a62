"""Files and plain data of users: whatever they hold, one short ValueError, at once."""

import math
import os
import time

import gymnasium as gym
import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import redundant_envs as rde
from agents.__main__ import main as agents_main
from agents.config import load
from redundant_envs.__main__ import main
from redundant_envs.files import LARGEST_FILE, parse_yaml, read_yaml, text_value
from redundant_envs.scene import scene_folder, scene_names
from redundant_envs.studies.accuracy_config import load_study
from redundant_envs.studies.throughput import load_config

EFFECTS = b"effects:\n- {type: Gravity}\n"
ROBOT = "robot: {type: FourR, masses: [1, 1, 1, 1], lengths: [1, 1, 1, 1]}\n"
BOMB = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 10)
)
BAD = {
    "aliases": (BOMB.encode(), "line 1: it has an anchor"),
    "alias alone": ((ROBOT + "effects: [*x]\n").encode(), "line 2: it has an anchor"),
    "merge key": ((ROBOT + "<<: {control_dt: 0.1}\n").encode(), "line 2: it has a merge key"),
    "python tag": ((ROBOT + "x: !!python/object/apply:os.system [ls]\n").encode(), "line 2: it has the tag"),
    "plain tag": ((ROBOT + "control_dt: !!str 1\n").encode(), "line 2: it has the tag"),
    "syntax": ((ROBOT + "effects: [{type: Gravity\n").encode(), "line 3: it is no valid YAML"),
    "tab": ((ROBOT + "\tcontrol_dt: 1\n").encode(), "line 2: it is no valid YAML"),
    "flow depth": (b"[" * 5000 + b"]" * 5000, "line 1: it is nested more than"),
    "mapping depth": (b"{a: " * 5000 + b"}" * 5000, "line 1: it is nested more than"),
    "block depth": (b"- " * 5000, "line 1: it is nested more than"),
    "long integer": ((ROBOT + f"control_dt: {'9' * 400}\n").encode(), "line 2: a number has 400 digits"),
    "longer integer": ((ROBOT + f"control_dt: {'9' * 9000}\n").encode(), "line 2: a number has 9000"),
    "huge integer": ((ROBOT + f"control_dt: {'9' * 90}\n").encode(), "line 2: control_dt is 1e+90"),
    "list as type": (b"robot:\n  type: [FourR]\n", "line 2: robot.type is ['FourR']"),
    "mapping as type": (ROBOT.encode() + EFFECTS + b"- type: {}\n", "line 4: effects[1].type is {}"),
    "list as key": ((ROBOT + "[a]: 1\n").encode(), "line 2: a key is a list"),
    "mapping as key": ((ROBOT + "{a: 1}: 1\n").encode(), "line 2: a key is a list or a mapping"),
    "key twice": ((ROBOT + ROBOT).encode(), "line 2: the key 'robot' stands there twice"),
    "inner key twice": (b"robot:\n  type: FourR\n  type: RPRP\n", "line 3: the key 'type' stands"),
    "not UTF-8": (ROBOT.encode() + b"# \xff\n", "line 2: it is no UTF-8"),
    "UTF-16": (ROBOT.encode("utf-16"), "line 1: it is no UTF-8"),
    "NUL": (ROBOT.encode() + b"integrator: r\x00k8\n", "line 2: it has the character"),
    "character beyond Unicode": ((ROBOT + 'x: "\\UFFFFFFFF"\n').encode(), "line 2: it is no valid YAML"),
    "character just beyond": ((ROBOT + '"\\U00110000": 1\n').encode(), "line 2: it is no valid YAML"),
    "long version": (f"%YAML 1.{'1' * 5000}\n---\n{ROBOT}".encode(), "line 1: it is no valid YAML"),
    "empty": (b"", "scene is None; give a mapping"),
    "list": (b"- 1\n", "scene is [1]; give a mapping"),
    "number": (b"5\n", "scene is 5; give a mapping"),
    "text": (b"hello\n", "scene is 'hello'; give a mapping"),
    "two documents": ((ROBOT + "---\n" + ROBOT).encode(), "line 2: it is no valid YAML"),
    "many values": (f"a: [{'1,' * 5_000}]".encode(), "line 1: it holds more than"),
    "large": (b"#" * (LARGEST_FILE + 1), "has more than 32768 bytes"),
    "unknown key": ((ROBOT + "control_dr: 1\n").encode(), "line 2: scene has the unknown key 'control_dr'"),
    "unknown inner key": (ROBOT.encode() + EFFECTS + b"- type: Gravity\n  gee: 1\n", "line 5: effects[1]"),
    "wrong number": (ROBOT.encode() + b"control_dt: fast\n", "line 2: control_dt is 'fast'"),
    "effect number": (ROBOT.encode() + b"effects:\n- type: Gravity\n  g: up\n", "line 4: Gravity.g is 'up'"),
    "wrong mass": (
        b"robot:\n  type: FourR\n  lengths: [1, 1, 1, 1]\n  masses: [1, 1, -1, 1]\n",
        "line 4: masses[2] is -1",
    ),
    "unknown joint": (
        ROBOT.encode() + b"effects: [{type: LimitSpring, coordinate: r1, lower: 0, upper: 1}]\n",
        "coordinate is 'r1'; FourR has joint1",
    ),
    "bool": (ROBOT.encode() + b"substeps: true\n", "line 2: substeps is True"),
    "sexagesimal": (ROBOT.encode() + b"control_dt: 1:30\n", "line 2: control_dt is '1:30'"),
    "date": (ROBOT.encode() + b"control_dt: 2026-01-01\n", "line 2: control_dt is '2026-01-01'"),
    "long text": ((ROBOT + f"integrator: {'x' * 30_000}\n").encode(), "line 2: integrator is 'xxx"),
    "long key": ((ROBOT + f"{'x' * 900}: 1\n").encode(), "line 2: scene has the unknown key 'xxx"),
}  # fmt: skip


def short(message):
    return len(message.splitlines()) <= 10 and len(message) < 1000


def refusal(function, *arguments):
    """The message of the ValueError that a call raises, or None; any other error is one of the test."""
    try:
        function(*arguments)
    except ValueError as error:
        return str(error)
    return None


@pytest.mark.parametrize(("content", "words"), BAD.values(), ids=BAD)
def test_a_bad_file_is_one_error_with_file_and_line(content, words, tmp_path, capsys):
    path = tmp_path / "mine.yaml"
    path.write_bytes(content)
    start = time.process_time()
    with pytest.raises(ValueError) as error:
        rde.load_scene(path)
    assert time.process_time() - start < 1.0
    assert str(path) in str(error.value)
    assert words in str(error.value)
    assert short(str(error.value))
    for command in (["scene", str(path)], ["verify", str(path)], ["simulate", "--scene", str(path)]):
        assert main(command) == 2
        assert words in capsys.readouterr().err


@pytest.mark.parametrize("content", [c for c, _ in BAD.values()], ids=BAD)
@pytest.mark.parametrize(
    "reader", [load, load_config, load_study], ids=["training", "throughput", "accuracy"]
)
def test_other_files_have_the_same_bounds(reader, content, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_bytes(content)
    with pytest.raises(ValueError) as error:
        reader(path)
    assert str(path) in str(error.value)
    assert len(str(error.value).splitlines()) <= 10


def test_a_bad_training_file_exits_with_2(tmp_path, capsys):
    path = tmp_path / "mine.yaml"
    path.write_text("config_version: 2\nenv: redundant_envs/RPRPReach-v0\nppo:\n  gamma: [1]\n")
    assert agents_main(["train", str(path)]) == 2
    assert f"{path}, line 4: ppo.gamma is [1]" in capsys.readouterr().err
    path.write_text(BOMB)
    assert agents_main(["train", str(path)]) == 2
    assert "line 1: it has an anchor" in capsys.readouterr().err


@pytest.mark.parametrize(
    "value",
    [
        "*a",
        "&a 1",
        "!!python/name:os.system",
        "[" * 5000,
        "9" * 400,
        "{a: 1, a: 2}",
        "\x00",
        r'"\UFFFFFFFF"',
        r'"\U00110000"',
    ],
)
def test_a_bad_override_is_refused(value):
    with pytest.raises(ValueError, match=r"^the value .*, line 1: ") as error:
        load("configs/training/rprp_reach_ppo.yaml", [f"seed={value}"])
    assert short(str(error.value))


def test_what_is_no_file_is_refused_at_once(tmp_path, capsys):
    fifo = tmp_path / "pipe.yaml"
    os.mkfifo(fifo)
    (tmp_path / "folder.yaml").mkdir()
    device = tmp_path / "zero.yaml"
    device.symlink_to("/dev/zero")
    lost = tmp_path / "lost.yaml"
    lost.symlink_to(tmp_path / "nothing")
    for path, words in (
        (fifo, "a device or a pipe"),
        (device, "a device or a pipe"),
        (tmp_path / "folder.yaml", "a folder; give a YAML file in it"),
        (lost, "no such file"),
        (tmp_path / ("x" * 5000 + ".yaml"), "no such file"),
        (tmp_path / "a\0b.yaml", "no such file"),
    ):
        for reader in (rde.load_scene, load, load_config, load_study):
            with pytest.raises(ValueError, match=words) as error:
                reader(path)
            assert short(str(error.value))
        assert main(["scene", str(path)]) == 2
        capsys.readouterr()


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may read everything")
def test_an_unreadable_file_is_refused(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(ROBOT)
    path.chmod(0)
    with pytest.raises(ValueError, match="cannot be read"):
        rde.load_scene(path)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-6", 1e-6), ("1E6", 1e6), ("-2.5e+3", -2500.0), (".5", 0.5), ("5.", 5.0), ("1_000", 1000),
        ("1_000.5", 1000.5), ("0", 0), ("010", 10), ("+3", 3), ("true", True), ("False", False),
        ("null", None), ("~", None), ("", None), (".inf", math.inf), ("-.inf", -math.inf), ("yes", "yes"),
        ("on", "on"), ("rk8", "rk8"), ("e5", "e5"), ("1e", "1e"), ("'1'", "1"), ("0x10", "0x10"),
        ("[1e-3, a]", [1e-3, "a"]),
    ],
)  # fmt: skip
def test_values_are_read_as_yaml_1_2_reads_them(text, value):
    read = text_value(text, "it")
    assert read == value
    assert type(read) is type(value)


def test_numbers_with_exponents_are_numbers_in_a_file(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(ROBOT + "tolerance: 1e-6\n")
    assert rde.load_scene(path).tolerance == 1e-6


@pytest.mark.parametrize("name", scene_names())
def test_files_of_the_package_and_what_scenes_print_are_read_as_before(name, tmp_path):
    path = scene_folder() / f"{name}.yaml"
    assert read_yaml(path, "scene") == yaml.safe_load(path.read_text())
    printed = tmp_path / "printed.yaml"
    printed.write_text(yaml.safe_dump(rde.load_scene(name).to_dict()))
    assert rde.load_scene(printed) == rde.load_scene(name)


def test_the_longest_file_is_read_or_refused_within_a_second():
    """Bytes, not values, decide how long the reader takes."""
    for unit in (
        "a: 1\n",
        "- 1\n",
        "[",
        "{",
        "'",
        '"',
        "x ",
        "- - ",
        "? ",
        ": ",
        "#\n",
        "\n",
        "|\n",
        "!",
        "&a ",
        "1,",
        "-",
    ):
        text = unit * (LARGEST_FILE // len(unit))
        start = time.process_time()
        assert short(refusal(parse_yaml, text, "text") or "")
        assert time.process_time() - start < 1.0, unit


# ---- plain data of programs ----------------------------------------------------------------------


def loop():
    data = {"robot": {}}
    data["robot"]["self"] = data
    return data


def deep():
    data = []
    for _ in range(100_000):
        data = [data]
    return data


def with_scene(**changes):
    return {"robot": {"type": "FourR", "masses": [1] * 4, "lengths": [1] * 4}, **changes}


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (loop(), "nested more than"),
        (with_scene(effects=deep()), "nested more than"),
        (with_scene(effects=[0] * 10_000_000), "more than 3000 values"),
        (with_scene(robot=5), "robot is 5; give a mapping"),
        (with_scene(effects=5), "effects is 5; give a list"),
        (with_scene(effects="Gravity"), "effects is 'Gravity'"),
        (with_scene(effects={"type": "Gravity"}), "effects is {'type': 'Gravity'}"),
        (with_scene(effects=[None]), "effects[0] is None"),
        (with_scene(effects=[{"type": 5}]), "effects[0].type is 5"),
        (with_scene(integrator=["rk8"]), "integrator is ['rk8']"),
        (with_scene(integrator=None), "integrator is None"),
        (with_scene(actuation=np.zeros(3)), "actuation is array"),
        (with_scene(substeps=2**70), "substeps is 1180591620717411303424; give at most"),
        (with_scene(substeps=10**5000), "substeps is an integer of 16610 bits"),
        (with_scene(substeps=True), "substeps is True; give a whole number"),
        (with_scene(substeps=1.5), "substeps is 1.5; give a whole number"),
        (with_scene(control_dt=10**400), "control_dt is an integer of"),
        (with_scene(control_dt=1e300), "control_dt is 1e+300 s; it must lie in"),
        (with_scene(control_dt=1e-300), "control_dt is 1e-300 s; it must lie in"),
        (with_scene(tolerance=True), "tolerance is True"),
        (with_scene(tolerance=[1e-6]), "tolerance is [1e-06]"),
        ({1: 2}, "unknown key 1"),
        ({("a", "b"): 2}, "unknown key ('a', 'b')"),
        (5, "scene is 5; give a mapping"),
    ],
    ids=lambda v: v if isinstance(v, str) else "",
)
def test_bad_plain_data_is_one_short_error(data, words):
    start = time.process_time()
    with pytest.raises(ValueError) as error:
        rde.Scene.from_dict(data)
    assert time.process_time() - start < 1.0
    assert words in str(error.value)
    assert short(str(error.value))


@pytest.mark.parametrize(
    "value",
    [True, "1", b"1", None, 1j, np.complex128(1), np.complex64(1), np.bool_(True), np.array([1.0]), [1.0],
     np.datetime64("2026-01-01"), 10**400, float("nan"), float("inf"), object()],
)  # fmt: skip
def test_what_is_no_number_is_refused_by_name(value):
    arm = rde.RPRP((1,) * 4, (0.5, 0.5))
    with pytest.raises(ValueError, match=r"^masses\[1\] is .*; give a finite number"):
        rde.RPRP((1, value, 1, 1), (0.5, 0.5))
    with pytest.raises(ValueError, match=r"^Gravity.g is .*; give a finite number"):
        rde.effects.Gravity(value)
    with pytest.raises(ValueError, match=r"^LimitSpring.upper is .*; give a finite number"):
        rde.effects.LimitSpring("r1", 0.0, value)
    if value is not None and not (isinstance(value, float) and value == math.inf):
        with pytest.raises(ValueError, match=r"^PrismaticStop.upper\[0\] is .*; give a finite number"):
            rde.effects.PrismaticStop((0.0, 0.0), (value, 0.3))
    with pytest.raises(ValueError, match=r"^control_dt is .*; give a finite number"):
        rde.Scene(arm, control_dt=value)


@pytest.mark.parametrize("masses", [np.ones(4), np.ones(4, np.float32), np.ones(4, int), [1, 1, 1, 1]])
def test_arrays_of_numbers_are_taken(masses):
    assert rde.RPRP(masses, (0.5, 0.5)).masses == (1.0, 1.0, 1.0, 1.0)
    assert rde.effects.ViscousFriction(np.float32(0.5)).coefficients == 0.5
    assert rde.effects.ViscousFriction(np.array(0.5)).coefficients == 0.5


@pytest.mark.parametrize(
    "masses",
    [np.ones((4, 1)), np.ones((4, 4)), np.array(1.0), {1: 1, 2: 1, 3: 1, 4: 1}, {1, 2, 3, 4}, "1111", 5, None,
     np.array(["1"] * 4), iter([1, 1, 1, 1])],
)  # fmt: skip
def test_what_is_no_sequence_of_numbers_is_refused_by_name(masses):
    with pytest.raises(ValueError, match=r"^masses"):
        rde.RPRP(masses, (0.5, 0.5))


@pytest.mark.parametrize(
    ("effects", "words"),
    [
        (rde.effects.Gravity(), "give a sequence, effects=(Gravity(g=9.81"),
        (5, "effects is 5; give a sequence"),
        ("Gravity", "effects is 'Gravity'; give a sequence"),
        ({"Gravity": 1}, "give a sequence"),
        (None, "effects is None; give a sequence"),
        (["Gravity"], "effects[0] is 'Gravity'; give an effect, such as Gravity()"),
        ([rde.effects.Gravity], "effects[0] is <class"),
        (
            [rde.effects.LimitSpring("r1", 0.0, 1.0)],
            "coordinate is 'r1'; FourR has joint1, joint2, joint3, joint4",
        ),
        ([rde.effects.LimitSpring(5, 0.0, 1.0)], "coordinate is 5; FourR has joint1"),
        ([rde.effects.LimitSpring(["joint1"], 0.0, 1.0)], "coordinate is ['joint1']; FourR has joint1"),
    ],
)
def test_bad_effects_say_what_to_write(effects, words):
    with pytest.raises(ValueError) as error:
        rde.Scene(rde.FourR((1,) * 4, (1,) * 4), effects)
    assert words in str(error.value)


TASKS = [
    (5, "task is 5; give a mapping"),
    ("reach", "task is 'reach'; give a mapping"),
    ([("inner", 0.1)], "task is [('inner', 0.1)]; give a mapping"),
    ({"hold_steps": 1.5}, "ReachTask.hold_steps is 1.5; give a whole number"),
    ({"hold_steps": True}, "ReachTask.hold_steps is True"),
    ({"hold_steps": 2**70}, "ReachTask.hold_steps is 1.1805916207174113e+21; it must lie in 1 to 1e+09"),
    ({5: 1}, "unknown key 5"),
    ({"inner": "small"}, "ReachTask.inner is 'small'; give a finite number"),
    ({"goal_tolerance": 1e200}, "ReachTask.goal_tolerance is 1e+200"),
    ({"rate_scale": 5e-324}, "ReachTask.rate_scale is 5e-324"),
    ({"speed_bound": 10**400}, "ReachTask.speed_bound is an integer of"),
]


@pytest.mark.filterwarnings("ignore:.*render_mode")
@pytest.mark.parametrize(("task", "words"), TASKS, ids=lambda v: v if isinstance(v, str) else "")
def test_a_bad_task_says_what_to_write(task, words):
    makers = (
        lambda: gym.make("redundant_envs/RPRPReach-v0", task=task),
        lambda: gym.make_vec("redundant_envs/RPRPReach-v0", num_envs=2, task=task),
        lambda: rde.make_sb3("redundant_envs/RPRPReach-v0", 2, task=task),
    )
    for maker in makers:
        with pytest.raises(ValueError) as error:
            maker()
        assert words in str(error.value)


# ---- anything at all -----------------------------------------------------------------------------

NUMBERS = st.one_of(st.integers(), st.floats(), st.integers(min_value=10**400), st.booleans())
PLAIN = st.recursive(
    st.one_of(st.none(), NUMBERS, st.text(max_size=5), st.sampled_from(["FourR", "RPRP", "Gravity", "rk8"])),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=10,
)
FOUR = st.lists(NUMBERS, min_size=4, max_size=4)
FIELDS = ("g", "down", "coordinate", "lower", "upper", "stiffness", "limits", "coefficients", "restitution")
ARM = st.fixed_dictionaries(
    {"type": st.sampled_from(["FourR", "RPRP"]) | PLAIN, "masses": FOUR | PLAIN},
    optional={"lengths": FOUR | PLAIN},
)
EFFECT = st.fixed_dictionaries(
    {"type": st.sampled_from(sorted(rde.effects.REGISTRY)) | PLAIN}, optional=dict.fromkeys(FIELDS, PLAIN)
)
SCENE = st.fixed_dictionaries(
    {"robot": ARM | PLAIN},
    optional={
        "effects": st.lists(EFFECT | PLAIN, max_size=3) | PLAIN,
        **dict.fromkeys(("integrator", "control_dt", "substeps", "tolerance", "actuation", "x"), PLAIN),
    },
)
FUZZ = settings(max_examples=200, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)


@FUZZ
@given(SCENE | PLAIN)
def test_plain_data_makes_a_scene_or_a_value_error(data):
    assert short(refusal(rde.Scene.from_dict, data) or "")


@FUZZ
@given(
    st.one_of(
        st.text(alphabet="ab:-[]{}&*!|>'\"%@`#,? \n\t019.e<\x00\ufeff", max_size=60), st.text(max_size=30)
    )
)
def test_text_is_plain_data_or_a_value_error(text):
    message = refusal(parse_yaml, text, "text")
    assert message is None or (message.startswith("text, line ") and short(message))


@FUZZ
@given(st.binary(max_size=60))
def test_bytes_are_plain_data_or_a_value_error(tmp_path_factory, raw):
    path = tmp_path_factory.getbasetemp() / "fuzz.yaml"
    path.write_bytes(raw)
    message = refusal(rde.load_scene, path)
    assert message is not None
    assert str(path) in message
    assert short(message)
