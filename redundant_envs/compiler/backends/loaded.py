"""Everything of this package that a program follows from: the files and the loaded code of its modules."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import marshal
import os
import platform
import re
import sys
from collections.abc import Callable, Mapping
from enum import Enum, EnumMeta
from operator import attrgetter, methodcaller
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

from redundant_envs.compiler.backends import IMPORTED

ROOT = __name__.partition(".")[0]
NUMBERS = frozenset((bool, int, float, complex, str, bytes, type(None)))
BACKENDS = f"{ROOT}.compiler.backends"
TABLES = (dict, list, set, frozenset)
REGISTRIES = ("ARMS", "EFFECTS", "METHODS", "REGISTRY")
"""Tables that others may add to. What they hold is not told: a scene tells which it names."""
CACHED = type(functools.cache(len))
WRAPPERS = {
    property: ("fget", "fset"),
    classmethod: ("__func__",),
    staticmethod: ("__func__",),
    functools.cached_property: ("func",),
    functools.partial: ("func", "args", "keywords"),
    MethodType: ("__self__", "__func__"),
    CACHED: ("__wrapped__",),
}
"""What wraps a function, and its attributes that say what it does."""
INERT = frozenset((
    "__future__", "_abc", "_collections", "_contextvars", "collections.abc", "dataclasses", "operator", "re",
    "typing",
))  # fmt: skip
"""Modules of objects that are known by their texts; so are a few of Python's own."""
DESCRIPTORS = frozenset((
    "GenericAlias", "UnionType", "_tuplegetter", "ellipsis", "member_descriptor", "wrapper_descriptor",
))  # fmt: skip
ADDRESS = re.compile(r" at 0x[0-9a-fA-F]+")
KNOWN = frozenset((ROOT, "numpy", *sys.stdlib_module_names)) - {"unittest"}
"""Packages whose functions are known by their names, if they lie where Python or NumPy does; those of
unittest stand for others."""
_code, _defaults = attrgetter("__code__"), attrgetter("__defaults__", "__kwdefaults__")


def scene_key(text: str, maker: str) -> str:
    """Name of what this package, as it is loaded, traces from a ``text``; "" if :func:`loaded_code` is."""
    code = loaded_code(maker)
    return hashlib.sha256(f"{code}\0{text}".encode()).hexdigest()[:40] if code else ""


def loaded_code(maker: str) -> str:
    """A digest of this package as it is loaded, under this Python and NumPy.

    Told are ``maker``, the module that traces, and all those of which it uses functions, classes or objects,
    directly or by others. Files alone would not tell: Python may have loaded old bytecode of them, and a
    process may have replaced a function or a number. The code alone would not tell what decorators note. The
    digest is "" with a file that cannot be read or was changed since the import, and with a function or an
    object of others in place of one of the package: what it does may follow from anything.

    It is found again when something was replaced; what the package had noted of functions is forgotten then.
    """
    loaded = _loaded.get(maker)
    if loaded is None or loaded.is_changed():
        loaded = _loaded[maker] = Loaded(maker)
        loaded.forget()
    elif not loaded.digest:
        loaded.forget()
    return loaded.digest


