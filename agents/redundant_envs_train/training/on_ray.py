"""Several runs on a Ray cluster: each is a task on a core of some machine, and works on that machine's disk.

No file system is shared. A task receives the existing files of its run and returns all of its files; they are
written here.
"""

import contextlib
import io
import logging
import os
import shutil
import socket
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from threading import Event
from typing import Any

from redundant_envs import __version__
from redundant_envs.disk import check_plain, write_text
from redundant_envs.extras import needs
from redundant_envs.modules import IMPORTED, OPTION
from redundant_envs.values import shown

from ..config import Config, checked
from ..run_folder import check_new, check_out
from .many import Teller, check_same, finish, is_finished, result_of
from .pool import POLL, News, count_of, follow

# Ray reads it when it starts: nothing about this machine or its user is sent to anyone.
os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
with needs("ray"):
    import ray
    from ray.util.queue import Queue

LOCAL = "local"  # Ray's name of a cluster of this machine alone
RETRIES = 2  # number of machines of a cluster that a run may lose before it counts as failed
CONNECTING = 10.0  # s; time limit for reaching the address of a cluster
INCOMING = ".incoming"  # folder beside the runs, in which a run is written before it gets its final name
MOST_CHARACTERS = 300  # most characters of a failure in a message


def train_on_ray(
    configs: Mapping[str, Config], folder: Path, address: str | None = None, processes: int | None = None
) -> None:
    """Do as :func:`~.many.train_many` on a Ray cluster, to the same bits on machines of the same kind.

    ``address`` is such as ``10.0.0.1:6379``, ``ray://10.0.0.1:10001`` or ``auto``; by default that of the
    environment variable RAY_ADDRESS, otherwise a cluster of this machine alone, which ends with the call and
    has ``processes`` cores. ValueError if there is no cluster, or it may lack a module or file of a run.
    """
    if IMPORTED:
        raise ValueError(
            f"{OPTION} names {', '.join(IMPORTED)}, which the machines of a cluster may not have; train on "
            "this machine, without Ray"
        )
    for config in configs.values():
        if config.start_from is not None:
            raise ValueError(
                f"start_from is {shown(config.start_from)}, a file that the machines of a cluster may not "
                "have; train on this machine, without Ray"
            )
    if address is not None and not address.strip():
        raise ValueError("address is empty; give host:port, ray://host:port or auto, or leave it out")
    check_out(folder)
    check_plain(folder)
    count = count_of(processes)
    place = address or os.environ.get("RAY_ADDRESS") or LOCAL
    if place != LOCAL and processes is not None:
        raise ValueError(
            f"processes is {processes}, and the cluster at {shown(place)} has its own number; leave one out"
        )
    for name, config in configs.items():
        check_same(config, folder / name)
    with _cluster(place, count):
        most = max((int(node["Resources"].get("CPU", 0)) for node in ray.nodes() if node["Alive"]), default=0)
        for config in configs.values():
            if 0 < most < config.torch_threads:  # Ray would wait for ever
                raise ValueError(
                    f"torch_threads is {config.torch_threads}; the largest machine of the cluster has {most} "
                    "CPUs, give at most so many"
                )
        follow(list(configs), lambda stop: _reports(configs, folder, stop))


@contextlib.contextmanager
def _cluster(place: str, count: int) -> Iterator[None]:
    """A connection to a cluster; an existing one of the calling program is used, and kept."""
    if ray.is_initialized():
        yield
        return
    options: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
    if place == LOCAL:
        options |= {"num_cpus": count, "include_dashboard": False}
    try:
        try:
            host, colon, port = place.rpartition(":")
            if colon and "/" not in host and port.isdecimal() and 0 < int(port) < 2**16:
                # if nothing listens there, Ray would try to connect for ever
                socket.create_connection((host.strip("[]"), int(port)), timeout=CONNECTING).close()
            ray.init(place, **options)
        except Exception as error:  # Ray reports an address without a cluster in many ways
            raise ValueError(
                f"address is {shown(place)}; Ray cannot reach a cluster there ({_short(error)}). Give "
                "host:port, ray://host:port or auto, or none for a cluster of this machine alone"
            ) from error
        yield
    finally:
        ray.shutdown()


