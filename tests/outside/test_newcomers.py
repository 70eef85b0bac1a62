"""A newcomer's mistakes are explained in words; correct input works from the command line, too."""

import re
import sys
from pathlib import Path

import pytest

from redundant_envs import effects
from redundant_envs.__main__ import main
from redundant_envs.support import modules

PAGE = (Path(__file__).parents[2] / "docs/extending.md").read_text(encoding="utf-8")
MODULE = next(x for x in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL) if "QuadraticDrag" in x)
SCENE = """
robot: {type: FourR, masses: [0.5, 0.5, 0.5, 0.5], lengths: [0.25, 0.25, 0.25, 0.25]}
effects:
  - {type: Gravity}
  - {type: QuadraticDrag, coefficients: 0.1}
"""


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A folder with an effect and a scene, in which commands run as if each were the first of a process."""
    (tmp_path / "my_effects.py").write_text(MODULE, encoding="utf-8")
    (tmp_path / "half.py").write_text("import missing_package\n", encoding="utf-8")
    (tmp_path / "my_scene.yaml").write_text(SCENE, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setattr(modules, "IMPORTED", [])
    yield
    sys.modules.pop("my_effects", None)
    effects.REGISTRY.pop("QuadraticDrag", None)


@pytest.mark.long
def test_the_command_line_knows_what_an_imported_module_registers(capsys):
    assert main(["--import", "my_effects", "verify", "--quick", "my_scene.yaml", "--states", "32"]) == 0
    assert "my_scene.yaml" in capsys.readouterr().out
    assert main(["--import=my_effects", "scene", "my_scene.yaml", "--bill"]) == 0
    assert "quadratic_drag" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("scene my_scene.yaml", "type is 'QuadraticDrag'.*--import MODULE before the command"),
        ("verify half:thing", "half:thing: No module named 'missing_package'"),
        ("verify not_there:thing", "No module named 'not_there'; give modules that lie in this folder"),
        ("--import not_there list", "--import is 'not_there': No module named 'not_there'; give"),
        ("--import", "--import names no module; give --import MODULE before the command"),
    ],
)
def test_without_the_import_it_says_what_is_missing(words, said, capsys):
    assert main(words.split()) == 2
    assert re.search(said, capsys.readouterr().err)
