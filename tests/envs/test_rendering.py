"""Pictures, trails and the window."""

import itertools
import sys
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled
from small_scenes import OWN_IDS

import redundant_envs as rde
from redundant_envs.envs.lettering import GLYPHS, cover, from_segment
from redundant_envs.envs.rendering import BARS, GOAL, TRAIL, TRAIL_LENGTH, Canvas

every_id = pytest.mark.parametrize("env_id", OWN_IDS)


def actions(steps, n):
    return np.random.default_rng(2).uniform(-1, 1, (steps, n, 4)).astype(np.float32)


@every_id
def test_a_window_opens_without_a_warning_and_shows_every_step(env_id, monkeypatch):
    pytest.importorskip("pygame", reason="a window needs the extra 'human'")
    from redundant_envs.envs.rendering import Window

    shown = []
    monkeypatch.setattr(Window, "show", lambda self, picture: shown.append(picture))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gym.make(env_id, render_mode="human")
        env.reset(seed=0)
        for action in actions(5, 1)[:, 0]:
            env.step(action)
    assert env.unwrapped.render_mode == "human"
    assert len(shown) == 6
    assert all((a != b).any() for a, b in itertools.pairwise(shown))
    assert env.render() is None
    env.close()
    env.close()


def test_the_window_has_the_picture_in_it():
    pygame = pytest.importorskip("pygame", reason="a window needs the extra 'human'")
    env = gym.make("redundant_envs/RPRPReach-v0", render_mode="human")
    env.reset(seed=0)
    env.step(np.ones(4, np.float32))
    picture = env.unwrapped._renderer.draw(0)
    surface = pygame.display.get_surface()
    np.testing.assert_array_equal(pygame.surfarray.array3d(surface).swapaxes(0, 1), picture)
    env.close()
    assert pygame.display.get_surface() is None
    env.reset()  # opens again
    env.close()


def test_a_missing_pygame_is_told_with_the_extra_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(DependencyNotInstalled, match=r"pip install redundant-envs\[human\]"):
        gym.make("redundant_envs/RPRPReach-v0", render_mode="human")
    gym.make("redundant_envs/RPRPReach-v0", render_mode="rgb_array").reset()


@every_id
@pytest.mark.parametrize("every", [1, 2, 30])
def test_the_trail_has_the_tip_of_every_step_however_seldom_it_is_rendered(env_id, every):
    env = gym.make(env_id, render_mode="rgb_array")
    for seed in (0, 1):
        env.reset(seed=seed)
        tips = [env.unwrapped.tip]
        for step, action in enumerate(actions(30, 1)[:, 0]):
            env.step(action)
            tips.append(env.unwrapped.tip)
            if (step + 1) % every == 0:
                env.render()
        np.testing.assert_array_equal(env.unwrapped._renderer.trail(0), tips)


def test_the_picture_does_not_depend_on_how_often_it_was_drawn():
    pictures = []
    for every in (1, 25):
        env = gym.make("redundant_envs/FourRReach-v0", render_mode="rgb_array")
        env.reset(seed=0)
        for step, action in enumerate(actions(25, 1)[:, 0]):
            env.step(action)
            picture = env.render() if (step + 1) % every == 0 else None
        pictures.append(picture)
    np.testing.assert_array_equal(*pictures)


@every_id
@pytest.mark.parametrize("face", ["next_step", "same_step", "sb3"])
def test_trails_of_a_vector_begin_anew_with_an_episode(env_id, face):
    kwargs = {"num_envs": 3, "render_mode": "rgb_array", "max_episode_steps": 4}
    if face == "sb3":
        env = rde.make_sb3(env_id, **kwargs)
        env.seed(0)
        env.reset()
    else:
        env = gym.make_vec(env_id, autoreset_mode=face, **kwargs).unwrapped
        env.reset(seed=0)
    tips = [env.tip]
    for step, action in enumerate(actions(11, 3)):
        env.step(action)
        begun = (step + 1) % (5 if face == "next_step" else 4) == 0
        tips = [env.tip] if begun else [*tips, env.tip]
        for lane in range(3):
            np.testing.assert_array_equal(env._renderer.trail(lane), np.array(tips)[:, lane])
    assert len(env.get_images() if face == "sb3" else env.render()) == 3


