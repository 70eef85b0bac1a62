"""Everything of this package that a program follows from: the files and the loaded code of its modules."""

import contextlib
import dataclasses
import functools
import hashlib
import io
import marshal
import os
import pickle
import platform
import re
import sys
from collections.abc import Callable, Mapping
from enum import Enum, EnumMeta
from operator import attrgetter
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

from redundant_envs.compiler.backends import IMPORTED

ROOT = __name__.partition(".")[0]
BACKENDS = f"{ROOT}.compiler.backends"
PLAIN = frozenset((bool, int, float, complex, str, bytes, type(None), tuple, list, dict))
TABLES = (dict, list, set, frozenset)
REGISTRIES = ("ARMS", "EFFECTS", "METHODS", "REGISTRY")
"""Tables that others may add to. What they hold is not told: a scene tells which it names."""
CACHED = type(functools.cache(len))
ATTRIBUTES = {
    property: ("fget", "fset"),
    classmethod: ("__func__",),
    staticmethod: ("__func__",),
    functools.cached_property: ("func",),
    functools.partial: ("func", "args", "keywords"),
    contextlib._GeneratorContextManager: ("func", "args", "kwds"),
    MethodType: ("__self__", "__func__"),
    CACHED: ("__wrapped__",),
    re.Pattern: ("pattern", "flags"),
    slice: ("start", "stop", "step"),
}
"""What wraps functions, and some objects of Python: the attributes that say what they do."""
INERT = frozenset((
    "__future__", "_abc", "_collections", "_contextvars", "collections.abc", "dataclasses", "operator",
    "typing",
))  # fmt: skip
"""Modules of objects that are known by their texts; so are a few of Python's own."""
DESCRIPTORS = frozenset(("GenericAlias", "UnionType", "ellipsis", "member_descriptor", "wrapper_descriptor"))
ADDRESS = re.compile(r" at 0x[0-9a-fA-F]+")
LIBRARIES = tuple(
    os.path.join(folder, "")
    for folder in (os.path.dirname(os.__file__), f"{sys.base_exec_prefix}/DLLs", os.path.dirname(np.__file__))
)
"""Folders of the modules of Python and NumPy."""
_codes = attrgetter("__code__", "__defaults__", "__kwdefaults__")


