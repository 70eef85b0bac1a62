"""The equations of motion of a scene as a function of CasADi."""

import tempfile
from pathlib import Path
from typing import Any

from redundant_envs.exports.files import Document, Heading, Note
from redundant_envs.exports.motion import INPUTS, equations, smooth_scene
from redundant_envs.language.algebra import Primitives, register_numbers
from redundant_envs.scenes.scene import Scene
from redundant_envs.simulator.lane.direct import OPERATIONS, evaluate
from redundant_envs.support.extras import needs

with needs("casadi"):
    import casadi as ca

SYMBOLIC = Primitives(
    ca.sqrt, ca.exp, ca.log, ca.floor, lambda x: (ca.sin(x), ca.cos(x)), ca.if_else, ca.logic_not
)
register_numbers(SYMBOLIC._replace(expm1=ca.expm1), ca.SX)

OUTPUTS = ("qdd", "M", "h", "G", "tip", "J")
ON_CONDITIONS = {"and": ca.logic_and, "or": ca.logic_or, "xor": lambda a, b: a != b}
"""Operations for which CasADi's expressions have no operators in Python."""


def casadi_function(scene: Scene, approximate: bool = False) -> Any:
    """The equations of motion as a ``casadi.Function``, with the numbers of the scene.

    Inputs are ``q``, ``qd`` and ``commands``, those of the motors in the units of ``Scene.command_units()``;
    outputs ``qdd``, ``M``, ``h``, ``G``, ``tip`` and ``J``, with the shapes (n), (n, n), (n), (n), (2) and
    (2, n).

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
    inputs = {name: ca.SX.sym(name, n) for name in INPUTS}
    values = equations(smooth, *OUTPUTS)
    flat = [value for name in OUTPUTS for value in values[name]]
    entries = iter(evaluate(flat, lambda place: inputs[place[0]][place[1]], {**OPERATIONS, **ON_CONDITIONS}))
    outputs = []
    for name in OUTPUTS:
        column = ca.vertcat(*[ca.SX(next(entries)) for _ in values[name]])
        outputs.append(ca.reshape(column, n, -1).T if name in ("M", "J") else column)
    return ca.Function("dynamics", [*inputs.values()], outputs, [*INPUTS], [*OUTPUTS]), notes


def serialised(scene: Scene, heading: Heading, approximate: bool) -> Document:
    """The function as CasADi stores it; ``casadi.Function.load`` reads such a file."""
    function, notes = _function(scene, approximate)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "dynamics.casadi"
        function.save(str(path))
        return Document(path.read_bytes(), notes)
