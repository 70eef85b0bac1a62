"""Small files that would fill the memory, and files that are none, end a command with one line of error."""

import io
import os
import shutil
import tracemalloc
import zipfile

import numpy as np
import pytest
from run_folders import POLICIES, TUNES, members, write_members, write_run

from redundant_envs.__main__ import main
from redundant_envs_train import run_folder
from redundant_envs_train.shipping.layers import Layers

POLICY = POLICIES / "RPRPReach-v0-ppo"
MOST = 100e6
"""Bytes that a refusal may take."""
MIB = 1 << 20


@pytest.fixture
def lean(refused):
    """Run a command that is refused, and takes little memory for it."""

    def check(words, *parts):
        tracemalloc.start()
        try:
            refused(words, *parts)
            assert tracemalloc.get_traced_memory()[1] < MOST
        finally:
            tracemalloc.stop()

    return check


@pytest.fixture
def policy(tmp_path):
    """A copy of a shipped policy."""
    return shutil.copytree(POLICY, tmp_path / "given")


def sparse(path, size=2 << 30):
    with path.open("wb") as file:
        file.truncate(size)


def bomb(path, name, kind, size=160 * MIB, level=1):
    """A policy.zip with a member of spaces."""
    there = members(path)
    with zipfile.ZipFile(path, "w", kind, compresslevel=level) as archive:
        for other, data in there.items():
            if other != name:
                archive.writestr(other, data)
        with archive.open(name, "w", force_zip64=True) as member:
            for _ in range(size // MIB):
                member.write(b" " * MIB)


def beyond_its_size(path):
    """A member that says it has 100 bytes, and unpacks to more."""
    bomb(path, "data", zipfile.ZIP_DEFLATED)
    data = bytearray(path.read_bytes())
    for at in range(data.count(b"PK\x01\x02")):
        start = -1
        for _ in range(at + 1):
            start = data.index(b"PK\x01\x02", start + 1)
        if data[start + 46 : start + 50] == b"data":
            data[start + 24 : start + 28] = (100).to_bytes(4, "little")
    path.write_bytes(data)


def of_no_text(path):
    """The last member's name is no UTF-8, as which it is marked."""
    data = bytearray(path.read_bytes())
    start = data.rindex(b"PK\x01\x02")
    data[start + 9] |= 8
    data[start + 46 : start + 48] = b"\xff\xfe"
    path.write_bytes(data)


def far_away(path):
    """A member that is read begins after 2^64 - 1 bytes."""
    data = bytearray(path.read_bytes())
    name, end = data.rindex(b"data", data.index(b"PK\x01\x02")), data.rindex(b"PK\x05\x06")
    assert data[name - 46 : name - 42] == b"PK\x01\x02"
    data[name - 16 : name - 14], data[name - 4 : name] = (12).to_bytes(2, "little"), b"\xff" * 4
    size = int.from_bytes(data[end + 12 : end + 16], "little") + 12
    data[end + 12 : end + 16] = size.to_bytes(4, "little")
    data[name + 4 : name + 4] = b"\1\0\x08\0" + b"\xff" * 8
    path.write_bytes(data)


def inner(path, change):
    """policy.pth with other members."""
    memory = io.BytesIO()
    write_members(memory, change(members(io.BytesIO(members(path)["policy.pth"]))), zipfile.ZIP_DEFLATED)
    write_members(path, members(path) | {"policy.pth": memory.getvalue()})


def table(parts, data):
    return {k: data if k.endswith("data.pkl") else v for k, v in parts.items()}


@pytest.mark.parametrize(
    ("write", "words"),
    {
        "bzip2": (lambda p: bomb(p, "data", zipfile.ZIP_BZIP2, 2 * MIB), "neither stored nor deflated"),
        "lzma": (lambda p: bomb(p, "policy.pth", zipfile.ZIP_LZMA, 2 * MIB), "neither stored nor deflated"),
        "deflated": (lambda p: bomb(p, "data", zipfile.ZIP_DEFLATED), "67108864"),
        "beyond its size": (beyond_its_size, "damaged"), "of no text": (of_no_text, "damaged"),
        "far away": (far_away, "damaged"),
        "sparse": (sparse, "has 2147483648 bytes, more than the 268435456"),
        "many members": (
            lambda p: write_members(p, members(p) | {f"{k}": b"" for k in range(5000)}), "1000 members",
        ),
        "deflated tensors": (
            lambda p: inner(p, lambda parts: parts | {"archive/data/99": bytes(70 * MIB)}), "67108864",
        ),
        "lists": (lambda p: inner(p, lambda parts: table(parts, b"\x80\x02(" + b"]" * 2 * MIB)), "data.pkl"),
    }.values(),
    ids=lambda value: value if isinstance(value, str) else "",
)  # fmt: skip
def test_a_policy_that_would_fill_the_memory(write, words, policy, lean):
    write(policy / "policy.zip")
    lean(["evaluate", policy], str(policy / "policy.zip"), words)


def test_json_and_tables_that_would_fill_the_memory(tmp_path, lean, monkeypatch):
    monkeypatch.setattr(run_folder, "MAX_EPISODES", 10_000)
    run = write_run(tmp_path / "run")
    kept = (run / "evaluation.json").read_bytes()
    for text in ("[" * 100_000, '{"seed": ' + "9" * 500_000 + "}", "[" + "[]," * MIB + "[]]"):
        (run / "evaluation.json").write_text(text)
        lean(["table", run], "evaluation.json")
    sparse(run / "evaluation.json")
    lean(["table", run], "evaluation.json has 2147483648 bytes, more than the 1048576")
    (run / "evaluation.json").write_bytes(kept)
    sparse(run / "training.json")
    lean(["table", run], "training.json", "more than the 1048576")
    (run / "training.json").unlink()
    lines = (run / "selection.csv").read_text().splitlines()
    wide, long = ",".join("1" * 2 * MIB), "\n".join([lines[0], *(["1,1,1,1,1"] * 10_001)])
    for text, words in (
        (f"{lines[0]}\n{wide}", "more than"),
        (long, "10000 rows"),
        ("\n".join([*lines, "1"]), "columns"),
    ):
        (run / "selection.csv").write_text(text)
        lean(["table", run], "selection.csv", words)
    sparse(run / "selection.csv")
    lean(["curves", run], "selection.csv has 2147483648 bytes")
    rows = tmp_path / "runs.jsonl"
    for text in ("[" * 4 * MIB, "[" * MIB, "{}\n" * 9 * MIB):
        rows.write_text(text)
        lean(["table", rows], str(rows))
    sparse(rows)
    lean(["table", rows], f"{rows} has 2147483648 bytes, more than the 16777216")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes here")
def test_a_pipe_is_not_waited_for(tmp_path, policy, lean, monkeypatch):
    monkeypatch.chdir(tmp_path)  # long paths are shortened in messages
    os.mkfifo("pipe")
    run = write_run(tmp_path / "run")
    lean(["train", "pipe"], "'pipe'", "a pipe")
    lean(["train", "rprp_reach_ppo", "start_from=pipe"], "'pipe'")
    for name, words in (
        ("config.yaml", ["table", run]), ("scene.yaml", ["table", run]), ("evaluation.json", ["table", run]),
        ("selection.csv", ["table", run]), ("policy.zip", ["evaluate", policy]),
    ):  # fmt: skip
        os.replace(words[1] / name, tmp_path / "kept")
        os.mkfifo(words[1] / name)
        lean(words, name)
        os.replace(tmp_path / "kept", words[1] / name)
    out = tmp_path / "study"
    out.mkdir()
    os.mkfifo(out / "study.journal")
    if TUNES:
        lean(["tune", "rprp_reach_ppo", "--out", out], "study")


@pytest.mark.skipif(not TUNES, reason="optuna is in the extra 'tune'")
def test_a_journal_that_would_fill_the_memory(tmp_path, lean):
    sparse(tmp_path / "study.journal")
    lean(
        ["tune", "rprp_reach_ppo", "--out", tmp_path],
        "study.journal has 2147483648 bytes, more than the 67108864",
    )


def test_arrays_that_claim_more_than_they_have(tmp_path, call):
    folder, head = shutil.copytree(POLICY, tmp_path / "RPRPReach-v0-sac"), io.BytesIO()
    described = {"descr": "<f8", "fortran_order": False, "shape": (10**12,)}
    np.lib.format.write_array_header_1_0(head, described)
    claim = head.getvalue()
    for data, words in (
        (claim, "claims 1000000000000 values"), (bytes(70 * MIB), "67108864"), (b"", "damaged"),
        (claim.replace(b"'<f8'", b"'|O8'"), "numbers and texts"), (claim.replace(b"(1", b"(-1"), "damaged"),
    ):  # fmt: skip
        write_members(folder / "policy.npz", members(POLICY / "policy.npz") | {"weights_0.npy": data})
        with pytest.raises(ValueError, match=words):
            Layers.load(folder / "policy.npz")
    assert main(["page", "--policies", str(tmp_path), "--out", str(tmp_path / "page")]) == 2
    sparse(folder / "policy.npz")
    with pytest.raises(ValueError, match="has 2147483648 bytes, more than the 67108864"):
        Layers.load(folder / "policy.npz")
