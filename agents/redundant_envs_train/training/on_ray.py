"""Several runs on a Ray cluster without a shared disk: a task receives the files of its run, sends them with
each new checkpoint, and returns all. A run whose machine is lost goes on from here on another one."""

import contextlib
import io
import logging
import os
import secrets
import shutil
import socket
import sys
import tempfile
import time
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future
from pathlib import Path
from threading import Event
from typing import Any

from redundant_envs import __version__
from redundant_envs.support.disk import disk_errors, write_text
from redundant_envs.support.extras import needs
from redundant_envs.support.modules import IMPORTED, OPTION
from redundant_envs.support.values import shown

from ..config import Config, checked
from ..config.learners import EXPERT
from ..run_folder import CHECKPOINT, STATE, check_new, replace_folder
from .many import Teller, finish, is_finished, prepared, result_of
from .pool import POLL, News, count_of, follow

# Ray reads it when it starts: nothing about this machine or its user is sent to anyone.
os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
with needs("ray"):
    import ray
    from ray._private import ray_constants
    from ray._private.services import resolve_ip_for_localhost
    from ray._raylet import Config as RayConfig  # type: ignore[attr-defined]
if sys.platform != "win32":
    import fcntl

LOCAL = "local"  # Ray's name of a cluster of this machine alone
RETRIES = 2  # number of machines of a cluster that a run may lose before it counts as failed
CONNECTING = 10.0  # s; time limit for reaching the address of a cluster
ANSWERING = 10.0  # s; time limit for what the board knows: its machine may be lost, and it then begins anew
PREFIX = "redundant-envs-"  # of folders of tasks, and of the token
ABANDONED = 60.0  # s; age of such a folder that is not locked, and that no task is about to lock
OF_THIS_MACHINE = {"RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0", "RAY_AUTH_MODE": "token"}
"""Of a cluster of this machine alone: it listens at 127.0.0.1, and asks everybody for a token."""
TOKEN = secrets.token_hex(32)  # of the clusters of this process, as Ray reads its token once
INCOMING = ".incoming"  # folder beside the runs, in which a run is written before it gets its final name
MAX_CHARACTERS = 300  # most characters of a failure in a message


def train_on_ray(
    configs: Mapping[str, Config], folder: Path, address: str | None = None, processes: int | None = None
) -> None:
    """Do as :func:`~.many.train_many` on the Ray cluster at an address such as ``10.0.0.1:6379`` or ``auto``;
    by default that of RAY_ADDRESS, otherwise one of this machine alone, which ends with the call and has
    ``processes`` cores. ValueError if there is no cluster, or it may lack a module or file of a run."""
    lack = "the machines of a cluster may not have; train on this machine, without Ray"
    if IMPORTED:
        raise ValueError(f"{OPTION} names {', '.join(IMPORTED)}, which {lack}")
    for config in configs.values():
        if config.start_from is not None:
            raise ValueError(f"start_from is {shown(config.start_from)}, a file that {lack}")
        if config.demonstrations is not None and config.demonstrations.source != EXPERT:
            source = shown(config.demonstrations.source)
            raise ValueError(f"demonstrations.source is {source}, a dataset that {lack}")
    if address is not None and not address.strip():
        raise ValueError("address is empty; give host:port, ray://host:port or auto, or leave it out")
    count = count_of(processes)
    place = address or os.environ.get("RAY_ADDRESS") or LOCAL
    if place != LOCAL and processes is not None:
        problem = f"processes is {processes}, and the cluster at {shown(place)}"
        raise ValueError(f"{problem} has its own number; leave one out")
    with _cluster(place, count), prepared(configs, folder):
        most = max((int(node["Resources"].get("CPU", 0)) for node in ray.nodes() if node["Alive"]), default=0)
        for config in configs.values():
            if 0 < most < config.torch_threads:  # Ray would wait for ever
                there = f"the largest machine of the cluster has {most} CPUs, give at most so many"
                raise ValueError(f"torch_threads is {config.torch_threads}; {there}")
        follow(list(configs), lambda stop: _reports(configs, folder, stop))


@contextlib.contextmanager
def _cluster(place: str, count: int) -> Iterator[None]:
    """A connection to a cluster; an existing one of the calling program is used, and kept."""
    if ray.is_initialized():
        yield
        return
    options: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
    with contextlib.ExitStack() as ends:
        if place == LOCAL:
            options |= {"num_cpus": count, "include_dashboard": False}
            ends.enter_context(_closed_to_others())
        ends.callback(ray.shutdown)
        try:
            host, colon, port = place.rpartition(":")
            if colon and "/" not in host and port.isdecimal() and 0 < int(port) < 2**16:
                # if nothing listens there, Ray would try to connect for ever
                host = resolve_ip_for_localhost(host.strip("[]"))  # as Ray does
                socket.create_connection((host, int(port)), timeout=CONNECTING).close()
            ray.init(place, **options)
        except Exception as error:  # Ray reports an address without a cluster in many ways
            fix = "Give host:port, ray://host:port or auto, or none for a cluster of this machine alone"
            reason = f"Ray cannot reach a cluster there ({_cause(error)})"
            raise ValueError(f"address is {shown(place)}; {reason}. {fix}") from error
        yield