class Loaded(pickle.Pickler):
    """The code that a module uses, of this package as it is loaded, under this Python and NumPy.

    Its ``digest`` is that of a pickle, in which a function is its code and what it holds, a class is what it
    has by names, and the globals of each function follow. Files alone would not tell what a process has
    replaced, nor that Python has loaded old bytecode. The code alone would not tell of private tables: the
    files are told, too. The digest is "" if a file cannot be read or was changed since the import, and with
    an object of others in place of one of the package: what it does may follow from anything.
    """

    def __init__(self, maker: str) -> None:
        file = io.BytesIO()
        super().__init__(file, 5)
        self.fast = True  # equal texts are told in the same way whether they are one object or two
        self._seen: dict[int, tuple[int, Any]] = {}  # by id: a number, and the object, which stays alive
        self._modules: list[dict[str, Any]] = []  # globals of functions
        self._scopes: list[Any] = []  # names of modules and classes, and tables
        self._functions: list[FunctionType] = []
        self._caches: list[Callable[[], None]] = []
        self._is_own = True
        digest = hashlib.sha256("\0".join((sys.version, platform.machine(), np.__version__)).encode())
        self._traces(maker)
        for names in self._modules:
            try:
                self.dump(self._told_names(home := names["__name__"], names))
                if "." in (package := home.rpartition(".")[0]):
                    self._traces(package)
                with open(names["__file__"], "rb") as source:
                    times = os.fstat(source.fileno())
                    self._is_own &= max(times.st_mtime, times.st_ctime) <= IMPORTED
                    digest.update(source.read())
            except Exception:  # no such file, or an object that cannot be told
                self._is_own = False
        digest.update(file.getbuffer())
        self.digest = digest.hexdigest() if self._is_own else ""
        self._before = [scope.copy() for scope in self._scopes], [*map(_codes, self._functions)]
        self.forget()

    def is_changed(self) -> bool:
        """Whether a module, a class, a function or a table of these is not what it was, in some 0.5 ms."""
        try:
            return (self._scopes, [*map(_codes, self._functions)]) != self._before
        except Exception:  # objects of others may not compare
            return True

    def forget(self) -> None:
        """Clear the caches of its functions."""
        for clear in self._caches:
            clear()

    def tells(self, part: Any) -> bool:
        """Whether the class of a part of a scene is told, or that of which it was made."""
        return id(getattr(part, "maker", type(part))) in self._seen

    def persistent_id(self, value: Any) -> Any:
        """What a value is made of; None if a pickle shows it as it is, and a number if it was told before."""
        kind = type(value)
        if kind in PLAIN:
            return None
        if kind is set or kind is frozenset:
            return sorted(map(_text, value))
        if id(value) in self._seen:
            return self._seen[id(value)][0]
        self._seen[id(value)] = len(self._seen), value
        if kind is FunctionType:
            return self._told_function(value)
        if isinstance(value, type):
            home = value.__module__
            members = self._traces(home) and (value.__bases__, self._told_names(home, vars(value), value))
            return home, value.__qualname__, members
        if kind is CACHED:
            self._caches.append(value.cache_clear)
        if kind in ATTRIBUTES:
            return kind.__name__, [getattr(value, name) for name in ATTRIBUTES[kind]]
        if isinstance(value, Enum):
            return kind, repr(value)
        if isinstance(value, tuple | list | dict):
            return kind, [*value], [*value.values()] if isinstance(value, dict) else None
        if kind.__module__.partition(".")[0] in (ROOT, "reprlib"):
            if dataclasses.is_dataclass(kind):  # others of its names may be cached later
                return kind, [getattr(value, field.name) for field in dataclasses.fields(kind)]
            return kind, value.__getstate__()
        if kind is ModuleType:
            self._is_own &= sys.modules.get(value.__name__) is value
            return value.__name__, self._traces(value.__name__)
        if kind is BuiltinFunctionType:
            self._traces(value.__module__ or "builtins")
        elif not (kind.__module__ in INERT or kind.__name__ in DESCRIPTORS):
            self._is_own = False
        return kind.__name__, _text(value)

    def _told_names(self, module: str, names: Mapping[str, Any], kind: Any = None) -> dict[str, Any]:
        """What a module, or a class in it, has by names."""
        self._scopes.append(names)
        values, private = {}, "_" if isinstance(kind, EnumMeta) else "__"  # maps of an enumeration grow
        for name, value in tuple(names.items()):
            if not isinstance(value, FunctionType):
                if name.startswith(private):
                    continue
                if isinstance(value, ModuleType) and value.__name__.startswith(f"{module}."):
                    continue  # a submodule, which others may have imported
                if isinstance(value, TABLES):
                    if name in REGISTRIES or not (kind or name.isupper()):
                        continue  # others are caches
                    self._scopes.append(value)
            values[name] = value
        return values

    def _told_function(self, function: FunctionType) -> tuple[Any, ...]:
        """A function: its code, and what it and its decorators hold."""
        names, code, cells = function.__globals__, b"", []
        home = names.get("__name__", "")
        if self._traces(home, names):
            self._functions.append(function)
            code = marshal.dumps(function.__code__, 2)  # version 2 does not depend on counts of references
        for cell in function.__closure__ or ():
            with contextlib.suppress(ValueError):  # it is empty
                cells.append(cell.cell_contents)
        held = function.__defaults__, function.__kwdefaults__, function.__dict__, cells
        return home, function.__qualname__, code, held

    def _traces(self, home: str, names: dict[str, Any] | None = None) -> bool:
        """Whether a module is one of this package that traces, whose names are told then; back ends only
        compute what is traced."""
        if home.partition(".")[0] != ROOT:
            self._is_own &= _is_known(home)
            return False
        if home.startswith(BACKENDS):
            return False
        names = vars(sys.modules[home]) if names is None else names
        if id(names) not in self._seen:
            self._seen[id(names)] = len(self._seen), names
            self._modules.append(names)
        return True


_loaded: dict[str, Loaded] = {}


def loaded_code(maker: str) -> Loaded:
    """The loaded code that the module ``maker`` uses, found again when something was replaced."""
    loaded = _loaded.get(maker)
    if loaded is None or loaded.is_changed():
        loaded = _loaded[maker] = Loaded(maker)
    if not loaded.digest:
        loaded.forget()
    return loaded


def _is_known(home: str) -> bool:
    """Whether a module is one of Python or of NumPy, and not a file of others that has such a name."""
    module = sys.modules.get(home)
    if module is None:
        return home.startswith("namedtuple_")  # made by collections.namedtuple
    file = getattr(module, "__file__", None) or getattr(module.__spec__, "origin", None) or ""
    behind = [file[len(folder) :] for folder in LIBRARIES if file.startswith(folder)]
    lies_in = bool(behind) and "-packages" not in min(behind, key=len)
    return file in ("built-in", "frozen") or (lies_in and not home.startswith("unittest"))


def _text(value: Any) -> str:
    text = repr(value)
    return ADDRESS.sub("", text) if " at 0x" in text else text
