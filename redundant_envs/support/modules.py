"""Modules: their classes, and those of users that commands name; and how commands end."""

import contextlib
import importlib
import os
import pkgutil
import select
import sys
from collections.abc import Callable
from typing import Any, TypeVar

from redundant_envs.support.extras import MissingPackage
from redundant_envs.support.values import say, shown

T = TypeVar("T")
OPTION = "--import"
IMPORTED: list[str] = []  # modules that the command named: its other processes import them, too
NOTEBOOK = "module://matplotlib_inline"
"""How MPLBACKEND begins in the commands of a notebook, whose process they are not: figures become files."""
CLOSED_PIPE = 141  # exit status where nobody reads on, as of a program that SIGPIPE ends: 128 + 13


def status_of(run: Callable[[], int | None], name: str) -> int:
    """Run a command to its exit status: its own or 0; after a message that begins with ``name`` 2 for a
    mistake or a missing package, and 130 for Ctrl-C; in silence 141 if the reader of its output is gone."""
    for stream, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, stream) is None:  # closed by whoever began the command
            setattr(sys, stream, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115
    if os.environ.get("MPLBACKEND", "").startswith(NOTEBOOK):
        del os.environ["MPLBACKEND"]  # another environment may lack that module: matplotlib would not import
    try:
        try:
            return run() or 0
        finally:
            sys.stdout.flush()  # not at the exit of Python, which would show a traceback
    except SystemExit:  # of a parser after its help; one of them turns a closed pipe into it
        if _give_up_output():
            return CLOSED_PIPE
        raise
    except (ValueError, MissingPackage, OSError) as error:
        if _give_up_output() and isinstance(error, BrokenPipeError):
            return CLOSED_PIPE
        said, status = f"{name}: {' '.join(str(error).splitlines())}", 2
    except MemoryError as error:
        said, status = f"{name}: {error or 'there is not enough memory'}; give smaller numbers", 2
    except KeyboardInterrupt as stop:
        said, status = str(stop) or "stopped", 130
    with contextlib.suppress(BrokenPipeError):
        say(said, file=sys.stderr)
    return status


def _give_up_output() -> bool:
    """Whether nobody takes what is written to the standard output or error; what is left there is dropped."""
    lost = False
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):  # a stream without a descriptor is not closed
            if _is_lost(stream):
                lost = True
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    return lost


def _is_lost(stream: Any) -> bool:
    try:
        stream.flush()
    except OSError:
        return True
    if sys.platform == "win32":
        return False
    asked = select.poll()
    asked.register(stream, 0)
    return any(event & select.POLLERR for _, event in asked.poll(0))


def module_named(name: str) -> Any:
    """A module that is in the current folder or installed."""
    if os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())
    return importlib.import_module(name)


def classes_in(package: str, base: type[T]) -> list[type[T]]:
    """Classes that the modules of a package derive from a base, those with the shortest names first."""
    folder = importlib.import_module(package).__path__
    modules = [importlib.import_module(f"{package}.{m.name}") for m in pkgutil.iter_modules(folder)]
    derived = [
        thing
        for module in modules
        for thing in vars(module).values()
        if isinstance(thing, type) and issubclass(thing, base) and thing.__module__ == module.__name__
        if thing is not base
    ]
    return sorted(derived, key=lambda kind: (len(kind.__name__), kind.__name__))


def import_named(module: str) -> None:
    """Import a module for what it registers, here and in other processes of the command."""
    try:
        module_named(module)
    except ModuleNotFoundError as error:
        raise ValueError(
            f"{OPTION} is {shown(module)}: {error}; give the name of a module, without .py, that lies in "
            "this folder or is installed"
        ) from None
    IMPORTED.append(module)


def take_imports(words: list[str]) -> list[str]:
    """Import what ``--import MODULE`` at the beginning of a command names; returns the other words."""
    while words and words[0].partition("=")[0] == OPTION:
        first, *words = words
        module = first.partition("=")[2] or (words.pop(0) if words else "")
        if not module:
            raise ValueError(f"{OPTION} names no module; give {OPTION} MODULE before the command")
        import_named(module)
    return words
