"""Small files that would fill the memory, and files that are none, end a command with one line of error."""

import io
import os
import shutil
import tracemalloc
import zipfile

import numpy as np
import pytest
from run_folders import POLICIES, TUNES, members, write_members, write_run

from redundant_envs_train import run_folder
from redundant_envs_train.shipping.layers import Layers

POLICY = POLICIES / "RPRPReach-v0-ppo"
MIB = 1 << 20


@pytest.fixture
def lean(refused):
    """Run a command that is refused, and takes little memory for it."""

    def check(words, *parts):
        tracemalloc.start()
        try:
            refused(words, *parts)
            assert tracemalloc.get_traced_memory()[1] < 100e6
        finally:
            tracemalloc.stop()

    return check


def sparse(path):
    with path.open("wb") as file:
        file.truncate(2 << 30)


def bomb(path, kind, mebibytes):
    """Give a policy.zip a member of spaces."""
    there = members(path)
    with zipfile.ZipFile(path, "w", kind, compresslevel=1) as archive:
        archive.writestr("policy.pth", there["policy.pth"])
        with archive.open("data", "w", force_zip64=True) as member:
            for _ in range(mebibytes):
                member.write(b" " * MIB)


def of_tensors(path, change):
    """Change the members of policy.pth."""
    memory = io.BytesIO()
    write_members(memory, change(members(io.BytesIO(members(path)["policy.pth"]))), zipfile.ZIP_DEFLATED)
    write_members(path, members(path) | {"policy.pth": memory.getvalue()})


def lists(parts):
    return {k: b"\x80\x02(" + b"]" * 2 * MIB if k.endswith("data.pkl") else v for k, v in parts.items()}


BOMBS = {
    "bzip2": (lambda p: bomb(p, zipfile.ZIP_BZIP2, 2), "neither stored nor deflated"),
    "deflated": (lambda p: bomb(p, zipfile.ZIP_DEFLATED, 160), "67108864"),
    "sparse": (sparse, "has 2147483648 bytes, more than the 268435456"),
    "tensors": (lambda p: of_tensors(p, lambda parts: parts | {"archive/9": bytes(70 * MIB)}), "67108864"),
    "lists": (lambda p: of_tensors(p, lists), "data.pkl"),
}


@pytest.mark.parametrize(("write", "words"), BOMBS.values(), ids=BOMBS)
def test_a_policy_that_would_fill_the_memory(write, words, tmp_path, lean):
    policy = shutil.copytree(POLICY, tmp_path / "given")
    write(policy / "policy.zip")
    lean(["evaluate", policy], str(policy / "policy.zip"), words)


def test_json_and_tables_that_would_fill_the_memory(tmp_path, lean, monkeypatch):
    monkeypatch.setattr(run_folder, "MAX_EPISODES", 10_000)
    evaluation, selection = ((write_run(tmp_path / n) / n) for n in ("evaluation.json", "selection.csv"))
    rows, head = tmp_path / "runs.jsonl", selection.read_text().splitlines()[0]
    for path, text in (
        (evaluation, "[" * 100_000), (evaluation, '{"seed": ' + "9" * 500_000 + "}"),
        (evaluation, "[" + "[]," * MIB + "[]]"), (selection, f"{head}\n" + ",".join("1" * 2 * MIB)),
        (selection, "\n".join([head, *(["1,1,1,1,1"] * 10_001)])),
        (rows, "[" * 4 * MIB), (rows, "[" * MIB), (rows, "{}\n" * 9 * MIB),
    ):  # fmt: skip
        path.write_text(text)
        lean(["table", path if path is rows else path.parent], path.name)
    journal = tmp_path / "a.journal"
    tune = ["tune", "rprp_reach_ppo", "--out", tmp_path / "study", "--storage", journal]
    for words, path, most in (
        (["table", evaluation.parent], evaluation, 1048576), (["table", rows], rows, 16777216),
        (["curves", selection.parent], selection, ""), *([(tune, journal, 67108864)] if TUNES else []),
    ):  # fmt: skip
        sparse(path)
        lean(words, f"{path.name} has 2147483648 bytes, more than the {most}")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes here")
def test_a_pipe_is_not_waited_for(tmp_path, lean, monkeypatch):
    monkeypatch.chdir(tmp_path)  # long paths are shortened in messages
    os.mkfifo("pipe")
    lean(["train", "pipe"], "'pipe'", "a pipe")
    lean(["train", "rprp_reach_ppo", "start_from=pipe"], "'pipe'")
    for name in ("config.yaml", "scene.yaml", "evaluation.json", "selection.csv", "training.json"):
        run = write_run(tmp_path / f"of_{name}")
        (run / name).unlink(missing_ok=True)
        os.mkfifo(run / name)
        lean(["table", run], name)


def test_arrays_that_claim_more_than_they_have(tmp_path):
    folder, head = shutil.copytree(POLICY, tmp_path / "RPRPReach-v0-sac"), io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    claim = head.getvalue()
    for data, words in (
        (claim, "claims 1000000000000 values"), (bytes(70 * MIB), "67108864"), (b"", "damaged"),
        (claim.replace(b"'<f8'", b"'|O8'"), "numbers and texts"), (claim.replace(b"(1", b"(-1"), "damaged"),
    ):  # fmt: skip
        write_members(folder / "policy.npz", members(POLICY / "policy.npz") | {"weights_0.npy": data})
        with pytest.raises(ValueError, match=words):
            Layers.load(folder / "policy.npz")
    sparse(folder / "policy.npz")
    with pytest.raises(ValueError, match="has 2147483648 bytes, more than the 67108864"):
        Layers.load(folder / "policy.npz")
