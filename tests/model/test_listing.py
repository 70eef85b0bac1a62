"""Listings and bills of simulators: only the named effects, each operation with its source."""

import dataclasses
import functools
import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import pytest

import redundant_envs as rde
from redundant_envs.algebra import physics, sqrt
from redundant_envs.effects.hooks import Effect, Force
from redundant_envs.scene import identifier

e = rde.effects
ROOT = Path(rde.__file__).parents[1]
RPRP = rde.RPRP((2.3, 0.7, 1.9, 0.4), (1.1, 0.6))
FOUR_R = rde.FourR((2.3, 0.7, 1.9, 0.4), (1.1, 0.6, 0.9, 0.35))
STAGES = {"euler": 1, "rk4": 4, "rk8": 12}


@physics
def saturating(x, k):
    """Products 2, sum 1, root 1, quotient 1."""
    return -k * x / sqrt(1.0 + x * x)


@dataclass(frozen=True)
class SaturatingSpring(Effect):
    k: float = 2.0

    def hooks(self, arm):
        return (Force(0, saturating, {"x": "phi1", "k": ".k"}),)


SHARED = (
    e.Gravity(9.81, (0.1, -0.9)),
    e.ViscousFriction((0.3, 0.2, 0.1, 0.05)),
    e.EffortLimits((2.0, 1.0, 0.5, 0.25)),
    SaturatingSpring(),
)
EFFECTS = {
    "RPRP": (
        *SHARED,
        e.CentringSpring((20.0, 30.0), (0.0, -0.1), (0.3, 0.2)),
        e.LimitSpring("r1", 0.0, 0.1, 400.0, 3.0),
        e.PrismaticStop((0.0, 0.0), (0.3, 0.3), 0.5),
    ),
    "FourR": (*SHARED, e.LimitSpring("joint2", -0.3, 0.3, 60.0, 2.0)),
}
EVERY = [
    pytest.param(arm, effect, id=f"{arm.kind}-{effect.key}")
    for arm in (RPRP, FOUR_R)
    for effect in EFFECTS[arm.kind]
]


def scene(arm=FOUR_R, effects=(), integrator="rk4", **kwargs):
    return rde.Scene(arm, effects, integrator, **kwargs)


def test_every_effect_is_looked_at():
    assert {type(x).__name__ for found in EFFECTS.values() for x in found} >= {
        name for name, effect in e.REGISTRY.items() if effect.__module__.startswith("redundant_envs.")
    }


# ---- only the effects named ----------------------------------------------------------------------


def words_of(effect):
    """Names in the listing of a scene if an effect acts there: its functions, file and numbers."""
    if isinstance(effect, e.Gravity):
        return (r"\bax\b", r"\bay\b")  # its field follows from its numbers alone, and is found with them
    own = [identifier(f"{effect.key}.{name}") for name in effect.parameters()]
    return (rf" for {re.escape(effect.key)},", *(rf"\b{name}\b" for name in own))


@functools.cache
def all_effects(kind):
    """The listing and the bill of an arm with each of its effects."""
    made = scene({x.kind: x for x in (RPRP, FOUR_R)}[kind], EFFECTS[kind])
    return rde.listing(made), rde.bill(made)


@pytest.mark.parametrize(("arm", "effect"), EVERY)
def test_an_absent_effect_has_no_line_and_no_entry(arm, effect):
    full, bill = all_effects(arm.kind)
    rest = scene(arm, tuple(x for x in EFFECTS[arm.kind] if x is not effect))
    without = rde.listing(rest)
    assert any(re.search(word, full) for word in words_of(effect))
    for word in words_of(effect):
        assert not re.search(word, without), word
    assert f"{effect.key.partition('.')[0]}.py" not in without
    assert set(bill) - set(rde.bill(rest)) == {effect.key}


