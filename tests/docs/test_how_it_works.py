"""docs/how_it_works.md is in step with the code: its drawing, and the way of one number."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from redundant_envs.compiler.backends import llvm

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "redundant_envs"
PAGE = (ROOT / "docs" / "how_it_works.md").read_text(encoding="utf-8")
NOT_DRAWN = {"configs": "presets"}
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
    if not llvm.processor().wide:
        del way["tracing/passes/order.py"]  # narrower vectors have LLVM's order of instructions
    assert {(file, function) for file, function in way.items() if (file, function) not in ran} == set()
