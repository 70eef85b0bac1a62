"""Listings and bills of simulators: only the named effects, each operation with its source."""

import functools
import re
from dataclasses import dataclass
from pathlib import Path

import pytest
from catalogue import ARMS, e, every_effect

import redundant_envs as rde
from redundant_envs.effects.hooks import Effect, Force
from redundant_envs.language.algebra import physics, sqrt
from redundant_envs.model.listing import OF_ENVIRONMENT

ROOT = Path(rde.__file__).parents[1]
FOUR_R, RPRP = ARMS["4R"], ARMS["RPRP"]
STAGES = {"euler": 1, "rk4": 4, "rk8": 12}
OF_ANY_MOTION = {"arm", "integrator", "interval"}


@physics
def saturating(x, k):
    """Products 2, sum 1, root 1, quotient 1."""
    return -k * x / sqrt(1.0 + x * x)


@dataclass(frozen=True)
class SaturatingSpring(Effect):
    k: float = 2.0

    def hooks(self, arm):
        return (Force(0, saturating, {"x": "phi1", "k": ".k"}),)


EFFECTS = {arm.kind: (SaturatingSpring(), *every_effect(arm)) for arm in (RPRP, FOUR_R)}


def scene(arm=FOUR_R, effects=(), integrator="rk4", **kwargs):
    return rde.Scene(arm, effects, integrator, **kwargs)


def words_of(effect):
    """Names in the listing of a scene if an effect acts there: its functions, file and numbers."""
    if isinstance(effect, e.Gravity):
        return (r"\bax\b", r"\bay\b")  # its field follows from its numbers alone, and is found with them
    own = [f"{effect.key}.{name}" for name in effect.parameters()]
    return (rf" for {re.escape(effect.key)},", *(rf"\b{name}\b" for name in own))


@pytest.mark.quick("RPRP-0")
@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("arm", [RPRP, FOUR_R], ids=["RPRP", "FourR"])
def test_every_second_effect_has_lines_and_entries_and_the_others_none(arm, first):
    own, others = EFFECTS[arm.kind][first::2], EFFECTS[arm.kind][1 - first :: 2]
    made = scene(arm, own, "euler")
    text = rde.listing(made)
    assert {*rde.bill(made)} - {*OF_ENVIRONMENT} == OF_ANY_MOTION | {x.key for x in made.effects}
    for effect in own:
        assert any(re.search(word, text) for word in words_of(effect))
    for effect in others:
        assert not any(re.search(word, text) for word in words_of(effect)), effect
        file = effect.key.partition(".")[0]
        assert any(x.key.startswith(file) for x in own) or f"{file}.py" not in text


def test_a_bare_arm_has_no_file_of_effects():
    text = rde.listing(scene())
    assert "redundant_envs/effects/" not in text
    assert {*rde.bill(scene())} - {*OF_ENVIRONMENT} == OF_ANY_MOTION
    assert "motor_map" in text
    assert "motor_map" not in rde.listing(scene(actuation="generalized"))


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
        names = [n for n in code.co_qualname.split(".<locals>.") if not n.startswith("<")]
        found.setdefault(names[-1] if names else "", set()).update(line for *_, line in code.co_lines())
        waiting += [c for c in code.co_consts if hasattr(c, "co_qualname")]
    return found


SHOWN = {"rk4": scene(FOUR_R, EFFECTS["FourR"]), "stops": scene(RPRP, EFFECTS["RPRP"], "rk8", tolerance=1e-6)}


