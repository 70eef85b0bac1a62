"""docs/figures/remake.py makes the pictures of the README again, and they are small."""

import importlib.util

import pytest
from markdown import README, ROOT, text

pytest.importorskip("PIL", reason="pictures need the extra 'plot'")


@pytest.fixture
def remake(tmp_path, monkeypatch):
    spec = importlib.util.spec_from_file_location("remake", ROOT / "docs" / "figures" / "remake.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "FIGURES", tmp_path)
    return module


def test_thumbnails_and_results_are_made_again_and_are_small(remake, tmp_path):
    from PIL import Image

    for name, (policy, seed) in list(remake.THUMBNAILS.items())[::2]:
        remake.thumbnail(name, policy, seed)
        with Image.open(tmp_path / f"{name}.png") as made:
            assert made.size == (remake.SIDE, remake.SIDE)
    for path in (ROOT / "docs" / "figures").glob("*reach*"):
        assert path.stat().st_size < (1e6 if path.suffix == ".gif" else 2e4), path.name
    page, lines = tmp_path / "README.md", text(README).splitlines(keepends=True)
    page.write_text("".join(line for line in lines if "| SAC |" not in line), encoding="utf-8")
    remake.results(page)
    assert text(page) == text(README)


@pytest.mark.long
def test_clips_are_made_again(remake, tmp_path):
    remake.clips()
    for name in remake.CLIPS:
        assert 1e5 < (tmp_path / f"{name}.gif").stat().st_size < 1e6
