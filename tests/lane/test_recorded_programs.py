"""The program of each scene is the recorded one: a refactoring changes none."""

import pytest

from tests.lane import programs


@pytest.mark.quick("together: wall friction 1e-6", "together: stops delays substeps", "config rprp_reach")
@pytest.mark.parametrize("name", programs.SCENES)
def test_a_scene_has_the_programs_that_were_recorded(name):
    assert programs.digests(programs.SCENES[name]) == programs.recorded()[name]


def test_every_scene_is_recorded():
    assert list(programs.recorded()) == list(programs.SCENES)