@pytest.mark.parametrize("arm", [RPRP, FOUR_R], ids=["RPRP", "FourR"])
def test_a_bare_arm_has_none_of_them(arm):
    text = rde.listing(scene(arm))
    for effect in EFFECTS[arm.kind]:
        for word in (*words_of(effect), "redundant_envs/effects/"):
            assert not re.search(word, text), word
    assert set(rde.bill(scene(arm))) == {"arm", "integrator", "interval"}
    assert "_differences.<locals>" in text  # of the efforts: Q = B t
    assert "_differences.<locals>" not in rde.listing(scene(arm, actuation="generalized"))


# ---- every operation is listed under its source --------------------------------------------------

PLACE = re.compile(r"  # (?P<function>\S+?)(?: for (?P<owner>\S+))?, (?P<file>.+):(?P<line>\d+)")
OPERATION = re.compile(r"  %\d+ = (?P<name>\S+) .+")


def operations(text):
    """(source, name, whether it is the first there) of the operations of a listing, except loads."""
    place, first = None, False
    for line in text.splitlines():
        if line.startswith("kernel "):
            return
        if line.startswith(("function ", "subroutine ")):
            place = None
        elif match := PLACE.fullmatch(line):
            place, first = match, True
        elif match := OPERATION.match(line):
            yield place, match["name"], first
            first = False


@functools.cache
def lines_of_functions(path):
    """Lines of the functions of a file, by the qualified name of each; as the compiler sees them."""
    found, waiting = {}, [compile(path.read_text(encoding="utf-8"), str(path), "exec")]
    while waiting:
        code = waiting.pop()
        found.setdefault(code.co_qualname, set()).update(line for *_, line in code.co_lines())
        waiting += [c for c in code.co_consts if hasattr(c, "co_qualname")]
    return found


SHOWN = {
    "rk4": scene(FOUR_R, EFFECTS["FourR"]),
    "stops": scene(RPRP, EFFECTS["RPRP"], "rk8", tolerance=1e-6),
    "dop853": scene(RPRP, EFFECTS["RPRP"][:5], "dop853"),
}


@pytest.mark.parametrize("name", SHOWN)
def test_every_operation_stands_under_a_function_a_file_and_a_line_that_exist(name):
    made, count = SHOWN[name], 0
    keys = {x.key for x in made.effects}
    for place, operation, _ in operations(rde.listing(made)):
        assert place is not None, operation
        functions = lines_of_functions(ROOT / place["file"])
        assert int(place["line"]) in functions[place["function"]], place[0]
        assert place["owner"] is None or place["owner"] in keys
        count += 1
    assert count > 500


@pytest.mark.parametrize("name", SHOWN)
def test_operations_stand_under_who_asked_for_them(name):
    """The source line of an operation of an arm or of an effect contains its operator."""
    text, looked_at = rde.listing(SHOWN[name]), 0
    assert "model/listing.py" not in text
    for place, operation, first in operations(text):
        if first and operation in "+-*/" and re.search("robots/|effects/|tests/", place["file"]):
            line = (ROOT / place["file"]).read_text(encoding="utf-8").splitlines()[int(place["line"]) - 1]
            assert operation in line, f"{place[0]}: {line}"
            looked_at += 1
    assert looked_at > 9


def test_numbers_of_the_scene_are_shown_by_their_names():
    """In the function of long steps, too."""
    for integrator in STAGES:
        text = rde.listing(scene(FOUR_R, SHARED, integrator))
        for name in ("theta1", "l4", "m2", "command3", "saturating_spring__k", "ax"):
            assert re.search(rf"= {name}$", text, re.MULTILINE), (integrator, name)
        for name in (*FOUR_R.coordinates, *FOUR_R.rates):
            assert f"  {name} <- %" in text
        assert "given[" not in text


# ---- the same for other numbers ------------------------------------------------------------------

OTHERS = {
    "masses and lengths": dataclasses.replace(SHOWN["rk4"], robot=rde.FourR((1,) * 4, (0.5,) * 4)),
    "effects": dataclasses.replace(
        SHOWN["rk4"], effects=(e.Gravity(1.6), e.ViscousFriction(0.0), *SHOWN["rk4"].effects[2:])
    ),
    "interval": dataclasses.replace(SHOWN["rk4"], control_dt=0.3),
}


