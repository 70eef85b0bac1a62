"""Several seeds on a Ray cluster of two machines, which share no run folder."""

import contextlib
import io
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import pytest
from run_folders import REFUSALS, ROOT, kept, says, write_members
from short_trainings import TINY, assert_same_policy

from redundant_envs_train.config import load
from redundant_envs_train.training.train import train

pytest.importorskip("ray", reason="ray is not installed; pip install '.[ray]'")

import ray
from ray.cluster_utils import Cluster

from redundant_envs_train.training import on_ray

pytestmark = pytest.mark.long

COMMAND = ["train", "rprp_reach_ppo", *TINY, "--on", "ray"]


@pytest.mark.parametrize(("more", "word"), REFUSALS["ray"])
def test_the_place_of_the_runs_is_checked_before_anything_begins(more, word, tmp_path, refused):
    refused([*COMMAND, "--seeds", "1", *more, "--out", tmp_path / "out"], word)
    assert not (tmp_path / "out").exists()


@pytest.fixture(scope="module")
def disk(tmp_path_factory):
    """The disk of the workers; this program's is another folder."""
    return tmp_path_factory.mktemp("disk")


@pytest.fixture(scope="module")
def cluster(disk):
    """A connection to a cluster of two machines with a core each, whose reports have no pictures."""
    root = str(ROOT)

    def prepare():
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # as in a job script or a container
        sys.path.insert(0, root)  # Ray would add it later
        from redundant_envs_train import report

        report.clip, report.draw_curves = (lambda *given, **more: None), (lambda *given: None)
        tempfile.tempdir = str(disk)

    ray.cloudpickle.register_pickle_by_value(sys.modules[__name__])
    two = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    try:
        two.add_node(num_cpus=1)
        hook = {"worker_process_setup_hook": prepare}
        ray.init(two.address, log_to_driver=False, logging_level="ERROR", runtime_env=hook)
        yield
    finally:
        ray.shutdown()
        two.shutdown()


def test_seeds_on_a_cluster_are_the_runs_they_are_alone(cluster, disk, tmp_path, call, refused):
    out = tmp_path / "runs"
    (out / "seed5").mkdir(parents=True)
    (out / "seed5" / "mine").touch()
    command = [*COMMAND, "--out", out, "--seeds"]
    refused([*command, "3..5"], "1 of 3 runs failed; the same command goes on: seed5: run folder")
    train(load("rprp_reach_ppo", [*TINY, "seed=4"]), tmp_path / "alone")
    assert_same_policy(tmp_path / "alone", out / "seed4")
    text = (out / "seed4" / "report.md").read_text()
    assert f"train {out}/seed4/config.yaml" in text  # its folder here, not on the machine of the task
    assert str(disk) not in text
    assert sorted(path.name for path in out.iterdir()) == ["seed3", "seed4", "seed5"]
    assert not list(disk.glob("redundant-envs-*"))
    # seed4 is finished and stays; of seed3 only the report is missing, and no more is made
    before, facts = kept(out / "seed4"), (out / "seed3" / "training.json").read_bytes()
    (out / "seed3" / "report.md").unlink()
    assert "| RPRPReach-v0 | PPO | 2 |" in call(*command, "3,4")[0]
    assert kept(out / "seed4") == before
    assert (out / "seed3" / "training.json").read_bytes() == facts
    assert (out / "seed3" / "report.md").is_file()
    refused([*command, "3", "ppo.gamma=0.5"], "another configuration")


