"""What counts as a number: real ones, of Python or NumPy, and nothing that merely converts to one."""

import json
from dataclasses import dataclass

import numpy as np
import pytest
from envs.faces import FACES, begin, made

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.language.algebra import physics

SCENE = "rprp_reach"
NONE = {
    "true": True,
    "truth of NumPy": np.True_,
    "a truth among numbers": [1.0, True, 1.0, 1.0],
    "an array of a truth among numbers": [np.array(True), 1, 1, 1],
    "array of truths": np.ones(4, dtype=bool),
    "a row of truths": [[1.0] * 4, np.ones(4, dtype=bool)],
    "array of objects": np.array([1.0] * 4, dtype=object),
    "text": "1",
    "complex": 1.0 + 0.0j,
    "nothing": None,
    "date": np.array(["2020-01-01"], dtype="M8[D]"),
}


@pytest.fixture(scope="module")
def faces():
    """What sets parameters: the face of two lanes -> a function of a name and its value."""
    batch = rde.BatchSimulator(rde.load_scene(SCENE), 2)
    env, venv, sb3 = (made(kind, "redundant_envs/RPRPReach-v0", 2) for kind in FACES)
    return {
        "batch": lambda name, value: batch.set_parameters({name: value}),
        "a lane": lambda name, value: batch.set_parameters({name: value}, index=[0]),
        "env": lambda name, value: begin(env, {"parameters": {name: value}}),
        "vector env": lambda name, value: begin(venv, {"parameters": {name: value}}),
        "sb3": lambda name, value: begin(sb3, {"parameters": {name: value}}),
        "sb3, one by one": lambda name, value: begin(sb3, [{}, {"parameters": {name: value}}]),
    }


@pytest.mark.parametrize("what", NONE)
@pytest.mark.parametrize("face", ["batch", "a lane", "env", "vector env", "sb3", "sb3, one by one"])
def test_parameters_are_real_numbers_on_every_face(faces, face, what):
    for name in ("masses", "viscous_friction.coefficients", "gravity.g"):
        with pytest.raises(ValueError, match=rf"{name}.* (is|give) .*real numbers|give"):
            faces[face](name, NONE[what])
        if face.startswith("sb3"):
            faces["sb3"]("gravity.g", 9.81)


damping = physics(lambda rate, k: -k * rate)


@dataclass(frozen=True)
class Damper(e.Effect):
    """An effect of a user that checks none of its numbers."""

    k: float
    ks: tuple[float, ...] = (0.1, 0.2)
    c: float | tuple[float, ...] = 0.0
    joint: int = 0
    of_joints = ("c",)
    static = ("joint",)

    def hooks(self, arm):
        names = (".k", ".ks[0]", ".ks[1]", *(f".c[{k}]" for k in range(4)))
        return tuple(e.Force(self.joint, damping, {"rate": f"phid{self.joint + 1}", "k": n}) for n in names)


rde.register_effect(Damper)
KINDS = [np.float32, np.float64, np.int64, np.uint8, lambda x: np.array(x, dtype=np.float32)]


@pytest.mark.parametrize("kind", KINDS, ids=["float32", "float64", "int64", "uint8", "array of none"])
def test_numbers_of_numpy_are_numbers(kind):
    """In single fields, in tuples, in fields of joints and as whole arrays; plain ones are kept."""
    arm = rde.RPRP((kind(1), 1.0, kind(2), 1.0), (1.0, kind(1)))
    effect = Damper(kind(2), (kind(1), 3.0), kind(1), np.int64(1))
    array = Damper(2.0, np.array([1.0, 3.0], dtype=np.float32), np.array([kind(1)] * 4), 1)
    plain = rde.Scene(rde.RPRP((1.0, 1.0, 2.0, 1.0), (1.0, 1.0)), (Damper(2.0, (1.0, 3.0), 1.0, 1),))
    for given in (effect, array):
        scene = rde.Scene(arm, (given,), control_dt=np.float64(0.02))
        assert scene == plain
        assert rde.Scene.from_dict(json.loads(json.dumps(scene.to_dict()))) == plain
        kept = scene.effects[0]
        assert {type(x) for x in (kept.k, *kept.ks, *kept.c, *scene.parameters().values())} == {float}
        assert type(kept.joint) is int
