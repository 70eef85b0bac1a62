"""Pictures of environments: trails, letters, the window; moving pictures and figures of trajectories."""

import base64
import copy
import dataclasses
import itertools
import sys
import types
import warnings
from pathlib import Path

import gymnasium as gym
import imageio_ffmpeg
import numpy as np
import pytest
from catalogue import EQUAL, with_example
from faces import FOUR_R, ID, actions, begin, made, with_effects
from gymnasium.error import DependencyNotInstalled
from PIL import Image

import redundant_envs as rde
from redundant_envs.__main__ import main
from redundant_envs.envs import rendering
from redundant_envs.envs.canvas import BARS, Canvas
from redundant_envs.model.trajectory import Trajectory
from redundant_envs.support import palette

e = rde.effects


def drawn(env_id=FOUR_R, kind="single", options=None, **kwargs):
    """An environment with pictures, after a reset."""
    env = made(kind, env_id, render_mode="rgb_array", **kwargs)
    begin(env, options, seed=0)
    return env


def images(env):
    """The picture of each environment."""
    pictures = env.get_images() if hasattr(env, "get_images") else env.render()
    return [pictures] if isinstance(pictures, np.ndarray) else pictures


@pytest.mark.long
def test_a_window_opens_without_a_warning_and_shows_every_step(goal_id, monkeypatch):
    pygame = pytest.importorskip("pygame", reason="a window needs the extra 'human'")
    shown, show = [], rendering.Renderer.show
    monkeypatch.setattr(
        rendering.Renderer, "show", lambda self, picture: (shown.append(picture), show(self, picture))
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gym.make(goal_id, render_mode="human")
        env.reset(seed=0)
        for action in actions(env, 5):
            env.step(action)
    assert len(shown) == 6
    assert all((a != b).any() for a, b in itertools.pairwise(shown))
    surface = pygame.surfarray.array3d(pygame.display.get_surface())
    np.testing.assert_array_equal(surface.swapaxes(0, 1), shown[-1])
    env.close()


def test_a_missing_pygame_or_display_is_told_at_once(monkeypatch):
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "pygame", None)
        with pytest.raises(DependencyNotInstalled, match=r"pip install '\.\[human\]'"):
            gym.make(ID, render_mode="human")
    pygame = pytest.importorskip("pygame", reason="a window needs the extra 'human'")
    monkeypatch.delenv("SDL_VIDEODRIVER", raising=False)
    monkeypatch.setattr(pygame.display, "get_driver", lambda: "offscreen")  # what SDL takes without one
    monkeypatch.setattr(pygame.display, "init", lambda: None)
    with pytest.raises(OSError, match=r"^render_mode='human' needs a display.*rgb_array.*--clip"):
        gym.make(ID, render_mode="human")


def test_two_environments_share_the_window_and_the_last_one_closes_it():
    pygame = pytest.importorskip("pygame", reason="a window needs the extra 'human'")
    one, other = (made("single", ID, render_mode="human", render_width=width) for width in (480, 320))
    for env in (one, other):
        env.reset(seed=0)
    one.close()
    assert pygame.display.get_surface() is not None
    pygame.display.quit()  # as another program of the process may
    other.step(actions(other, 1)[0])
    assert pygame.display.get_surface().get_size() == (320, 480)
    pygame.display.get_surface().fill(0)
    assert other.render() is None
    assert pygame.surfarray.array3d(pygame.display.get_surface()).any()
    other.close()
    assert pygame.display.get_surface() is None


