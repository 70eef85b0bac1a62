"""The list of mended faults fits the code: each can be brought back, and its test is there."""

import ast
import re

import pytest

from tests.mutation import __main__ as mutation

from .__main__ import HEAD, MAX_UNSEEN, PAGE, ROOT, TAIL, body_of, faults, is_long, listed, main

FAULTS = faults()


def test_there_are_many_of_different_names():
    assert len({fault.name for fault in FAULTS}) == len(FAULTS) >= 60
    assert len({(fault.file, fault.old, fault.new) for fault in FAULTS}) == len(FAULTS)


@pytest.mark.parametrize("fault", FAULTS, ids=[fault.name for fault in FAULTS])
def test_a_fault_can_be_brought_back_and_has_a_test(fault):
    assert fault.file.startswith(("redundant_envs/", "agents/"))
    text = (ROOT / fault.file).read_text(encoding="utf-8")
    assert len(fault.places(text)) == 1, "the snippet must occur once: renew it"
    with_fault = fault.brought_back(text)
    assert ast.dump(ast.parse(with_fault)) != ast.dump(ast.parse(text))
    path, function = re.match(r"(tests/.*\.py)::(\w+)(\[.*\])?$", fault.test).group(1, 2)
    assert function in {test.name for test in body_of(path) if isinstance(test, ast.FunctionDef)}


def test_a_part_of_no_name_is_refused_and_no_test_runs(monkeypatch, capsys):
    for name in ("outcome", "in_copies"):
        monkeypatch.setitem(main.__globals__, name, lambda *given, **more: "green")
    assert main(["--help"]) == 2
    assert capsys.readouterr().err == "the name of no fault has --help in it\n"


def test_make_test_sees_most_faults_and_the_page_lists_the_others():
    unseen = [fault.name for fault in FAULTS if is_long(fault.test)]
    assert len(unseen) <= MAX_UNSEEN * len(FAULTS)
    page = PAGE.read_text(encoding="utf-8")
    assert f"{HEAD}{listed()}{TAIL}" in page, "renew it: python -m tests.faults --list"


def test_mutants_are_drawn_from_modules_and_seen_by_tests_that_there_are():
    places = [*(ROOT / mutation.PACKAGE / f"{module}.py" for module in mutation.MODULES), *mutation.TESTS]
    assert [str(place) for place in places if not (ROOT / place).exists()] == []
