"""docs/how_it_works.md is in step with the code: its drawing, its length, and the way of one number."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from redundant_envs.backends import llvm

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "redundant_envs"
PAGE = (ROOT / "docs" / "how_it_works.md").read_text(encoding="utf-8")
MOST_WORDS, MOST_FILES = 1200, 40
NOT_DRAWN = {"configs": "presets"}
EXCUSED = {
    "imports on demand": "__init__ extras",
    "arithmetic of numbers of any kind": "algebra",
    "numbers that follow from parameters, as arrays": "backends/numpy",
    "no environment is made here": "batch/environment",
    "checks the text of functions, not their numbers": "dialect",
    "derivatives": "dual",
    "other effects": "effects/captured effects/effort_limits effects/gravity",
    "the scene has no boundary": "lane/boundaries lane/guards lane/scene_boundaries",
    "the scene has no instant": "lane/pieces",
    "the scene has no impulse, and its masses stay": "lane/jumps",
    "the scene has no range": "ranges scene_numbers",
    "what the scene has": "lane/features",
    "puts the parts of an interval together": "lane/interval",
    "names the processor": "backends/processors",
    "LLVM itself, from text to machine code": "backends/llvm_text",
    "whether an earlier process has made the code": "backends/loaded",
    "reads files of others within bounds": "bounded",
    "asks which quantities move; the damping does not": "lane/kinks moving",
    "looks quantities up by name": "quantities",
    "decides on times": "lane/program lane/step_control numerics/error_control tracing/program tracing/ways",
    "weights of the method": "numerics/tableaus",
    "a line for the user": "progress",
    "the arm, which knows no effect": "robots/arm robots/checks robots/four_r robots/joint_types",
}
"""Modules that are not on the way, by the reason."""
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


@pytest.mark.long
def test_the_way_of_a_number_has_the_functions_that_run(ran):
    way = listed()
    assert len(way) <= MOST_FILES
    if not llvm.processor().wide:
        del way["tracing/passes/order.py"]  # narrower vectors have LLVM's order of instructions
    assert {(file, function) for file, function in way.items() if (file, function) not in ran} == set()


@pytest.mark.long
def test_no_module_runs_that_is_neither_on_the_way_nor_excused(ran):
    excused = {f"{module}.py" for modules in EXCUSED.values() for module in modules.split()}
    assert {file for file, _ in ran} - {*listed()} - excused == set()
