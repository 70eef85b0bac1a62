"""Packages that only some features need, and the extra of this package that installs each."""

import contextlib
from collections.abc import Iterator


class MissingPackage(ImportError):
    """A feature needs a package that is not installed; the message names the extra."""


INSTALL = "install it in a clone of redundant-envs with: pip install '.[{}]'"  # no index has the package


@contextlib.contextmanager
def needs(extra: str) -> Iterator[None]:
    """Context for imports of an extra, such as "plot": a :class:`MissingPackage` says what to install."""
    try:
        yield
    except ImportError as error:
        name = (error.name or "").partition(".")[0]
        # A package that is installed but cannot be imported states its own reason.
        reason = f"{name} is not installed" if isinstance(error, ModuleNotFoundError) and name else str(error)
        raise MissingPackage(f"{reason}; {INSTALL.format(extra)}") from error