def test_keys_pause_the_window_make_single_steps_and_set_its_speed(monkeypatch):
    pygame = pytest.importorskip("pygame", reason="a window needs the extra 'human'")
    env, rates, texts = made("single", ID, render_mode="human"), [], []
    env.reset(seed=0)

    def press(*keys):
        for key in keys:
            pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=pygame.key.key_code(key)))

    def tick(rate):
        """Of a clock that does not wait: a pause asks for a step after three pictures."""
        rates.append(rate)
        assert len(rates) < 9
        if len(rates) == 3:
            press("right")

    env._renderer._clock = types.SimpleNamespace(tick=tick)
    monkeypatch.setattr(Canvas, "text", lambda self, text, *more, **kw: texts.append(text))
    for keys, steps, expected, line in (
        (["up"], 1, [50.0], "speed 2"),
        (["right"], 4, [50.0] * 2, "speed 2"),
        (["-", "-"], 2, [25.0], "speed 1/2"),
        (["down"] * 9, 1, [6.25], "speed 1/8"),
        (["+", "+", "="], 1, [50.0], ""),
        (["[+]"] * 9, 1, [50.0], "speed 8"),
        ([], 16, [50.0] * 2, "speed 8"),
        (["[-]"] * 3, 8, [50.0], ""),
        (["space"], 1, [50.0] * 4, "paused"),
        (["right", "right"], 2, [50.0] * 2, "paused"),
        (["down", "right"], 1, [25.0], "paused - speed 1/2"),
        (["up", "up", "up", "right"], 1, [50.0], "paused - speed 4"),
        (["right"], 1, [50.0], "paused - speed 4"),
        (["space", "-", "-", "-"], 1, [25.0], "speed 1/2"),
    ):
        rates.clear()
        texts.clear()
        press(*keys)
        for action in actions(env, steps):
            env.step(action)
        assert rates == expected, keys
        assert "".join(text for text in texts[-1:] if text.startswith(("paused", "speed"))) == line
    press("space", "escape")
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    rates.clear()
    env.step(actions(env, 1)[0])  # which a window that was asked to close does not hold up
    assert (rates, texts[-1]) == ([25.0], "speed 1/2")
    left = [(x.type, getattr(x, "key", None)) for x in pygame.event.get((pygame.KEYDOWN, pygame.QUIT))]
    assert left == [(pygame.KEYDOWN, pygame.K_ESCAPE), (pygame.QUIT, None)]
    env.close()
    assert rendering.Renderer._pace == rendering.Pace()


@pytest.mark.parametrize("kind", ["single", "next_step", "sb3"])
def test_pictures_have_the_size_that_is_asked_for(kind):
    size = {"render_width": 200, "render_height": 120}
    scene = {**rde.load_scene("rprp_reach").to_dict(), "control_dt": 0.03}
    env = made(kind, ID, render_mode="rgb_array", scene=scene, **size)
    assert env.metadata["render_fps"] == pytest.approx(1.0 / 0.03)
    begin(env, seed=0)
    for picture in images(env):
        assert picture.shape == (120, 200, 3)
        assert (picture == palette.GOAL).all(axis=2).any()
    for name, wrong in (("render_width", 31), ("render_height", 5000), ("render_width", 64.0)):
        with pytest.raises(ValueError, match=f"^{name} is {wrong}"):
            made(kind, ID, **{name: wrong})


def test_partial_resets_and_states_begin_trails_anew():
    env = drawn(kind="next_step")
    for action in actions(env, 6):
        env.step(action)
    env.reset(options={"reset_mask": np.array([False, True, False])})
    assert [len(env._renderer.trail(lane)) for lane in range(3)] == [7, 1, 7]
    env.step(actions(env, 1)[0])
    state = env.get_state()
    begin(env, seed=1)
    env.set_state(state)
    env.render()
    for lane in range(3):
        np.testing.assert_allclose(env._renderer.trail(lane), [env.tip[lane]], atol=1e-12)


def test_a_picture_shows_the_curve_that_the_target_follows(monkeypatch):
    env = drawn("redundant_envs/TwoRTrack-v0")
    shown = env.render()
    monkeypatch.setattr(type(env.unwrapped.core.task), "path", lambda task, known: (1.0, 2.0, 3.0))
    with pytest.raises(ValueError, match=r"TrackTask.path gives \(1.0, 2.0, 3.0\); give points"):
        env.render()
    monkeypatch.setattr(type(env.unwrapped.core.task), "path", lambda task, known: ())
    assert 300 < (env.render() != shown).any(axis=2).sum() < 5000


def test_a_picture_is_ones_own_and_a_copy_draws_its_own(face):
    env = drawn(FOUR_R, face)
    picture = images(env)[0]
    before = picture.copy()
    twin = copy.deepcopy(env)
    twin.step(actions(twin, 1)[0])
    assert (images(twin)[0] != before).any()
    picture[:] = 0
    np.testing.assert_array_equal(images(env)[0], before)


