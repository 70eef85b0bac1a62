"""Moving pictures of trajectories: files, notebooks, arms of all kinds, and what cannot be drawn."""

import base64
import dataclasses
import sys
from pathlib import Path

import imageio.v2 as imageio
import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.model.trajectory import Trajectory
from redundant_envs.robots import RPRP

sys.path.insert(0, str(Path(__file__).parents[1] / "outside"))
from arms import ARMS


@physics(gives="x1 y1")
def hanging(l1, l2, s1, c1, s2, c2):
    return l1 * c1 + l2 * c2, l1 * s1 + l2 * s2


SCENE = rde.Scene(ARMS["4R"], control_dt=0.02)
TIMES = np.linspace(0.0, 0.4, 21)


@pytest.fixture(scope="module")
def motion():
    return rde.simulate(SCENE, np.full(4, 0.3), np.ones(4), TIMES)


def still(arm, shape=(), effects=()):
    """A trajectory of an arm that does not move, without a simulation."""
    n = len(arm.joints)
    q, zero = np.full((3, *shape, n), 0.2), np.zeros((3, *shape))
    t = np.array([0.0, 0.1, 0.2])
    return Trajectory(t, q, 0 * q, zero, zero, zero, 0 * q, rde.Scene(arm, effects))


def test_a_gif_shows_the_motion_in_real_time(motion, tmp_path):
    path = rde.animate(motion).save(str(tmp_path / "sub" / "clip.gif"))
    assert path == tmp_path / "sub" / "clip.gif"
    frames = [np.asarray(frame)[..., :3].astype(int) for frame in imageio.mimread(path)]
    assert len(frames) == 11  # 0.4 s and the end, 25 a second
    assert frames[0].shape == (480, 480, 3)
    assert np.abs(frames[0] - frames[-1]).mean() > 1.0
    assert path.stat().st_size < 500_000


def test_an_mp4_has_as_many_frames(motion, tmp_path):
    path = rde.animate(motion).save(tmp_path / "clip.mp4")
    frames, seconds = pytest.importorskip("imageio_ffmpeg").count_frames_and_secs(str(path))
    assert (frames, seconds) == (11, pytest.approx(0.44))
    assert path.stat().st_size < 100_000


def test_a_notebook_shows_a_video_in_its_page(motion):
    pytest.importorskip("imageio_ffmpeg")
    html = rde.animate(motion)._repr_html_()
    data = html.partition("base64,")[2].partition('"')[0]
    assert html.startswith("<video controls")
    assert b"ftyp" in base64.b64decode(data)[:16]
    assert len(html) < 300_000


@pytest.mark.parametrize("name", ARMS)
def test_arms_from_outside_are_drawn_too(name):
    frame = rde.animate(still(ARMS[name])).frame(-1)
    assert frame.shape == (480, 480, 3)
    assert len(np.unique(frame.reshape(-1, 3), axis=0)) > 10


def test_frames_show_time_way_and_efforts(motion):
    moving = rde.animate(motion)
    first, last = moving.frame(0), moving.frame(-1)
    assert (first != last).any(axis=2)[:40].any()  # the time, at the top
    limited = still(RPRP((1,) * 4, (1, 1)), effects=(rde.effects.EffortLimits(2.0),))
    none = rde.animate(limited).frame(0)
    limited.efforts[0, 1] = -2.0
    (rows, columns) = (none != rde.animate(limited).frame(0)).any(axis=2).nonzero()
    assert rows.min() > 380
    assert columns.max() < 140  # the second bar, in the lower left corner


def test_one_motion_of_a_batch_is_chosen():
    trajectory = still(ARMS["3R"], (2, 3))
    trajectory.q[:, 1, 2] = 1.0
    one, other = (rde.animate(trajectory, index=k).frame(0) for k in ((0, 0), (1, 2)))
    assert (one != other).any()
    np.testing.assert_array_equal(other, rde.animate(trajectory, index=(-1, -1)).frame(0))
    single = still(ARMS["3R"], (2,))
    assert rde.animate(single, index=np.int64(1)).frame(0).shape == (480, 480, 3)


WRONG_INDEX = [((), 0), ((2,), None), ((2,), 2), ((2,), (0, 0)), ((2, 3), 1), ((2,), True), ((2,), "last")]


@pytest.mark.parametrize(("shape", "index"), WRONG_INDEX)
def test_an_index_that_chooses_no_motion_is_refused(shape, index):
    with pytest.raises(ValueError, match=r"^index is .* and trajectory has .*; (give index|leave)") as error:
        rde.animate(still(ARMS["3R"], shape), index=index)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize("name", ["clip.avi", "clip", "clip.gif.txt"])
def test_an_unknown_ending_is_refused_before_anything_is_drawn(name, motion, tmp_path):
    with pytest.raises(ValueError, match=r"end its name in \.gif or \.mp4"):
        rde.animate(motion).save(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_what_cannot_be_drawn_is_refused(motion):
    with pytest.raises(ValueError, match=r"trajectory is 3; give what redundant_envs\.simulate returns"):
        rde.animate(3)
    with pytest.raises(ValueError, match="trajectory has no times"):
        rde.animate(dataclasses.replace(motion, t=motion.t[:0], q=motion.q[:0]))


def test_an_arm_without_a_point_mass_for_each_joint_is_refused():
    class Hoist(rde.Arm):
        joint_types = "RR"
        num_masses = 1
        functions = (hanging,)

    with pytest.raises(ValueError, match=r"^Hoist has 1 point masses and 2 joints; arms are drawn with"):
        rde.animate(still(Hoist((1.0,), (1.0, 1.0))))


def test_it_says_what_it_is(motion):
    assert repr(rde.animate(motion)) == (
        "<Animation of FourR, 0.4 s; save('file.gif') or save('file.mp4') writes it>"
    )