def _reports(configs: Mapping[str, Config], folder: Path, stop: Event) -> Iterator[News]:
    """Submit unfinished runs as tasks, report on them, and write the returned folders."""
    board = Queue(actor_options={"num_cpus": 0, "max_restarts": -1})
    running: dict[Any, str] = {}
    for name, config in configs.items():
        place = folder / name
        try:
            restore(place)
            if is_finished(place):
                yield name, 1.0, result_of(place), False
                continue
            if not (place / "config.yaml").is_file():
                check_new(place)
            submit = train_one.options(num_cpus=config.torch_threads).remote
            running[submit(name, config.to_dict(), pack(place), str(place), __version__, board)] = name
        except (ValueError, OSError) as error:
            yield name, 1.0, _short(error), True
    told = False
    while running:
        if stop.is_set() and not told:  # each saves a checkpoint, ends, and returns its files
            told = True
            for task in running:
                ray.cancel(task)
        for task in ray.wait(list(running), timeout=POLL)[0]:
            name = running.pop(task)
            try:
                files, note, failed = ray.get(task)
                if files:
                    receive(files, folder / name)
                yield name, 1.0, note, failed
            except Exception as error:  # an error of the machine, the cluster or this disk
                yield name, 1.0, _short(error), True
        with contextlib.suppress(ray.exceptions.RayError):  # bars are lost with a machine, not results
            yield from (item for item in board.get_nowait_batch(board.qsize()) if item[0] in running.values())


def _short(error: BaseException) -> str:
    """The last line of an error, which names the mistake; Ray puts the worker's traceback before it."""
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return (lines[-1] if lines else type(error).__name__)[:MOST_CHARACTERS]


@ray.remote(max_retries=RETRIES, scheduling_strategy="SPREAD")
def train_one(
    name: str, data: dict[str, Any], files: bytes, where: str, version: str, board: Any
) -> tuple[bytes, str, bool]:
    """Finish the run of a configuration's plain data, from its existing files, on the machine of this task.

    Returns its files, packed, its result or failure in words, and whether it failed. ``where`` is its folder
    on the machine of the user, which reports and messages name, and ``version`` that of redundant-envs there;
    ``board`` receives the reports.
    """
    if version != __version__:
        note = (
            f"{socket.gethostname()} has redundant-envs {__version__}, and the command runs {version}; "
            "install the same on all machines"
        )
        return b"", note, True
    with tempfile.TemporaryDirectory(prefix="redundant-envs-", ignore_cleanup_errors=True) as root:
        place = Path(root) / Path(name).name
        failed = True
        try:
            if files:
                unpack(files, place)
            finish(checked(Config, data), place, Teller(board.actor.put_nowait.remote, name))
            page = place / "report.md"
            text = page.read_text(encoding="utf-8").replace(str(place), where)
            write_text(page, text)
            failed, note = False, result_of(place)
        except KeyboardInterrupt:
            note = "its task was cancelled"
        except Exception as error:
            note = str(error).replace(str(place), where)
        return pack(place), note, failed


def pack(folder: Path) -> bytes:
    """The files of a folder as a zip archive, without links; nothing if there is no folder."""
    data = io.BytesIO()
    if folder.is_dir():
        with zipfile.ZipFile(data, "w") as archive:
            for path in folder.rglob("*"):
                if path.is_file() and not path.is_symlink():
                    archive.write(path, path.relative_to(folder))
    return data.getvalue()


def unpack(files: bytes, folder: Path) -> None:
    """Write packed files into a folder that does not exist yet; ValueError for one that leads out of it. A
    link in the archive becomes a file."""
    folder.mkdir(parents=True)
    with zipfile.ZipFile(io.BytesIO(files)) as archive:
        for name in archive.namelist():
            if not (folder / name).resolve().is_relative_to(folder.resolve()):
                raise ValueError(f"a run has {name!r}, which is outside its folder")
        archive.extractall(folder)


def restore(folder: Path) -> None:
    """Restore the name of a run after a kill between the two renamings of :func:`receive`."""
    old = folder.parent / INCOMING / f"{folder.name}.old"
    if old.exists() and not folder.exists():
        os.replace(old, folder)


def receive(files: bytes, folder: Path) -> None:
    """Make a folder of packed files that replaces an older one; it is complete or unchanged."""
    incoming = folder.parent / INCOMING
    part, old = incoming / folder.name, incoming / f"{folder.name}.old"
    restore(folder)
    for left in (part, old):
        shutil.rmtree(left, ignore_errors=True)
    unpack(files, part)
    if folder.exists():
        os.replace(folder, old)
    os.replace(part, folder)
    shutil.rmtree(old, ignore_errors=True)
    with contextlib.suppress(OSError):  # another run is being written
        incoming.rmdir()
