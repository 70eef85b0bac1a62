"""Formats by their names, and files of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from pkgutil import resolve_name

from redundant_envs import __version__
from redundant_envs.exports.document import Document, Heading, Note
from redundant_envs.scenes.scene import Scene, check_scene
from redundant_envs.support.disk import write_bytes
from redundant_envs.support.values import shown

FORMATS = {"mjcf": "mjcf:mjcf", "urdf": "urdf:urdf", "casadi": "casadi:serialised", "c": "c:c_code"}
"""Formats, and where the functions are that write them: CasADi may be missing."""


def document(
    scene: Scene, form: str, approximate: bool = False, name: str = "", function: str = ""
) -> Document:
    """A scene in a format, "mjcf", "urdf", "casadi" or "c".

    If ``approximate``, what has no exact counterpart is left out, or its nearest equivalent is written; the
    notes of the document name it, and so do comments in text formats. ``name`` is that of the scene in the
    file, and ``function`` what the name of the function of a C file begins with, by default that of the scene
    or of the arm.

    Raises
    ------
    ValueError
        If the format is unknown, if it cannot express the scene exactly and ``approximate`` is not set, or if
        MJCF or URDF shall have an arm that is no chain of rigid links; the message names each effect.
    MissingPackage
        If the format needs CasADi, which is not installed.
    """
    check_scene(scene)
    if not isinstance(form, str) or form not in FORMATS:
        raise ValueError(f"format is {shown(form)}; choose {', '.join(FORMATS)}")
    source = f"the scene {name}" if name else f"a scene of {scene.robot.kind}"
    heading = Heading(source, __version__, bool(scene.randomize), function or name or scene.robot.kind)
    writer: Callable[[Scene, Heading, bool], Document] = resolve_name(f"{__package__}.{FORMATS[form]}")
    return writer(scene, heading, approximate)


def write(scene: Scene, form: str, path: Path, approximate: bool = False, name: str = "") -> Sequence[Note]:
    """Write the same to a file, whose folder is made, and return what it leaves out. OSError if that cannot
    be done. The function of a C file is called by the file."""
    made = document(scene, form, approximate, name, path.stem)
    write_bytes(path, made.content if isinstance(made.content, bytes) else made.content.encode())
    return made.notes