class Loaded:
    """The loaded code that ``maker`` uses, its ``digest``, and whether it is still what it was."""

    def __init__(self, maker: str) -> None:
        self._told: list[Any] = []
        self._modules = [maker]
        self._seen: dict[int, Any] = {}  # what was told, by its id
        self._classes: set[type[Any]] = set()
        self._globals: dict[int, tuple[str, str]] = {}  # of functions, by id: their module and its file
        self._homes: dict[str, bool] = {}  # modules that are used; whether they are of this package and trace
        self._names: list[Mapping[str, Any]] = []
        self._tables: list[Any] = []
        self._functions: list[FunctionType] = []
        self._caches: list[Callable[[], None]] = []
        self._replaced = False
        about = "\0".join((sys.version, platform.machine(), np.__version__))
        digest, known = hashlib.sha256(about.encode()), {ROOT, BACKENDS}
        for module in self._modules:
            if module in known:
                continue
            known.add(module)
            names = vars(sys.modules[module])
            try:
                with open(names["__file__"], "rb") as file:
                    times, content = os.fstat(file.fileno()), file.read()
                self._replaced |= max(times.st_mtime, times.st_ctime) > IMPORTED
                digest.update(b"\0%b\0%b" % (module.encode(), content))
            except OSError:
                self._replaced = True
            self._modules.append(module.rpartition(".")[0])  # the package that the module is in
            self._tell_names(module, names)
        digest.update(marshal.dumps(self._told, 2))  # version 2 does not depend on counts of references
        self.digest = "" if self._replaced else digest.hexdigest()
        self._told.clear()
        self._with_defaults = [f for f in self._functions if f.__defaults__ or f.__kwdefaults__]
        (*changing, codes, defaults), again = self._present(), methodcaller("copy")
        self._before = *(list(map(again, some)) for some in changing), codes, defaults

    def is_changed(self) -> bool:
        """Whether a module, a class, a function or a table of these is not what it was, in some 0.1 ms."""
        try:
            return self._present() != self._before
        except Exception:  # objects of others may not compare
            return True

    def _present(self) -> tuple[list[Any], ...]:
        defaults = list(map(_defaults, self._with_defaults))
        return self._names, self._tables, list(map(_code, self._functions)), defaults

    def forget(self) -> None:
        """Clear the caches of the package's functions."""
        for clear in self._caches:
            clear()

    # ---- what is told ------------------------------------------------------------------------------------

    def _tell_names(self, module: str, names: Mapping[str, Any], inside: type[Any] | None = None) -> None:
        """Tell what a module, or a class in it, has by names."""
        self._names.append(names)
        private = "_" if isinstance(inside, EnumMeta) else "__"  # maps of the members of an enumeration grow
        for name, value in tuple(names.items()):
            if (kind := type(value)) is not FunctionType:
                if name.startswith(private):
                    continue
                if kind is ModuleType and value.__name__.startswith(f"{module}."):
                    continue  # a submodule, which others may have imported
                if isinstance(value, TABLES):
                    if name in REGISTRIES or not (inside or name.isupper()):
                        continue  # others are caches
                    self._tables.append(value)
            self._told.append(name)
            self._tell(value)

    def _tell(self, value: Any) -> None:
        """Tell a value, and what it is made of."""
        kind, told = type(value), self._told
        if kind in NUMBERS or (kind is tuple and NUMBERS.issuperset(map(type, value))):
            told.append(value)
        elif id(value) in self._seen:
            told.append(getattr(value, "__qualname__", kind.__name__))
        else:
            self._seen[id(value)] = value
            told.append(kind.__qualname__)
            if kind is FunctionType:
                self._tell_function(value)
            elif isinstance(value, type):
                self._tell_class(value)
            elif behind := WRAPPERS.get(kind):
                if kind is CACHED:
                    self._caches.append(value.cache_clear)
                for name in behind:
                    self._tell(getattr(value, name))
            elif isinstance(value, Enum | str | int | float):
                self._tell_class(kind)
                told.append(repr(value))
            elif isinstance(value, tuple | list | dict):
                parts = [*value, *value.values()] if isinstance(value, dict) else value
                if NUMBERS.issuperset(map(type, parts)):
                    told.append(list(parts))
                    return
                told.append(len(value))
                for one in parts:
                    self._tell(one)
            elif kind in TABLES:
                told.append(sorted(map(_text, value)))
            elif kind is ModuleType:
                self._replaced |= sys.modules.get(value.__name__) is not value
                self._use(value.__name__)
            elif kind is np.ndarray:
                told += value.dtype.str, value.shape, value.tobytes()
            elif _top(kind.__module__) == ROOT:
                self._tell_class(kind)
                fields = (
                    [f.name for f in dataclasses.fields(kind)] if dataclasses.is_dataclass(kind) else None
                )
                for name in sorted(getattr(value, "__dict__", ())) if fields is None else fields:
                    told.append(name)
                    self._tell(getattr(value, name, None))
            elif kind is BuiltinFunctionType or _top(kind.__module__) == "numpy":
                self._use(getattr(value, "__module__", None) or "builtins")
                told.append(_text(value))
            else:
                self._replaced |= not (kind.__module__ in INERT or kind.__name__ in DESCRIPTORS)
                told.append(_text(value))

    def _tell_function(self, function: FunctionType) -> None:
        """Tell a function: its code, its defaults, and what it and its decorators hold."""
        code, names = function.__code__, function.__globals__
        if (known := self._globals.get(id(names))) is None:
            known = self._globals[id(names)] = self._file_of(names)
        home, file = known
        self._told += home, function.__qualname__
        if file:
            if code.co_filename != file and not code.co_filename.startswith("<"):  # made by dataclass
                self._replaced = True
            self._functions.append(function)
            self._told.append(code)
        if function.__defaults__:
            self._tell(function.__defaults__)
        if function.__kwdefaults__:
            self._tell(function.__kwdefaults__)
        if noted := function.__dict__:
            self._told.append([*noted])
            for value in noted.values():
                self._tell(value)
        for cell in function.__closure__ or ():
            try:
                inside = cell.cell_contents
            except ValueError:  # it is empty
                continue
            self._tell(inside)

    def _file_of(self, names: dict[str, Any]) -> tuple[str, str]:
        """The module that has these globals, and its file, if it is one of this package that traces."""
        home = names.get("__name__", "")
        own = self._use(home)
        if home in sys.modules:
            self._replaced |= vars(sys.modules[home]) is not names
        return home, str(sys.modules[home].__file__) if own else ""

    def _tell_class(self, kind: type[Any]) -> None:
        home = kind.__module__
        self._told += home, kind.__qualname__
        if self._use(home) and kind not in self._classes:
            self._classes.add(kind)
            self._told.append([base.__qualname__ for base in kind.__mro__])
            self._tell_names(home, vars(kind), kind)

    def _use(self, home: str) -> bool:
        """Note a module that is used, if it is one of this package that traces; whether it is.

        Back ends are left out: they compute what is traced, and trace nothing.
        """
        if home not in self._homes:
            own = _top(home) == ROOT
            self._replaced |= not (own or _is_known(home))
            self._homes[home] = own and not home.startswith(BACKENDS)
            if self._homes[home]:
                self._modules.append(home)
        return self._homes[home]


_loaded: dict[str, Loaded] = {}


def _top(module: str) -> str:
    return module.partition(".")[0]


def _is_known(home: str) -> bool:
    """Whether a module is one of Python or of NumPy, and not a file of others that has such a name."""
    module = sys.modules.get(home)
    if module is None:
        return home.startswith("namedtuple_")  # made by collections.namedtuple
    if _top(home) not in KNOWN:
        return False
    file = getattr(module, "__file__", None)
    if file is None:
        return getattr(module.__spec__, "origin", None) in ("built-in", "frozen")
    library = os.path.dirname(os.__file__)
    places = library, os.path.join(sys.base_exec_prefix, "DLLs"), os.path.dirname(np.__file__)
    lies_in = max((place for place in places if file.startswith(place + os.sep)), key=len, default="")
    return bool(lies_in) and not (lies_in == library and "-packages" in file[len(library) :])


def _text(value: Any) -> str:
    text = repr(value)
    return ADDRESS.sub("", text) if " at 0x" in text else text