def test_a_partial_reset_keeps_the_trails_of_the_others():
    env = gym.make_vec("redundant_envs/FourRReach-v0", num_envs=3, render_mode="rgb_array").unwrapped
    env.reset(seed=0)
    for action in actions(6, 3):
        env.step(action)
    env.reset(options={"reset_mask": np.array([False, True, False])})
    assert [len(env._renderer.trail(lane)) for lane in range(3)] == [7, 1, 7]
    env.step(actions(1, 3)[0])
    assert [len(env._renderer.trail(lane)) for lane in range(3)] == [8, 2, 8]


def test_a_trail_begins_anew_where_a_state_was_set():
    env = gym.make("redundant_envs/FourRReach-v0", render_mode="rgb_array").unwrapped
    env.reset(seed=0)
    for action in actions(9, 1)[:, 0]:
        env.step(action)
    state = env.get_state()
    env.reset(seed=1)
    for action in actions(9, 1)[:, 0]:
        env.step(action)
    env.set_state(state)
    env.render()
    np.testing.assert_allclose(env._renderer.trail(0), [env.tip], atol=1e-12)


def test_a_trail_keeps_the_last_steps():
    env = gym.make("redundant_envs/FourRReach-v0", render_mode="rgb_array", max_episode_steps=-1).unwrapped
    env.reset(seed=0)
    tips = [env.tip]
    for action in np.tile(actions(50, 1)[:, 0], (5, 1)):
        env.step(action * 0.2)
        tips.append(env.tip)
    np.testing.assert_array_equal(env._renderer.trail(0), tips[-TRAIL_LENGTH:])


def test_an_environment_that_does_not_render_remembers_nothing():
    env = gym.make("redundant_envs/FourRReach-v0").unwrapped
    env.reset(seed=0)
    env.step(np.zeros(4, np.float32))
    assert env._renderer is None


def test_a_trail_is_drawn_like_its_segments_one_by_one():
    rng = np.random.default_rng(0)
    for points in (
        np.cumsum(rng.uniform(-0.1, 0.1, (40, 2)), axis=0),
        np.array([[-0.5, 0.0], [0.5, 0.0], [0.5, 0.5], [0.5, 0.5], [0.0, 0.0]]),
        np.array([[-5.0, -4.0], [0.3, 0.2], [0.3, 9.0]]),  # beyond the picture
    ):
        canvas, n = Canvas(1.0), len(points)
        canvas.trail(points, 3.0, TRAIL, faint=0.2, strong=0.9)
        y, x = (np.mgrid[0:480, 0:480] + 0.5).astype(np.float32)
        weight = np.zeros((480, 480))
        places = 240.0 + 240.0 * points * (1.0, -1.0)
        for k, (a, b) in enumerate(itertools.pairwise(places)):
            distance = from_segment(x - a[0], y - a[1], *(b - a))
            strength = 0.2 + 0.7 * (k + 1) / (n - 1)
            weight = np.maximum(weight, np.clip(2.0 - distance, 0.0, 1.0) * strength)
        expected = Canvas(1.0).pixels * (1.0 - weight[..., None]) + np.array(TRAIL) * weight[..., None]
        assert np.abs(canvas.pixels - expected).max() <= 2.0