def test_environments_are_drawn_with_numbers_of_their_own():
    more = e.Payload(0.3), e.PickUp(0.3, 0.05), e.Disc((0.7, 0.5), 0.2)
    env = drawn(FOUR_R, "next_step", scene=with_effects("FourRReach-v0", *more))
    numbers = {"disc.radius": [0.1, 0.2, 0.2], "payload.mass": [0.1, 0.1, 0.3]}
    begin(env, {"q": (0.0, 0.5, 1.0, 0.2), "goal": (0.1, 0.2), "parameters": numbers}, seed=0)
    discs = [(x[:240] == palette.OBSTACLE).all(axis=2).sum() for x in env.render()]
    assert 2 * discs[0] < min(discs[1:])
    loads = [(x == palette.LOAD).all(axis=2).sum() for x in env.render()]
    assert max(loads[:2]) < loads[2] - 50


def test_a_picture_says_the_time_what_the_bars_are_and_how_long_the_goal_was_held(monkeypatch):
    texts = []
    monkeypatch.setattr(
        Canvas, "text", lambda self, text, x, y, color, *more, **kw: texts.append((text, color))
    )
    at_rest = {"q": np.full(4, -np.pi / 2), "qd": np.zeros(4), "goal": (0.0, -0.99)}
    env = drawn(options=at_rest, task={"hold_steps": 2})
    env.render()
    assert [text for text, _ in texts] == [BARS, "joint1", "joint2", "joint3", "joint4", "time 0.00 s"]
    for held, color_of_goal in (("held 0.02 s", False), ("held 0.04 s", True)):
        env.step(np.zeros(4, np.float32))
        env.render()
        assert (texts[-1][0], texts[-1][1] == palette.GOAL) == (held, color_of_goal)


@pytest.mark.parametrize(
    ("names", "written"),
    [
        (["Elbow_1", "wrist-2"], ["elbow_1", "wrist-2"]),
        (["elbow", "\u5173\u8282"], ["1", "2"]),
        (["elbow", "j" * 99], ["1", "2"]),
    ],
)
def test_bars_have_names_or_numbers_if_one_cannot_be_written(names, written, monkeypatch):
    texts = []
    monkeypatch.setattr(Canvas, "text", lambda self, text, *more: texts.append(text))
    Canvas(1.0, np.zeros((480, 480, 3), np.uint8)).bars([0.1, 0.2], names)
    assert texts == [BARS, *written]


def still(scene, shape=(), q=0.2):
    """A trajectory of an arm that does not move, without a simulation."""
    q, zero = np.full((3, *shape, len(scene.robot.joints)), q), np.zeros((3, *shape))
    return Trajectory(np.array([0.0, 0.1, 0.2]), q, 0 * q, zero, zero, zero, 0 * q, scene)


@pytest.mark.long
def test_files_and_notebooks_show_the_motion_in_real_time(tmp_path):
    """The command ``simulate --clip`` writes a gif; ``tests/test_cli.py`` reads it."""
    scene = rde.Scene(EQUAL["4R"], control_dt=0.02)
    moving = rde.animate(rde.simulate(scene, np.full(4, 0.3), np.ones(4), np.linspace(0.0, 0.2, 11)))
    path = moving.save(tmp_path / "sub" / "clip.mp4")
    assert imageio_ffmpeg.count_frames_and_secs(str(path)) == (6, pytest.approx(0.24))  # 25 a second
    html = moving._repr_html_()
    assert html.startswith("<video controls")
    assert b"ftyp" in base64.b64decode(html.partition("base64,")[2].partition('"')[0])[:16]
    for name in ("clip.avi", "clip", "clip.gif.txt"):
        with pytest.raises(ValueError, match=r"end its name in \.gif or \.mp4"):
            moving.save(tmp_path / "none" / name)


def test_one_motion_of_a_batch_is_chosen_and_what_cannot_be_drawn_is_refused():
    scene = rde.Scene(EQUAL["4R"])
    batch, index = still(scene, (2, 3)), "index is .*trajectory has .*; (give index|leave)"
    batch.q[:, 1, 2] = 1.0
    one, other, same = (rde.animate(batch, index=k).frame(0) for k in ((0, 0), (1, 2), (-1, -1)))
    assert (one != other).any()
    np.testing.assert_array_equal(other, same)
    for trajectory, chosen, words in (
        (still(scene), 0, index),
        *((still(scene, (2,)), k, index) for k in (None, 2, (0, 0), True, "last")),
        (dataclasses.replace(still(scene), t=np.zeros(0)), None, "trajectory has no times"),
        (3, None, r"trajectory is 3; give what redundant_envs\.simulate returns"),
    ):
        with pytest.raises(ValueError, match=f"^{words}"):
            rde.animate(trajectory, index=chosen)