@pytest.mark.quick("rk4")
@pytest.mark.parametrize("made", SHOWN.values(), ids=SHOWN)
def test_an_operation_stands_under_a_function_a_file_and_a_line_that_asked_for_it(made):
    """The source line of an operation of an arm or of an effect contains its operator."""
    count, looked_at, keys = 0, 0, {None, *(x.key for x in made.effects)}
    text = rde.listing(made)
    assert "model/listing.py" not in text
    for place, operation, first in operations(text):
        assert place is not None, operation
        number = int(place["line"])
        assert number in lines_of_functions(ROOT / place["file"])[place["function"]], place[0]
        assert place["owner"] in keys
        count += 1
        if first and operation in "+-*/" and re.search("robots/|effects/|tests/", place["file"]):
            line = (ROOT / place["file"]).read_text(encoding="utf-8").splitlines()[number - 1]
            assert operation in line, f"{place[0]}: {line}"
            looked_at += 1
    assert (count > 500, looked_at > 9) == (True, True)


def test_numbers_of_the_scene_are_shown_by_their_names():
    """The work, if it is tracked."""
    text = rde.listing(SHOWN["rk4"])
    for name in ("theta1", "l4", "tip4", "command3", r"saturating_spring\.k", "ax"):
        assert re.search(rf"= {name}$", text, re.MULTILINE), name
    for name in (*FOUR_R.coordinates, *FOUR_R.rates):
        assert f"  {name} <- %" in text
    assert "work <-" not in text
    assert "work <- %" in rde.listing(SHOWN["rk4"], track_work=True)


def kinds(*counts, size):
    """Additions, products, divisions, roots, sine pairs, comparisons, selections, and bytes."""
    return (*counts, *(0,) * (7 - len(counts)), size)


@pytest.mark.quick("euler")
@pytest.mark.parametrize("integrator", STAGES)
def test_the_bill_is_what_a_hand_counts_and_grows_with_the_stages(integrator):
    n = STAGES[integrator]
    once = n if integrator == "rk8" else 1  # what is equal at all stages, unless a stage is a subroutine
    for arm, effect, expected in (
        (FOUR_R, SaturatingSpring(), kinds(n, 2 * n, n, n, size=8)),
        (FOUR_R, e.ViscousFriction(0.1), kinds(0, 4 * n, size=32)),  # -c rate, four times
        # The sides of the depth and of the speed are known from the law; the last comparison is a maximum.
        (FOUR_R, e.LimitSpring("joint2", -1.0, 1.0), kinds(2 * n, 2 * n, 0, 0, 0, n, 4 * n, size=32)),
        (RPRP, e.CentringSpring((1, 1), (0, 0), (1, 1)), kinds(6 * n, 4 * n, size=48)),
        (FOUR_R, e.EffortLimits(1.0), kinds(0, 0, 0, 0, 0, 8 * once, 8 * once, size=32)),
        (FOUR_R, e.Gravity(), kinds(4 * n, 4 * n, 0, 0, n, size=24)),  # turned to the first link, and added
    ):
        assert rde.bill(scene(arm, (effect,), integrator))[effect.key] == expected, effect
    arm = rde.bill(scene(FOUR_R, (e.Gravity(),), integrator))["arm"]
    assert arm.sine_pairs == 3 * n  # of the differences; gravity needs the first link's
    assert arm.divisions == 3 * n
    assert arm.bytes == 8 * (4 + 4 + 4 + 4)  # coordinates, rates, masses, lengths
    if integrator == "euler":  # two sums and products for each coordinate
        assert rde.bill(scene(FOUR_R, integrator="euler"))["integrator"] == kinds(8, 8, size=0)


@pytest.mark.parametrize("limits", [(), (e.EffortLimits(1.0),)], ids=["without motors", "with motors"])
def test_scenes_that_are_no_environments_have_no_entries_of_one(limits):
    loose = scene(RPRP, limits)
    assert set(rde.bill(loose)) == OF_ANY_MOTION | {x.key for x in limits}
    with pytest.raises(ValueError, match="the reach task needs limited travel of 'r1'"):
        rde.bill(loose, task=rde.ReachTask())
    still = rde.bill(scene(FOUR_R, limits))
    assert ("action" in still) == bool(limits)
    assert {"observation", "reward", "reset"} <= set(still)
