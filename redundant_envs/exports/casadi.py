"""The equations of motion of a scene as a function of CasADi."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from redundant_envs.algebra import entries, numbered
from redundant_envs.backends.casadi import ca
from redundant_envs.exports.document import Document, Heading, Note
from redundant_envs.exports.motion import quantities_of, smooth_scene
from redundant_envs.scene import Scene


def casadi_function(scene: Scene, approximate: bool = False) -> Any:
    """The equations of motion as a ``casadi.Function``, with the numbers of the scene.

    Inputs are ``q``, ``qd`` and ``efforts`` (the motors' commands, N m and N); outputs ``qdd``, ``M``, ``h``,
    ``G``, ``tip`` and ``J``, with the shapes (n), (n, n), (n), (n), (2) and (2, n).

    Raises
    ------
    ValueError
        If effects have states or jumps, and the result is not to be ``approximate``.
    MissingPackage
        If CasADi is not installed.
    """
    return _function(scene, approximate)[0]


def _function(scene: Scene, approximate: bool) -> tuple[Any, list[Note]]:
    smooth, notes = smooth_scene(scene, "CasADi", approximate)
    n = len(scene.robot.joints)
    inputs = [ca.SX.sym(name, n) for name in ("q", "qd", "efforts")]
    qdd, x = quantities_of(smooth, *(ca.vertsplit(column) for column in inputs))
    outputs = {
        "qdd": _column(qdd),
        "M": _matrix(x.each(entries("M", n, n)), n),
        "h": _column(x.each(numbered("h{}", n))),
        "G": _column(x.each(numbered("G{}", n))),
        "tip": _column(x.each(("tip_x", "tip_y"))),
        "J": _matrix(x.each(entries("J", 2, n)), n),
    }
    function = ca.Function("dynamics", inputs, [*outputs.values()], ["q", "qd", "efforts"], [*outputs])
    return function, notes


def _column(values: list[Any]) -> Any:
    return ca.vertcat(*map(ca.SX, map(_number, values)))


def _matrix(values: list[Any], columns: int) -> Any:
    rows = (values[i : i + columns] for i in range(0, len(values), columns))
    return ca.horzcat(*map(_column, rows)).T


def _number(value: Any) -> Any:
    """What is absent, such as the weight without gravity, as 0."""
    return value if isinstance(value, ca.SX) else float(value)


def serialised(scene: Scene, heading: Heading, approximate: bool) -> Document:
    """The function as CasADi stores it; ``casadi.Function.load`` reads such a file."""
    function, notes = _function(scene, approximate)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "dynamics.casadi"
        function.save(str(path))
        return Document(path.read_bytes(), notes)