def kill_tasks(run):
    """Kill the processes of tasks as soon as a checkpoint of a run has come home."""
    end = time.monotonic() + 200.0
    while not (run / "checkpoint" / "state.pt").is_file() and time.monotonic() < end:
        time.sleep(0.02)
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            if path.read_bytes().startswith(b"ray::train_one"):
                os.kill(int(path.parent.name), signal.SIGKILL)


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="this system does not list processes in /proc")
def test_a_run_whose_machine_is_lost_goes_on_from_its_checkpoint_to_the_same_bits(cluster, tmp_path, call):
    more = ["checkpoint_seconds=0.05", "total_steps=65536", "curve_every=16384"]
    run = tmp_path / "runs" / "seed4"
    killer = threading.Thread(target=kill_tasks, args=(run,))
    killer.start()
    call(*COMMAND, *more, "--seeds", "4", "--out", run.parent)
    killer.join()
    train(load("rprp_reach_ppo", [*TINY, *more, "seed=4"]), tmp_path / "alone")
    assert_same_policy(tmp_path / "alone", run)
    tables = [(folder / "selection.csv").read_text().splitlines() for folder in (tmp_path / "alone", run)]
    assert len({tuple(line.split(",")[0] for line in table) for table in tables}) == 1


ALONE = """
import os
import sys
from contextlib import suppress
from pathlib import Path
from redundant_envs_train.training import on_ray
with on_ray._cluster("local", 1):
    file = Path(os.environ["RAY_AUTH_TOKEN_PATH"])
    listening, sockets = set(), set()
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            environment = (folder / "environ").read_bytes()
            assert on_ray.TOKEN.encode() not in environment
            if bytes(file) in environment:
                sockets |= {str(path.readlink()) for path in (folder / "fd").iterdir()}
    for table in ("tcp", "tcp6"):
        for line in Path("/proc/net", table).read_text().splitlines()[1:]:
            cells = line.split()
            if cells[3] == "0A" and f"socket:[{cells[9]}]" in sockets:
                listening.add(cells[1].split(":")[0])
    print(oct(file.stat().st_mode & 0o777), len(file.read_text()), *sorted(listening))
print(file.exists(), os.environ["RAY_AUTH_TOKEN"])
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="others do not list sockets in /proc")
def test_a_cluster_of_this_machine_listens_there_alone_and_asks_for_its_token(tmp_path):
    own = {"HOME": str(tmp_path), "RAY_AUTH_TOKEN": 64 * "b"}  # the user's token, for another cluster
    paths = os.pathsep.join([str(ROOT), str(ROOT / "agents")])
    done = subprocess.run(
        [sys.executable, "-c", ALONE], env=os.environ | own | {"PYTHONPATH": paths}, stdout=subprocess.PIPE,
        text=True, check=True,
    )  # fmt: skip
    (mode, length, *listening), after = (line.split() for line in done.stdout.splitlines()[-2:])
    assert (mode, length, after) == ("0o600", "64", ["False", 64 * "b"])
    assert listening
    assert {*listening} <= {"0100007F", "0000000000000000FFFF00000100007F"}
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["../a", "a/../../b", "..", "/tmp/evil"])
def test_a_file_that_leads_out_of_its_folder_is_refused(name, tmp_path):
    archive = io.BytesIO()
    write_members(archive, {"run": b"", name: b"evil"})
    with pytest.raises(ValueError, match="outside"):
        on_ray.unpack(archive.getvalue(), tmp_path / "place" / "run")
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_a_worker_or_a_cluster_that_does_not_fit_is_refused(tmp_path, monkeypatch):
    _, note, failed = on_ray.train_one("seed1", {}, b"", "here", "0.0.0", None)
    assert failed
    assert f"has redundant-envs {on_ray.__version__}, and the command runs 0.0.0; install" in note
    monkeypatch.setattr(on_ray, "_cluster", lambda place, count: contextlib.nullcontext())
    nodes = [{"Alive": True, "Resources": {"CPU": 2.0}}, {"Alive": False, "Resources": {"CPU": 64.0}}]
    monkeypatch.setattr(ray, "nodes", lambda: nodes)
    with says("torch_threads is 3; the largest machine of the cluster has 2 CPUs"):
        on_ray.train_on_ray({"seed1": load("rprp_reach_ppo", [*TINY, "torch_threads=3"])}, tmp_path)
