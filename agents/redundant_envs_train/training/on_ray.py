"""Several runs on a Ray cluster without a shared disk: a task receives the files of its run and returns all.
A run whose machine is lost begins again on another one."""

import contextlib
import io
import logging
import os
import shutil
import socket
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from concurrent.futures import Future
from pathlib import Path
from threading import Event
from typing import Any

from redundant_envs import __version__
from redundant_envs.support.disk import told, write_text
from redundant_envs.support.extras import needs
from redundant_envs.support.modules import IMPORTED, OPTION
from redundant_envs.support.values import shown

from ..config import Config, checked
from ..run_folder import check_new, replace_folder
from .many import Teller, finish, is_finished, prepared, result_of
from .pool import POLL, News, follow

# Ray reads it when it starts: nothing about this machine or its user is sent to anyone.
os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
with needs("ray"):
    import ray
    from ray._private.services import resolve_ip_for_localhost

RETRIES = 2  # number of machines of a cluster that a run may lose before it counts as failed
CONNECTING = 10.0  # s; time limit for reaching the address of a cluster
ANSWERING = 10.0  # s; time limit for what the board knows: its machine may be lost, and it then begins anew
PREFIX = "redundant-envs-"  # of folders of tasks
INCOMING, OLD = ".{}.incoming", ".{}.old"
"""Folders beside that of a run: in the first it is written, the second it gets while its name is taken."""
MAX_CHARACTERS = 300  # most characters of a failure in a message


def train_on_ray(configs: Mapping[str, Config], folder: Path, address: str | None = None) -> None:
    """Do as :func:`~.many.train_many` on the Ray cluster at an address such as ``10.0.0.1:6379`` or ``auto``;
    by default that of RAY_ADDRESS. ValueError if there is no cluster, or it may lack a module or file of a
    run."""
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
    with _cluster(address or os.environ.get("RAY_ADDRESS")), prepared(configs, folder):
        most = max((int(node["Resources"].get("CPU", 0)) for node in ray.nodes() if node["Alive"]), default=0)
        for config in configs.values():
            if 0 < most < config.torch_threads:  # Ray would wait for ever
                raise ValueError(
                    f"torch_threads is {config.torch_threads}; the largest machine of the cluster has {most} "
                    "CPUs, give at most so many"
                )
        follow(list(configs), lambda stop: _reports(configs, folder, stop))


@contextlib.contextmanager
def _cluster(place: str | None) -> Iterator[None]:
    """A connection to a cluster; an existing one of the calling program is used, and kept."""
    if ray.is_initialized():
        yield
        return
    if not place:
        raise ValueError("address is missing; give host:port, ray://host:port or auto, or train without Ray")
    try:
        host, colon, port = place.rpartition(":")
        if colon and "/" not in host and port.isdecimal() and 0 < int(port) < 2**16:
            # if nothing listens there, Ray would try to connect for ever
            host = resolve_ip_for_localhost(host.strip("[]"))  # as Ray does
            socket.create_connection((host, int(port)), timeout=CONNECTING).close()
        ray.init(place, log_to_driver=False, logging_level=logging.ERROR)
    except Exception as error:  # Ray reports an address without a cluster in many ways
        raise ValueError(
            f"address is {shown(place)}; Ray cannot reach a cluster there ({_short(error)}). Give host:port, "
            "ray://host:port or auto, and RAY_AUTH_TOKEN if the cluster asks for a token"
        ) from error
    try:
        yield
    finally:
        ray.shutdown()


class Board:
    """An actor: what the tasks tell of their runs, and whether the user has asked them to stop."""

    def __init__(self) -> None:
        self._news: dict[str, News] = {}
        self._stopping = False

    def tell(self, news: News) -> bool:
        """Take a report; whether to stop."""
        self._news[news[0]] = news
        return self._stopping

    def look(self, stopping: bool) -> list[News]:
        """The latest reports; ``stopping`` is what tasks are told."""
        self._stopping = stopping
        news, self._news = list(self._news.values()), {}
        return news