def test_pictures_are_ones_own():
    env = gym.make("redundant_envs/RPRPReach-v0", render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    kept = first.copy()
    first[:] = 0
    np.testing.assert_array_equal(env.render(), kept)


def written(monkeypatch):
    """Texts written on pictures from now on, as (text, colour)."""
    texts, write = [], Canvas.text

    def text(self, text, x, y, color, *others, **named):
        texts.append((text, color))
        write(self, text, x, y, color, *others, **named)

    monkeypatch.setattr(Canvas, "text", text)
    return texts


def test_the_goal_is_drawn_above_the_arm():
    env = gym.make("redundant_envs/FourRReach-v0", render_mode="rgb_array")
    arm = env.unwrapped.core.scene.robot
    q = np.array([0.4, 0.4, 0.4, 2.0])
    goal = 0.5 * arm.points(q)[2]  # on a link
    env.reset(seed=0, options={"q": q, "goal": goal})
    picture = env.render()
    column, row = (240.0 + 480.0 / 2.24 * goal * (1.0, -1.0)).astype(int)
    assert tuple(picture[row, column]) == GOAL


def test_a_picture_says_the_time_what_the_bars_are_and_how_long_the_goal_was_held(monkeypatch):
    env = gym.make("redundant_envs/FourRReach-v0", render_mode="rgb_array", task={"hold_steps": 3})
    hanging = np.full(4, -np.pi / 2)
    tip = env.unwrapped.core.scene.robot.forward_kinematics(hanging)
    env.reset(seed=0, options={"q": hanging, "qd": np.zeros(4), "goal": 0.95 * tip})
    texts = written(monkeypatch)
    env.render()
    assert [text for text, _ in texts] == [BARS, "1", "2", "3", "4", "time 0.00 s"]
    env.reset(seed=0, options={"q": hanging, "qd": np.zeros(4), "goal": (0.0, -0.99)})
    seen = []
    for _ in range(4):
        env.step(np.zeros(4, np.float32))
        texts.clear()
        env.render()
        seen.append(texts[-1])
    assert [text for text, _ in seen] == ["held 0.02 s", "held 0.04 s", "held 0.06 s", "held 0.08 s"]
    assert [color == GOAL for _, color in seen] == [False, False, True, True]
    assert "time 0.08 s" in [text for text, _ in texts]


def test_letters_are_as_high_as_asked_and_differ():
    shapes = {c: cover(c, 12.0) for c in GLYPHS if c != " "}
    for digit in "0123456789":
        rows = np.flatnonzero(shapes[digit].max(axis=1) > 0.5)
        assert 12 <= rows[-1] - rows[0] + 1 <= 15
    pictures = [(shape.shape, shape.tobytes()) for shape in shapes.values()]
    assert len(set(pictures)) == len(pictures)


def test_a_character_without_a_glyph_is_refused():
    with pytest.raises(ValueError, match="no glyph for '~'"):
        cover("1 ~", 12.0)


def test_record_video_of_gymnasium_writes_an_mp4(tmp_path):
    pytest.importorskip("moviepy", reason="RecordVideo needs the extra 'plot'")
    import imageio_ffmpeg

    env = gym.make("redundant_envs/FourRReach-v0", render_mode="rgb_array", max_episode_steps=10)
    env = gym.wrappers.RecordVideo(
        env, str(tmp_path / "videos"), episode_trigger=lambda episode: episode == 0
    )
    env.reset(seed=0)
    for action in actions(10, 1)[:, 0]:
        *_, truncated, _ = env.step(action)
    assert truncated
    env.close()
    (video,) = tmp_path.glob("videos/*.mp4")
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(video))
    assert frames in (10, 11)  # moviepy rounds the time of the last one
    assert seconds == pytest.approx(frames * 0.02, abs=0.03)


def test_the_extra_plot_has_what_record_video_needs():
    import tomllib
    from pathlib import Path

    root = Path(__file__).parents[2]
    data = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    assert any(d.startswith("moviepy") for d in data["project"]["optional-dependencies"]["plot"])
    pinned = (root / "constraints.txt").read_text(encoding="utf-8").splitlines()
    versions = dict(line.split("==") for line in pinned if "==" in line)
    assert int(versions["pillow"].partition(".")[0]) < 12  # moviepy takes no later one
    assert "moviepy" in versions
