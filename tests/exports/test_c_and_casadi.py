"""Accelerations in C and in CasADi: they are those of the scene, and what they cannot express is refused."""

import ctypes
import dataclasses
import shutil
import subprocess

import numpy as np
import pytest
from catalogue import FOUR_R, RPRP, SCENES
from foreign import accelerations, states
from refusals import refusal, short

import redundant_envs as rde
from redundant_envs.exports.files import document, write
from redundant_envs.exports.motion import smooth_scene
from redundant_envs.scenes.scene import scene_names

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
WARNINGS = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror", "-O1"]
NEEDS_C = pytest.mark.skipif(COMPILER is None, reason="no C compiler was found")
e = rde.effects


def smooth_catalogue():
    """Scenes of the catalogue and the shipped ones, without what is no function of the motion."""
    every = {**SCENES, **{name: rde.load_scene(name) for name in scene_names()}}
    smooth = {name: smooth_scene(scene, "C", True)[0] for name, scene in every.items()}
    alike = {(scene.robot, scene.effects, scene.actuation): name for name, scene in smooth.items()}
    return {name: smooth[name] for name in alike.values()}


def rows(arm, count):
    """Positions, rates and efforts, a row for each state."""
    return [*zip(*states(arm, count, effort=30.0), strict=True)]


def ours(scene, *state):
    """Accelerations, on Python's floats."""
    return [float(x) for x in accelerations(scene, *([float(x) for x in column] for column in state))]


def difference(found, expected):
    gap = np.abs(np.subtract(np.ravel(found), expected)).max()
    return gap / max(np.abs(expected).max(), 1e-300)


