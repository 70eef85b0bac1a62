"""Files of other programs' formats: their text, their heads, and what they cannot express."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from pkgutil import resolve_name
from typing import NamedTuple
from xml.etree import ElementTree as ET

from redundant_envs import __version__
from redundant_envs.effects.hooks import Effect
from redundant_envs.scenes.scene import Scene, check_scene
from redundant_envs.support.disk import write_bytes
from redundant_envs.support.values import shown

FORMATS = {"mjcf": "mjcf:mjcf", "urdf": "urdf:urdf", "casadi": "casadi:serialised", "c": "c:c_code"}
"""Formats, and where the functions are that write them: CasADi may be missing."""


class Note(NamedTuple):
    """An effect without an exact counterpart, why, and what the file has of it."""

    name: str
    reason: str
    written: str

    def __str__(self) -> str:
        return f"{self.name}: {self.written} ({self.reason})"


class Document(NamedTuple):
    """The content of a file, and what it leaves out or approximates."""

    content: str | bytes
    notes: Sequence[Note]


class Heading(NamedTuple):
    """What a file is made of."""

    scene: str
    drawn: bool  # whether episodes draw some of its numbers
    function: str  # what the name of a function begins with

    def lines(self, about: Sequence[str], notes: Sequence[Note]) -> list[str]:
        """The head of a file, line by line."""
        lines = [f"Made by redundant-envs {__version__} from {plain(self.scene)}.", *about]
        lines += ["Numbers that episodes draw have their nominal values."] if self.drawn else []
        return [*lines, *(["Approximate:", *(f"  {note}" for note in notes)] if notes else [])]


PYBULLET = "PyBullet takes moments of inertia from it only with flags=URDF_USE_INERTIA_FROM_FILE."


def refuse_inexact(notes: Sequence[Note], form: str, approximate: bool) -> None:
    """ValueError with all notes, unless the document may be approximate."""
    if notes and not approximate:
        listed = "; ".join(f"{note.name} ({note.reason})" for note in notes)
        raise ValueError(
            f"{form} cannot express parts of this scene exactly: {listed}; change the scene, or add "
            "--approximate (in Python approximate=True)"
        )


def named(effect: Effect, scene: Scene) -> str:
    """An effect in messages: its class, and what tells it from others of this class."""
    kind = type(effect).__name__
    alike = [other for other in scene.effects if type(other) is type(effect)]
    return kind if len(alike) == 1 else f"{kind} {effect.key.partition('.')[2] or effect.key}"


def plain(text: str) -> str:
    """A text of a user without what is not printable: XML has no such characters."""
    return "".join(c if c.isprintable() else "?" for c in text)


def numbers(*values: float) -> str:
    """Numbers of XML that are read back to the last bit."""
    return " ".join(repr(float(x) + 0.0) for x in values)


def xml(root: ET.Element, head: Iterable[str], notes: Sequence[Note]) -> Document:
    """An XML document, with the lines of its head as a comment."""
    text = "\n    ".join(head)
    while "--" in text:  # not allowed in a comment
        text = text.replace("--", "- -")
    root.insert(0, ET.Comment(f" {text} "))
    for element in root.iter():
        element.attrib.update({name: plain(value) for name, value in element.attrib.items()})
    ET.indent(root)
    return Document(f'<?xml version="1.0"?>\n{ET.tostring(root, encoding="unicode")}\n', notes)


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
    heading = Heading(source, bool(scene.randomize), function or name or scene.robot.kind)
    writer: Callable[[Scene, Heading, bool], Document] = resolve_name(f"{__package__}.{FORMATS[form]}")
    return writer(scene, heading, approximate)


def write(scene: Scene, form: str, path: Path, approximate: bool = False, name: str = "") -> Sequence[Note]:
    """Write the same to a file, whose folder is made, and return what it leaves out. OSError if that cannot
    be done. The function of a C file is called by the file."""
    output = document(scene, form, approximate, name, path.stem)
    write_bytes(path, output.content if isinstance(output.content, bytes) else output.content.encode())
    return output.notes
