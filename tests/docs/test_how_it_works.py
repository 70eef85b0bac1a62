"""docs/how_it_works.md is in step with the code: its drawing, its length, and the way of one number."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "redundant_envs"
PAGE = (ROOT / "docs" / "how_it_works.md").read_text(encoding="utf-8")
MOST_WORDS, MOST_FILES = 1200, 40
NOT_DRAWN = {"configs": "presets", "studies": "our own measurements, not in the wheel"}
EXCUSED = {
    "__init__.py": "imports on demand",
    "algebra.py": "arithmetic of numbers of any kind",
    "backends/numpy.py": "numbers that follow from parameters, as arrays",
    "batch/environment.py": "no environment is made here",
    "dialect.py": "checks the text of functions, not their numbers",
    "dual.py": "derivatives",
    "effects/captured.py": "effects of users alone",
    "effects/effort_limits.py": "another effect",
    "effects/gravity.py": "another effect",
    "extras.py": "imports on demand",
    "lane/boundaries.py": "the scene has no boundary",
    "lane/features.py": "what the scene has",
    "lane/interval.py": "puts the parts of an interval together",
    "lane/kinks.py": "asks which quantities move; the damping does not",
    "lane/program.py": "decides on times and errors alone",
    "lane/step_control.py": "decides on times and errors alone",
    "loaded_arm.py": "masses of effects",
    "model/copies.py": "no simulator is copied",
    "model/snapshot.py": "no state is saved",
    "model/team.py": "threads",
    "moving.py": "asks which quantities move; the damping does not",
    "numerics/error_control.py": "decides on times and errors alone",
    "numerics/tableaus.py": "weights of the method",
    "progress.py": "a line for the user",
    "quantities.py": "looks quantities up by name",
    "robots/arm.py": "the arm, which knows no effect",
    "robots/checks.py": "the arm, which knows no effect",
    "robots/four_r.py": "the arm, which knows no effect",
    "robots/joint_types.py": "the arm, which knows no effect",
    "tracing/program.py": "decides on times and errors alone",
    "tracing/ways.py": "decides on times and errors alone",
    "values.py": "checks of other numbers",
}
WALK = """
import os, sys
import numpy as np
import redundant_envs as rde

rde.BatchSimulator(rde.load_scene("four_r_free"), 8)  # all modules are imported then
root, ran = os.path.dirname(rde.__file__), set()

def profile(frame, event, argument):
    code = frame.f_code
    if event == "call" and code.co_filename.startswith(root) and code.co_name != "<module>":
        ran.add((os.path.relpath(code.co_filename, root), code.co_qualname))

sys.setprofile(profile)
simulator = rde.BatchSimulator(rde.load_scene("four_r_reach"), 8)
simulator.advance(np.zeros((8, 4)))
sys.setprofile(None)
for file, function in sorted(ran):
    print(file.replace(os.sep, "/"), function)
"""


def listed() -> dict[str, str]:
    """Files of the way, and the function in each."""
    block = PAGE[PAGE.index("## The way of one number") :].split("```")[1]
    return dict(re.findall(r"(\S+\.py): (\S+)", block))


@pytest.fixture(scope="module")
def ran(tmp_path_factory) -> set[tuple[str, str]]:
    """Functions that ran between ``load_scene`` and the first step, with an empty cache."""
    cache = str(tmp_path_factory.mktemp("cache"))
    found = subprocess.run(
        [sys.executable, "-c", WALK], check=True, capture_output=True, text=True,
        env={**os.environ, "REDUNDANT_ENVS_CACHE": cache},
    )  # fmt: skip
    return {tuple(line.split(" ", 1)) for line in found.stdout.splitlines()}


def test_the_page_is_short():
    assert len(PAGE.split()) <= MOST_WORDS


def test_the_drawing_has_every_folder_of_the_package_and_no_other():
    drawing = PAGE.split("```mermaid")[1].split("```")[0]
    drawn = set(re.findall(r"(\w+)/", drawing))
    folders = {p.name for p in PACKAGE.iterdir() if (p / "__init__.py").exists()}
    assert drawn == folders - set(NOT_DRAWN)


def test_every_file_that_the_page_names_is_there():
    named = {n for n in re.findall(r"`([\w/]+\.py)`", PAGE) if not n.startswith("tests/")}
    assert {n for n in named if not (PACKAGE / n).exists()} == set()


def test_the_way_of_a_number_has_the_functions_that_run(ran):
    way = listed()
    assert len(way) <= MOST_FILES
    assert {(file, function) for file, function in way.items() if (file, function) not in ran} == set()


def test_no_module_runs_that_is_neither_on_the_way_nor_excused(ran):
    assert {file for file, _ in ran} - {*listed(), *EXCUSED} == set()