@contextlib.contextmanager
def _closed_to_others() -> Iterator[None]:
    """Within this context a cluster that Ray starts is closed to others; this user alone reads its token."""
    names = *OF_THIS_MACHINE, "RAY_AUTH_TOKEN_PATH", "RAY_AUTH_TOKEN"
    before, clusters = {name: os.environ.get(name) for name in names}, ray_constants.ENABLE_RAY_CLUSTER
    with _workplace() as private:
        token = private / "token"
        with os.fdopen(os.open(token, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(TOKEN)
        os.environ |= {**OF_THIS_MACHINE, "RAY_AUTH_TOKEN_PATH": str(token)}
        os.environ.pop("RAY_AUTH_TOKEN", None)
        ray_constants.ENABLE_RAY_CLUSTER = False
        RayConfig.initialize("")  # Ray has read its variables when it was imported
        try:
            yield
        finally:
            for name in names:
                os.environ.pop(name, None)
            os.environ |= {name: value for name, value in before.items() if value is not None}
            ray_constants.ENABLE_RAY_CLUSTER = clusters
            RayConfig.initialize("")


class Board:
    """An actor: what the tasks tell of their runs, and whether the user has asked them to stop."""

    def __init__(self) -> None:
        self._news: dict[str, tuple[News, str]] = {}
        self._files: dict[str, Any] = {}
        self._stopping = False

    def tell(self, news: News, host: str, files: Sequence[Any] = ()) -> bool:
        """Take a report from a machine, and a reference to files of a new checkpoint; whether to stop."""
        name = news[0]
        self._news[name] = news, host
        if files:
            (self._files[name],) = files
        return self._stopping

    def look(self, stopping: bool) -> tuple[list[tuple[News, str]], dict[str, Any]]:
        """The latest reports, and references to files; ``stopping`` is what tasks are told."""
        self._stopping = stopping
        news, self._news = list(self._news.values()), {}
        files, self._files = self._files, {}
        return news, files


def _reports(configs: Mapping[str, Config], folder: Path, stop: Event) -> Iterator[News]:
    """Submit unfinished runs as tasks, report on them, and write their folders as they come."""
    board = ray.remote(Board).options(num_cpus=0, max_restarts=-1).remote()
    task = ray.remote(scheduling_strategy="SPREAD", max_retries=0)(train_one)
    running: dict[Any, str] = {}
    hosts: dict[str, str] = {}
    losses: dict[str, list[str]] = {name: [] for name in configs}

    def submit(name: str) -> None:
        ray_task, place = task.options(num_cpus=configs[name].torch_threads), folder / name
        args = name, configs[name].to_dict(), pack(place), str(place), __version__, board
        running[ray_task.remote(*args)] = name

    for name in configs:
        place = folder / name
        try:
            restore(place)
            if is_finished(place):
                yield name, 1.0, result_of(place), False
                continue
            if not (place / "config.yaml").is_file():
                check_new(place)
            submit(name)
        except (ValueError, OSError) as error:
            yield name, 1.0, _short(error), True
    cancelled = False
    while running:
        with contextlib.suppress(ray.exceptions.RayError):  # what is lost with the board is told again
            news, sent = ray.get(board.look.remote(stop.is_set()), timeout=ANSWERING)
            hosts |= {item[0]: host for item, host in news}
            present = set(running.values())
            for name in present & sent.keys():
                try:
                    receive(ray.get(sent[name], timeout=ANSWERING), folder / name)
                except OSError as error:  # this disk does not take it
                    yield name, 0.0, f"its checkpoint is not kept: {_short(error)}", False
            yield from (item for item, _ in news if item[0] in present and item[1] > 0.0)
        if stop.is_set() and not cancelled:  # those that wait for a core; the others look at the board
            cancelled = True
            for waiting in [task for task, name in running.items() if name not in hosts]:
                ray.cancel(waiting)
        for done in ray.wait(list(running), timeout=POLL)[0]:
            name = running.pop(done)
            try:
                files, note, failed = ray.get(done)
                if files:
                    receive(files, folder / name)
                yield name, 1.0, note, failed
            except LOSSES as error:
                losses[name].append(f"{hosts.pop(name, 'before it began')}: {_short(error)}")
                if len(losses[name]) <= RETRIES and not stop.is_set():
                    yield name, 0.0, f"its machine was lost ({losses[name][-1]}); it goes on elsewhere", False
                    submit(name)
                else:
                    yield name, 1.0, f"its machine was lost; {'; '.join(losses[name])}", True
            except Exception as error:  # of the task, the cluster or this disk
                yield name, 1.0, _short(error), True


LOSSES = (
    ray.exceptions.WorkerCrashedError, ray.exceptions.NodeDiedError, ray.exceptions.OutOfMemoryError,
    ray.exceptions.ObjectLostError,
)  # fmt: skip
"""Errors of a task whose process or machine is no more."""


def _short(error: BaseException) -> str:
    """The last line of an error, which names the mistake; Ray puts the worker's traceback before it."""
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return (lines[-1] if lines else type(error).__name__)[:MAX_CHARACTERS]


def _cause(error: BaseException) -> str:
    """The last line of the error that led to an error of a connection, and what to do about a token."""
    texts = []
    cause: BaseException | None = error
    while cause is not None:
        texts.append(_short(cause))
        cause = cause.__cause__ or cause.__context__
    asked = [text for text in texts if "token" in text.lower()]
    if not asked:
        return texts[-1]
    text = asked[-1].removeprefix("ray.exceptions.AuthenticationError: ").partition(". ")[0]
    token = "RAY_AUTH_TOKEN or RAY_AUTH_TOKEN_PATH to the token of the cluster"
    return f"{text}; set RAY_AUTH_MODE=token, and {token}, or copy its file ~/.ray/auth_token"


class _Courier:
    """Sends reports of a task, and the files of its run with each new checkpoint, to the board. It never
    waits for Ray, which would give the core of the task to another one meanwhile."""

    def __init__(self, board: Any, place: Path) -> None:
        self._board, self._place, self._host = board, place, socket.gethostname()
        self._sent, self._stop = self._checkpoint(), False
        self._answer: Future[bool] = Future()
        self._files: list[Any] = []  # this process owns what it sends

    def tell(self, news: News) -> None:
        new, more = self._checkpoint(), []
        if new != self._sent:
            self._sent = new
            more = self._files = [ray.put(pack(self._place))]
        self._answer = self._board.tell.remote(news, self._host, more).future()

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

    def _checkpoint(self) -> int:
        """When the checkpoint was made, ns; 0 without one."""
        with contextlib.suppress(OSError):
            return (self._place / CHECKPOINT / STATE).stat().st_mtime_ns
        return 0


def train_one(
    name: str, data: dict[str, Any], files: bytes, where: str, version: str, board: Any
) -> tuple[bytes, str, bool]:
    """Finish a run, from its existing files, on the machine of this task; returns its files, its result or
    failure in words, and whether it failed. Messages name ``where``, its folder on the machine of the user,
    whose redundant-envs has this ``version``."""
    if version != __version__:
        note = f"{socket.gethostname()} has redundant-envs {__version__}, and the command runs {version}"
        return b"", f"{note}; install the same on all machines", True
    with _workplace() as root:
        place = root / Path(name).name
        failed = True
        try:
            if files:
                unpack(files, place)
            courier = _Courier(board, place)
            if not courier.begin(name):
                return b"", "stopped", True
            finish(checked(Config, data), place, Teller(courier.tell, courier.stopping, name))
            page = place / "report.md"
            write_text(page, page.read_text(encoding="utf-8").replace(str(place), where))
            failed, note = False, result_of(place)
        except KeyboardInterrupt:
            note = "stopped"
        except Exception as error:
            note = str(error).replace(str(place), where)
        return pack(place), note, failed


@contextlib.contextmanager
def _workplace() -> Iterator[Path]:
    """A folder of this process, locked, so that others can delete those of killed processes."""
    for path in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
        with contextlib.suppress(OSError):
            if time.time() - path.stat().st_mtime > ABANDONED and (lock := _lock(path)) is not None:
                shutil.rmtree(path, ignore_errors=True)
                os.close(lock)
    with tempfile.TemporaryDirectory(prefix=PREFIX, ignore_cleanup_errors=True) as root:
        lock = _lock(Path(root))
        try:
            yield Path(root)
        finally:
            if lock is not None:
                os.close(lock)


def _lock(folder: Path) -> int | None:
    """A descriptor that locks a folder of this user; None if another process has, or the system cannot."""
    if sys.platform == "win32":
        return None
    descriptor = os.open(folder, os.O_RDONLY | os.O_NOFOLLOW | os.O_DIRECTORY)
    with contextlib.suppress(OSError):
        if os.fstat(descriptor).st_uid == os.geteuid():
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return descriptor
    os.close(descriptor)
    return None


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
    """Write packed files, links too, into a new folder; ValueError for one that leads out of it."""
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
    shutil.rmtree(part, ignore_errors=True)
    try:
        with disk_errors(folder):
            unpack(files, part)
        replace_folder(part, folder, old)
    finally:
        shutil.rmtree(part, ignore_errors=True)
        with contextlib.suppress(OSError):  # another run is being written
            incoming.rmdir()