@pytest.mark.parametrize("other", OTHERS.values(), ids=OTHERS)
def test_scenes_that_differ_in_numbers_only_are_listed_and_billed_alike(other):
    assert rde.listing(other) == rde.listing(SHOWN["rk4"])
    assert rde.bill(other) == rde.bill(SHOWN["rk4"])


def test_scenes_that_differ_in_more_are_not():
    here = SHOWN["rk4"]
    more = {
        rde.listing(dataclasses.replace(here, **change))
        for change in ({}, {"integrator": "euler"}, {"substeps": 2}, {"actuation": "generalized"})
    }
    assert len(more) == 4
    assert "work <- %" in rde.listing(here, track_work=True)
    assert "work <-" not in rde.listing(here)


# ---- the bill ------------------------------------------------------------------------------------


def counted(integrator, *effects, arm=FOUR_R, **kwargs):
    """The entry of the last of some effects."""
    return rde.bill(scene(arm, effects, integrator, **kwargs))[effects[-1].key]


@pytest.mark.parametrize("integrator", STAGES)
def test_the_bill_of_an_effect_is_what_a_hand_counts(integrator):
    n = STAGES[integrator]
    found = functools.partial(counted, integrator)
    assert found(SaturatingSpring()) == (n, 2 * n, n, n, 0, 8)
    assert found(e.ViscousFriction(0.1)) == (0, 4 * n, 0, 0, 0, 32)  # -c rate, four times
    assert found(e.LimitSpring("joint2", -1.0, 1.0)) == (2 * n, 2 * n, 0, 0, 0, 32)
    assert found(e.CentringSpring((1, 1), (0, 0), (1, 1)), arm=RPRP) == (6 * n, 4 * n, 0, 0, 0, 48)
    assert found(e.EffortLimits(1.0)) == (0, 0, 0, 0, 0, 32)  # comparisons are not counted
    assert found(e.Gravity()) == (4 * n, 4 * n, 0, 0, n, 24)  # (ax, ay) turned to the first link, and added
    assert found(e.PrismaticStop((0, 0), (1, 1)), arm=RPRP)[:5] == (0, 0, 0, 0, 0)


@pytest.mark.parametrize("integrator", STAGES)
def test_the_bill_of_an_arm_grows_with_the_stages(integrator):
    arm = rde.bill(scene(FOUR_R, (e.Gravity(),), integrator))["arm"]
    assert arm.sine_pairs == 3 * STAGES[integrator]  # of the differences; gravity needs the first link's
    assert arm.divisions == 3 * STAGES[integrator]
    assert arm.bytes == 8 * (4 + 4 + 4 + 4)  # coordinates, rates, masses, lengths


def test_an_euler_step_is_two_sums_and_products_for_each_coordinate():
    assert rde.bill(scene(FOUR_R, integrator="euler"))["integrator"] == (8, 8, 0, 0, 0, 0)


@pytest.mark.parametrize("integrator", ["euler", "rk4"])
@pytest.mark.parametrize("substeps", [1, 3])
def test_the_bill_is_the_sum_of_the_listed_step(integrator, substeps):
    """A step is counted once, however often it is made in an interval."""
    made = scene(FOUR_R, EFFECTS["FourR"], integrator, substeps=substeps)
    text = rde.listing(made)
    step = text[text.index("function step:" if substeps > 1 else "function interval:") :]
    step = step[: step.index("kernel ")]
    step = step[: step.find("\nfunction ") + 1 or None]
    seen = Counter(name for place, name, _ in operations(step) if place["function"] != "sincos")
    total = [sum(column) for column in zip(*rde.bill(made).values(), strict=True)]
    assert total[:4] == [seen["+"] + seen["-"], seen["*"], seen["/"], seen["sqrt"]]
    assert len(re.findall(r"= bit 1 ", step)) == total[4]
