"""Every case finds its mistakes: deliberately naive variants fail it."""

import math

import naive
import numpy as np
import pytest
from hard_case import Case, all_cases, at_least, at_most, check
from subject import Subject

CASES = all_cases()
PAIRS = [(case, variant) for case in CASES for variant in case.variants]
OF_THE_INTERFACE = {"16", "17", "30", "47"}
"""Cases about refusals and flags, which no variant has."""


@pytest.mark.parametrize(("case", "variant"), PAIRS, ids=[f"{c.number}-{v.name}" for c, v in PAIRS])
def test_a_naive_variant_fails_its_case(case, variant):
    with np.errstate(all="ignore"):
        passes = all(figure.kept for figure in case.measure(variant()))  # until the first that is missed
    assert not passes, f"{variant.name} passes {case.name}"


def test_every_numerical_case_names_a_variant_and_every_variant_has_a_case():
    without = {case.number for case in CASES if not case.caught and not case.waiting_for}
    assert without == OF_THE_INTERFACE
    assert {variant for _, variant in PAIRS} == set(naive.VARIANTS)


def test_the_catalogue_is_complete():
    """The 42 cases with 27b, but for single precision (35), which this package does not have; and families
    that were found later."""
    numbers = {case.number for case in CASES}
    assert numbers == {str(k) for k in range(1, 50) if k != 35} | {"27b"}
    names = [case.measure.__name__ for case in CASES]
    assert len(set(names)) == len(names)
    for case, name in zip(CASES, names, strict=True):
        assert name.startswith(f"test_{case.number.zfill(2 + case.number.endswith('b'))}_")


def test_a_missed_promise_says_which_case_and_by_how_much():
    case = Case("3", None, "three links", "hard", "naive")
    check(case, [at_most("the error", 1e-14, 1e-13), at_least("impacts", 3, 3)])
    with pytest.raises(AssertionError) as error:
        check(case, [at_most("the error of qdd", 3e-5, 1e-13, "m"), at_least("n", 1, 2)])
    assert str(error.value) == (
        "case 3, three links: the error of qdd is 3e-05 m, at most 1e-13 m is promised\n"
        "case 3, three links: n is 1, at least 2 is promised"
    )
    assert not any(promise("nothing", math.nan, 1.0).kept for promise in (at_most, at_least))


def test_a_variant_is_this_package_but_for_its_mistake():
    """Its other results are inherited."""
    for variant in naive.VARIANTS:
        assert issubclass(variant, Subject)
        own = {name for base in variant.__mro__[: variant.__mro__.index(Subject)] for name in vars(base)}
        assert own & {"accelerations", "motion", "keep", "instants", "restore"}
        assert variant.__doc__
        assert variant.name != Subject.name
