"""Single numbers, arrays, tensors and compiled code agree, through events, too.

``verify`` compares them on every scene of the catalogue; bounds here are tighter, and tensors are included.
"""

import pytest
from catalogue import SCENES, names

import redundant_envs.compiler.backends.torch  # noqa: F401
from redundant_envs.verify import Subject
from redundant_envs.verify.checks import Sample
from redundant_envs.verify.evaluators import arrays, singles, tensors

SHORT = ("RP every effect 1e-6", "RPRP users' play 1e-6")
EVERY = names("4R all*", "RPRP *rk8", "RPRP *1e-6", "RP *", "stops *", "*dop853")


@pytest.mark.quick("RPRP users' play 1e-6")
@pytest.mark.parametrize(
    "name", [*SHORT, *(pytest.param(n, marks=pytest.mark.long) for n in EVERY if n not in SHORT)]
)
def test_evaluators_agree_after_an_interval(name):
    trial = Sample(Subject(name, SCENES[name]), 40, 3)
    found = {check.name: check.run(trial).finding for check in (arrays, singles, tensors)}
    assert {name: f for name, f in found.items() if not f.found <= 1e-12} == {}