def compiled(folder, text):
    """The library of a C file, which has to compile without a warning."""
    (folder / "arm.c").write_text(text, encoding="utf-8")
    command = [COMPILER, *WARNINGS, "-shared", "-fPIC", "arm.c", "-o", "arm.so", "-lm"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return ctypes.CDLL(str(folder / "arm.so"))


def called(function, *state):
    row = ctypes.c_double * len(state[0])
    result = row()
    function(*(row(*column) for column in state), result)
    return list(result)


@pytest.fixture(scope="module")
def ca():
    return pytest.importorskip("casadi", reason="CasADi is not installed: pip install '.[casadi]'")


@pytest.mark.long
@NEEDS_C
def test_c_has_the_accelerations_of_every_scene_and_compiles_without_a_warning(tmp_path):
    scenes = smooth_catalogue()
    text = "".join(document(scene, "c", name=f"{k}.a").content for k, scene in enumerate(scenes.values()))
    library = compiled(tmp_path, text)
    for k, (name, scene) in enumerate(scenes.items()):
        for state in rows(scene.robot, 20):
            found = called(library[f"scene_{k}_a_accelerations"], *state)
            assert difference(found, ours(scene, *state)) < 1e-12, name


@NEEDS_C
@pytest.mark.parametrize("arm", [FOUR_R, RPRP], ids=["4R", "RPRP"])
def test_c_finds_the_accelerations_of_both_arms_in_a_thousand_states(arm, tmp_path):
    library = compiled(tmp_path, document(rde.Scene(arm, (e.Gravity(),)), "c").content)
    for q, qd, efforts in rows(arm, 1000):
        found = called(library[f"{arm.kind}_accelerations"], q, qd, efforts)
        assert difference(found, arm.forward_dynamics(q, qd, arm.motor_map @ efforts)) < 1e-12


@pytest.mark.long
def test_casadi_has_the_accelerations_of_every_scene(ca, tmp_path):
    for name, scene in smooth_catalogue().items():
        write(scene, "casadi", tmp_path / "arm.casadi")
        function = ca.Function.load(str(tmp_path / "arm.casadi"))
        assert function.name_in() == ["q", "qd", "commands"]
        assert function.name_out() == ["qdd", "M", "h", "G", "tip", "J"]
        for state in rows(scene.robot, 5):
            assert difference(np.array(function(*state)[0]), ours(scene, *state)) < 1e-12, name


@pytest.mark.long
def test_casadi_finds_mass_matrix_and_bias_forces_to_the_last_bit(ca):
    from redundant_envs.exports.casadi import casadi_function

    for arm in (FOUR_R, RPRP):
        function = casadi_function(rde.Scene(arm, (e.Gravity(),)))
        for q, qd, efforts in rows(arm, 200):
            _, M, h, G, tip, J = (np.array(x) for x in function(q, qd, efforts))
            np.testing.assert_array_equal(M, arm.mass_matrix(q))
            np.testing.assert_array_equal(h.ravel(), arm.bias_forces(q, qd))
            np.testing.assert_allclose(G.ravel(), arm.gravity_forces(q), rtol=0, atol=1e-13)
            np.testing.assert_allclose(tip.ravel(), arm.forward_kinematics(q), rtol=0, atol=1e-15)
            np.testing.assert_allclose(J, arm.jacobian(q), rtol=0, atol=1e-15)


def test_casadi_differentiates_a_scene(ca):
    from redundant_envs.exports.casadi import casadi_function

    function = casadi_function(rde.Scene(FOUR_R, (e.Gravity(),)))
    slope = function.factory("slope", ["q", "qd", "commands"], ["jac:qdd:commands"])
    (state,) = rows(FOUR_R, 1)
    expected = np.linalg.solve(FOUR_R.mass_matrix(state[0]), FOUR_R.motor_map)
    np.testing.assert_allclose(np.array(slope(*state)), expected, rtol=1e-9)


@pytest.mark.parametrize("form", ["c", "casadi"])
@pytest.mark.parametrize(
    "effect",
    [
        e.PrismaticStop((0.0, 0.0), (0.2, 0.2)), e.CoulombFriction(0.1), e.CommandDelay(0.01, 0.02),
        e.Lag(0.05), e.SensorNoise(0.01, 0.01), e.PickUp(0.1, 1.0), e.MovingBase((0.1, 0.1), 2.0),
        e.MotorBrake(0, 0.1), e.MotorLoss(0, 0.1),
    ],
    ids=lambda effect: type(effect).__name__,
)  # fmt: skip
def test_what_is_no_function_of_the_motion_is_refused_by_name_or_noted(form, effect):
    if form == "casadi":
        pytest.importorskip("casadi", reason="CasADi is not installed")
    smooth = e.LimitSpring("r1", 0.0, 0.2, 500.0, 5.0)  # its law is a function of the motion
    scene, name = rde.Scene(RPRP, (smooth, effect)), type(effect).__name__
    message = refusal(document, scene, form)
    assert f"{name} (" in message
    assert "LimitSpring" not in message
    assert short(message)
    made = document(scene, form, approximate=True)
    assert [note.name for note in made.notes] == [name]
    assert form != "c" or f"Approximate:\n     {name}: left out" in made.content


def test_functions_of_several_scenes_have_names_of_their_own(tmp_path):
    scene = SCENES["4R gravity rk4"]
    for name, found in {"": "FourR", "four_r_reach": "four_r_reach", "4r-ü.b": "scene_4r_ufc_b"}.items():
        assert f"void {found}_accelerations(const double q[4]" in document(scene, "c", name=name).content
    for file in ("one.c", "other.c"):  # of one scene, or of two whose files have one name
        write(scene, "c", tmp_path / file, name="lab")
        assert f"void {file[:-2]}_accelerations(" in (tmp_path / file).read_text(encoding="utf-8")


@NEEDS_C
def test_any_name_and_an_arm_on_whose_pose_nothing_depends_compile_without_a_warning(tmp_path):
    write(SCENES["4R gravity rk4"], "c", tmp_path / "out.c", name='a*/ b /*\\\n??/ "\ud800')
    compiled(tmp_path, (tmp_path / "out.c").read_text(encoding="utf-8"))
    (tmp_path / "slider").mkdir()
    library = compiled(tmp_path / "slider", document(rde.Scene(rde.Chain("P", (0.5,))), "c").content)
    assert called(library.Chain_accelerations, [0.1], [0.2], [3.0]) == [6.0]


def test_numbers_that_episodes_draw_are_nominal_and_the_file_says_so():
    scene = dataclasses.replace(SCENES["4R gravity rk4"], randomize={"gravity.g": {"uniform": [5.0, 12.0]}})
    text = document(scene, "c").content
    assert "Numbers that episodes draw have their nominal values." in text
    assert text.count("9.81") == document(SCENES["4R gravity rk4"], "c").content.count("9.81")
