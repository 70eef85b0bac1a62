"""Several seeds on a Ray cluster of two machines, which share no run folder."""

import contextlib
import os
import signal
import sys
import tempfile
import threading
import time
from pathlib import Path

import pytest
from run_folders import ROOT, kept, says
from short_trainings import TINY, assert_same_policy

from redundant_envs_train.config import load
from redundant_envs_train.training.train import train

pytest.importorskip("ray", reason="ray is not installed; pip install '.[ray]'")

import ray
from ray.cluster_utils import Cluster

from redundant_envs_train.training import on_ray

pytestmark = pytest.mark.long

COMMAND = ["train", "rprp_reach_ppo", *TINY, "--on", "ray"]


@pytest.mark.parametrize(
    ("more", "word"),
    [
        ([], "address is missing"),
        (["--address", "no address"], "address is 'no address'; Ray cannot"),
        (["--address", "127.0.0.1:1"], "there (Connection refused)"),
    ],
)
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


def kill_a_task():
    """Kill the process of a task as soon as it trains."""
    end, killed = time.monotonic() + 200.0, False
    while not killed and time.monotonic() < end:
        time.sleep(0.5)
        for path in Path("/proc").glob("[0-9]*/cmdline"):
            with contextlib.suppress(OSError):
                if path.read_bytes().startswith(b"ray::train_one"):
                    os.kill(int(path.parent.name), signal.SIGKILL)
                    killed = True


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="this system does not list processes in /proc")
def test_a_run_whose_machine_is_lost_begins_again_and_gets_the_same_bits(cluster, tmp_path, call):
    more = ["total_steps=65536", "curve_every=16384"]
    run = tmp_path / "runs" / "seed4"
    killer = threading.Thread(target=kill_a_task)
    killer.start()
    call(*COMMAND, *more, "--seeds", "4", "--out", run.parent)
    killer.join()
    train(load("rprp_reach_ppo", [*TINY, *more, "seed=4"]), tmp_path / "alone")
    assert_same_policy(tmp_path / "alone", run)


def test_a_worker_or_a_cluster_that_does_not_fit_is_refused(tmp_path, monkeypatch):
    _, note, failed = on_ray.train_one("seed1", {}, b"", "here", "0.0.0", None)
    assert failed
    assert f"has redundant-envs {on_ray.__version__}, and the command runs 0.0.0; install" in note
    monkeypatch.setattr(on_ray, "_cluster", lambda place: contextlib.nullcontext())
    nodes = [{"Alive": True, "Resources": {"CPU": 2.0}}, {"Alive": False, "Resources": {"CPU": 64.0}}]
    monkeypatch.setattr(ray, "nodes", lambda: nodes)
    config = load("rprp_reach_ppo", [*TINY, "torch_threads=3"])
    with says("torch_threads is 3; the largest machine of the cluster has 2 CPUs"):
        on_ray.train_on_ray({"seed1": config}, tmp_path)