def posed(*effects, **states):
    """The picture of an arm at rest with effects, some of whose states have other values."""
    scene = rde.Scene(EQUAL["4R"], effects)
    z = np.array([[states.get(name.partition(".")[2], 0.0) for name in scene.states()]] * 3)
    return rde.animate(dataclasses.replace(still(scene, q=(0.0, 0.5, 1.0, 0.2)), z=z)).frame(0)


def test_obstacles_cables_springs_loads_stops_forces_faults_and_readings_are_drawn():
    without = posed()
    for effect, states, name in (
        (e.Disc((-0.9, 0.5), 0.3), {}, "OBSTACLE"),
        (e.HalfPlane((0.0, -0.5), (0.0, 2.0)), {}, "OBSTACLE"),
        (e.HalfPlane((0.0, -0.5)), {}, "EDGE"),
        (e.Tether(2, (-0.4, 1.0), 3.0), {}, "CABLE"),
        (e.Tendon(("joint2", "joint3"), (0.1, 0.1), 300.0), {}, "CABLE"),
        (e.Tendon(("joint2", "joint3"), (-0.1, -0.1), 300.0), {}, "SLACK"),
        (e.Payload(0.5), {}, "LOAD"),
        (e.PickUp(0.5, 1.0), {"carried": 0.5}, "LOAD"),
        (e.PickUp(0.5, 1.0), {"carried": 0.0}, "WAITING"),
        (e.JointStop((-0.5, None, None, None), (0.4, None, None, None)), {}, "RAIL"),
        (e.LimitSpring("joint1", -0.5, 0.4, 200.0, 5.0), {}, "RAIL"),
        (e.LimitSpring("joint2", -0.5, 0.4, 200.0, 5.0), {}, "CABLE"),  # it is pressed
        (e.TwoStageSpring("joint2", -0.5, 0.4, 5.0, 200.0), {}, "CABLE"),
        (e.TipForce(step=(0.0, 30.0), start=0.1), {"elapsed": 0.1}, "FORCE"),
        (e.JointTorque(deviation=0.0, time_constant=1.0), {"wander[1]": 2.0}, "FORCE"),
        (e.MotorBrake(1, 0.1), {"active": 1.0}, "WAITING"),
        (e.SensorBias(position=0.1), {}, "READING"),
        (e.SensorNoise(position=0.1), {"error_of_position[0]": -0.3}, "READING"),
    ):
        counts = [(x == getattr(palette, name)).all(axis=2).sum() for x in (posed(effect, **states), without)]
        assert counts[0] > counts[1] + 20, effect
    resting = e.TipForce(step=(0.0, 30.0), start=0.1), e.LimitSpring("joint1", 0.0, 0.4, 200.0)
    assert all((posed(effect) != palette.FORCE).any(axis=2).all() for effect in resting)
    assert (posed(resting[1]) != palette.CABLE).any(axis=2).all()  # it is not pressed


def test_every_scene_and_every_effect_of_the_package_is_drawn():
    shipped = (Path(__file__).parents[2] / "configs" / "scenes").glob("*.yaml")
    scenes = [rde.load_scene(path.stem) for path in shipped]
    used = {type(effect) for scene in scenes for effect in scene.effects}
    more = [kind for kind in e.OWN.values() if kind not in used]
    scenes += [rde.Scene(arm, with_example(kind, arm)) for kind in more for arm in EQUAL.values()]
    for scene in scenes:
        moving = rde.animate(still(scene))
        picture = moving.frame(0)
        assert (picture.shape, picture.dtype) == ((480, 480, 3), np.uint8)
        assert len({*(picture.astype(int) @ (65536, 256, 1)).ravel().tolist()}) > 10  # colours
        moving._q = np.full_like(moving._q, np.nan)  # as after a fault
        moving.frame(0)


@pytest.mark.parametrize("name", ["rprp_reach", "four_r_reach"])
def test_the_drawing_of_an_arm_is_a_png_too(name, tmp_path):
    path, scene = tmp_path / "arm.png", rde.load_scene(name)
    assert main(["scene", name, "--drawing", str(path)]) == 0
    pixels = np.asarray(Image.open(path).convert("RGB"))
    assert pixels.shape == (500, 760, 3)
    colors = [palette.LINKS[0], palette.JOINT, *([palette.RAIL] if scene.robot.sliders() else [])]
    for color in colors:
        assert (np.abs(pixels.astype(int) - color).max(axis=2) < 12).mean() > 1e-3
