"""Ways among discs: straight ones, those of a road map, and none where there is none."""

import numpy as np

import redundant_envs as rde
from redundant_envs.control.clearance import clearance
from redundant_envs.control.nominal import NominalModel
from redundant_envs.control.road_map import is_free, road
from redundant_envs.control.ways import MARGINS, smooth_ways, ways_to

MODEL = NominalModel(rde.load_scene("four_r_around"))
START = np.array([-np.pi / 2, 0.0, 0.0, 0.0])  # it hangs
RIGHT, LEFT = np.array([0.0, 0.3, 0.0, 0.0]), np.array([-np.pi, -0.3, 0.0, 0.0])
IN_THE_WAY = np.array([[0.55, -0.55, 0.1]])  # between hanging and RIGHT
RING = np.array([[0.3 * np.cos(a), 0.3 * np.sin(a), 0.1] for a in (-1.2, -0.8, -0.4, -1.9, -2.4)])


def test_a_line_through_a_disc_is_not_free():
    a, b = np.stack([START, START]), np.stack([RIGHT, LEFT])
    assert is_free(MODEL, a, b, IN_THE_WAY, 0.01).tolist() == [False, True]
    assert is_free(MODEL, a, b, np.stack([IN_THE_WAY - [0, 2, 0], IN_THE_WAY]), 0.01).all()


def test_a_road_goes_around_a_disc_and_is_none_where_discs_enclose_the_arm():
    way = road(MODEL, START, RIGHT[None], IN_THE_WAY, 0.01, 150)
    np.testing.assert_allclose(way[[0, -1]], [START, RIGHT])
    lines = way[:-1, None] + np.linspace(0, 1, 50)[:, None] * np.diff(way, axis=0)[:, None]
    assert clearance(MODEL, lines, IN_THE_WAY).min() > 0.005
    assert road(MODEL, START, RIGHT[None], RING, 0.01, 150) is None


def test_ways_are_straight_where_that_is_free_and_go_to_the_cheapest_pose():
    poses = np.stack([[RIGHT, LEFT], [LEFT, RIGHT], [RIGHT, LEFT], [RIGHT, RIGHT]])
    costs = np.array([[1.0, 2.0], [1.0, 2.0], [1.0, np.inf], [1.0, np.inf]])
    most = max(map(len, (IN_THE_WAY, RING)))
    discs = np.stack([np.resize(d, (most, 3)) for d in (IN_THE_WAY, IN_THE_WAY, IN_THE_WAY, RING)])
    start = np.tile(START, (4, 1))
    ways = ways_to(MODEL, start, poses, costs, discs)
    np.testing.assert_array_equal([way[-1] for way in ways], [LEFT, LEFT, RIGHT, RIGHT])
    assert [len(way) for way in ways[:2]] == [2, 2]
    assert len(ways[2]) > 2
    assert len(ways[3]) == 2  # none is free
    smooth = smooth_ways(MODEL, ways, discs)
    assert (clearance(MODEL, smooth, discs[:, None]).min(axis=1)[:3] > 0.5 * MARGINS[1]).all()
    turns = np.abs(np.diff(smooth, 2, axis=1)).max(axis=(1, 2))
    assert turns[2] < 0.02