def _reports(configs: Mapping[str, Config], folder: Path, stop: Event) -> Iterator[News]:
    """Submit unfinished runs as tasks, report on them, and write their folders when they end."""
    board = ray.remote(Board).options(num_cpus=0, max_restarts=-1).remote()
    task = ray.remote(scheduling_strategy="SPREAD", max_retries=RETRIES)(train_one)
    running: dict[Any, str] = {}
    for name, config in configs.items():
        place = folder / name
        try:
            if is_finished(place):
                yield name, 1.0, result_of(place), False
                continue
            if not (place / "config.yaml").is_file():
                check_new(place)
            own = task.options(num_cpus=config.torch_threads)
            given = name, config.to_dict(), pack(place), str(place), __version__, board
            running[own.remote(*given)] = name
        except (ValueError, OSError) as error:
            yield name, 1.0, _short(error), True
    while running:
        with contextlib.suppress(ray.exceptions.RayError):  # what is lost with the board is told again
            news = ray.get(board.look.remote(stop.is_set()), timeout=ANSWERING)
            yield from (item for item in news if item[0] in running.values())
        for done in ray.wait(list(running), timeout=POLL)[0]:
            name = running.pop(done)
            try:
                files, note, failed = ray.get(done)
                if files:
                    receive(files, folder / name)
                yield name, 1.0, note, failed
            except Exception as error:  # of the task, the cluster or this disk
                yield name, 1.0, _short(error), True


def _short(error: BaseException) -> str:
    """The last line of an error, which names the mistake; Ray puts the worker's traceback before it."""
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return (lines[-1] if lines else type(error).__name__)[:MAX_CHARACTERS]


class _Courier:
    """Sends reports of a task to the board. It never waits for Ray, which would give the core of the task to
    another one meanwhile."""

    def __init__(self, board: Any) -> None:
        self._board, self._stop = board, False
        self._answer: Future[bool] = Future()

    def tell(self, news: News) -> None:
        self._answer = self._board.tell.remote(news).future()

    def stopping(self) -> bool:
        """Whether the last answer of the board that has arrived says so."""
        with contextlib.suppress(ray.exceptions.RayError):  # its machine was lost
            self._stop |= self._answer.done() and self._answer.result()
        return self._stop

    def begin(self, name: str) -> bool:
        """Tell that the run begins; whether it may, unless the user has asked to stop before."""
        self.tell((name, 0.0, "", False))
        with contextlib.suppress(ray.exceptions.RayError):
            self._answer.exception()  # waits: the board may begin later than this task
        return not self.stopping()


def train_one(
    name: str, data: dict[str, Any], files: bytes, where: str, version: str, board: Any
) -> tuple[bytes, str, bool]:
    """Finish a run, from its existing files, on the machine of this task; returns its files, its result or
    failure in words, and whether it failed. Messages name ``where``, its folder on the machine of the user,
    whose redundant-envs has this ``version``."""
    if version != __version__:
        note = f"{socket.gethostname()} has redundant-envs {__version__}, and the command runs {version}"
        return b"", f"{note}; install the same on all machines", True
    with tempfile.TemporaryDirectory(prefix=PREFIX, ignore_cleanup_errors=True) as root:
        place = Path(root, name)
        failed = True
        try:
            if files:
                unpack(files, place)
            courier = _Courier(board)
            if not courier.begin(name):
                return b"", "stopped", True
            finish(checked(Config, data), place, Teller(courier.tell, courier.stopping, name))
            page = place / "report.md"
            text = page.read_text(encoding="utf-8").replace(str(place), where)
            write_text(page, text)
            failed, note = False, result_of(place)
        except KeyboardInterrupt:
            note = "stopped"
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
    """Write packed files into a new folder; names that lead out of it lose what does."""
    folder.mkdir(parents=True)
    with zipfile.ZipFile(io.BytesIO(files)) as archive:
        archive.extractall(folder)


def receive(files: bytes, folder: Path) -> None:
    """Make a folder of packed files that replaces an older one; it is complete or unchanged."""
    part = folder.with_name(INCOMING.format(folder.name))
    shutil.rmtree(part, ignore_errors=True)
    try:
        with told(folder):
            unpack(files, part)
        replace_folder(part, folder, folder.with_name(OLD.format(folder.name)))
    finally:
        shutil.rmtree(part, ignore_errors=True)
