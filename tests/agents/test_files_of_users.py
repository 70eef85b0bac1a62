"""Commands replace no file of a user unasked, and touch nothing outside of a folder that they are given."""

import shutil
import sys
from pathlib import Path

import pytest
from run_folders import POLICIES, TUNES, kept, main, readers

from redundant_envs import __main__ as library
from studies import environments, intervals, throughput

pytestmark = pytest.mark.usefixtures("no_drawing")

STUDIES = {"throughput": throughput, "environments": environments, "impacts": intervals}


def others(folder, out):
    """Commands that write files into ``out`` which a user may have made, beside those of :func:`readers`."""
    of_library = {
        "simulate": ["simulate", "--scene", "four_r_free", "--seconds", 0.1, "--out", out / "simulate"],
        "verify": ["verify", "--quick", "four_r_reach", "--json", out / "a.json"],
        "drawing": ["scene", "four_r_reach", "--drawing", out / "arm.svg"],
        "wasm": ["wasm", "four_r_reach", "--out", out / "wasm"], "page": ["page", "--out", out / "page"],
        **{form: ["export", "four_r_free", "--format", form, "--out", out / form] for form in ("urdf", "c")},
    }  # fmt: skip
    of_studies = {name: ["study", name, "--out", out / "studies"] for name in STUDIES}
    own = of_studies | {name: words for name, words in readers(folder, out).items() if words[-1] != folder}
    del own["export"], own["stops"]  # of registered environments
    found = {name: (library.main, words) for name, words in of_library.items()}
    return found | {name: (main, words) for name, words in own.items()}


def written(folder):
    return {path for path in folder.rglob("*") if path.is_file()}


@pytest.mark.quick("simulate", "drawing", "urdf", "curves", "table out")
@pytest.mark.parametrize("name", others(Path(), Path()))
def test_a_command_replaces_no_file_of_the_user_unless_forced(name, run, tmp_path, capsys, monkeypatch):
    program, words = others(run, tmp_path / "out")[name]
    words = [*map(str, words)]
    if name in STUDIES:
        monkeypatch.setattr(STUDIES[name], "run", lambda *_: [])  # what it measures
    before = kept(run)
    assert program(words) == 0
    files = written(tmp_path / "out")
    assert files, name
    for path in files:
        for other in files:
            other.unlink(missing_ok=True)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("precious")
        capsys.readouterr()
        assert program(words) == 2, path
        error = capsys.readouterr().err
        assert path.name in error or "plots" in error
        assert "--force" in error
        assert written(tmp_path / "out") == {path}
        assert path.read_text() == "precious"
    assert kept(run) == before
    assert program([*words, "--force"]) == 0
    assert written(tmp_path / "out") == files
    assert all(path.read_bytes() != b"precious" for path in files)


@pytest.mark.parametrize(
    "words", [["study", "policy"], ["study", "strength", "--seeds", "none"], ["tune", "rprp_reach_ppo"]]
)
def test_a_study_does_not_begin_among_other_files(words, tmp_path, refused):
    if words[0] == "tune" and not TUNES:
        pytest.skip("optuna is in the extra 'tune'")
    for name in ("strength.png", "trials.csv", "report.md"):
        (tmp_path / name).write_text("precious")
    refused([*words, "--out", tmp_path], f"out is {tmp_path}, which holds other files and no study")
    assert len([*tmp_path.iterdir()]) == 3
    marks = {"policy": "study.yaml", "strength": "strength.csv", "rprp_reach_ppo": "study.json"}
    mark = tmp_path / marks[words[1]]
    mark.write_text("precious")  # a file of the user that has the name of one of a study
    refused([*words, "--out", tmp_path], mark.name)
    assert mark.read_text() == "precious"


LINKS = ("clip.gif", "plots", "plots/learning_curve.png", "report.md", "policy.zip", "notes/deep/any")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no links without rights")
@pytest.mark.parametrize("name", LINKS)
def test_a_folder_with_links_is_refused_with_their_names(name, run, tmp_path, refused):
    victim = tmp_path / "victim"
    victim.write_text("precious")
    link = run / name
    shutil.rmtree(link) if link.is_dir() else link.unlink(missing_ok=True)
    link.parent.mkdir(parents=True, exist_ok=True)
    link.symlink_to(victim if name != "report.md" else tmp_path / "nowhere")
    given = readers(run, tmp_path / "out").values() if name == "policy.zip" else [["report", run, "--force"]]
    for words in (*given, ["resume", run], ["train", "rprp_reach_ppo", "--seeds", "0", "--out", run.parent]):
        refused(words, f"{name} (a link)")
    refused(["evaluate", POLICIES / "RPRPReach-v0-ppo", "--out", run, "--force"], f"{name} (a link)")
    assert victim.read_text() == "precious"
    assert not (tmp_path / "nowhere").exists()
    assert not (tmp_path / "out").exists()
