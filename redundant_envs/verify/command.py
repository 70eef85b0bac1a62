"""The command: tables of results, on standard output and in files."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from redundant_envs.progress import counted
from redundant_envs.scene import load_scene, scene_names
from redundant_envs.verify import recorded_bits, report
from redundant_envs.verify.checks import Mode, Verdict
from redundant_envs.verify.report import MACHINE, OF_THE_MACHINE, Report, checks_in
from redundant_envs.verify.subjects import Subject, subjects_of


def run(
    words: Sequence[str], states: int | None, mode: str, json_file: Path | None, markdown_file: Path | None
) -> int:
    """Verify the subjects of some words and write tables, on standard output and in files; returns 1 if a
    promise is broken."""
    chosen, subjects = Mode[mode.upper()], subjects_of(words)
    if states is not None and states < 1:
        raise ValueError(f"states is {states}; give at least 1")
    for file in (json_file, markdown_file):
        if file is not None and file.is_dir():
            raise ValueError(f"{file} is a folder; give a file to be written")
    reports: list[tuple[str, Report]] = []
    each = len(checks_in(chosen))
    machine = Subject(MACHINE, load_scene(scene_names()[0]))  # its checks do not look at the scene
    with counted("verify", len(subjects) * each + len(OF_THE_MACHINE), each) as done:
        for subject in (*subjects, machine):
            checks, title = (OF_THE_MACHINE, MACHINE) if subject is machine else (None, report.about(subject))
            reports.append((title, report.verify(subject, states, chosen, done, checks)))
            _show(*reports[-1])
    if json_file is not None:
        report.write(json_file, report.as_json(reports))
    if markdown_file is not None:
        report.write(markdown_file, report.markdown(reports))
    missed = sum(len(r.misses) for _, r in reports)
    kept = sum(o.verdict is Verdict.KEPT for _, r in reports for o in r.outcomes)
    print(f"{kept} promises kept, {missed} missed")
    if missed:
        print(f"redundant_envs: verify found {missed} broken promise{'s'[: missed > 1]}", file=sys.stderr)
    return int(missed > 0)


def _show(title: str, found: Report) -> None:
    print(f"{title}\n{report.text_table(found.outcomes)}")
    for note in report.notes(found.outcomes):
        print(f"  {title.partition(': ')[0]}: {note}")
    print(flush=True)


def compare_bits(everything: bool) -> int:
    """Print whether recorded motions have the same bits on this machine; returns 1 if one differs."""
    names = list(recorded_bits.RECORDED if everything else recorded_bits.SHORT)
    expected, same = recorded_bits.recorded(), 0
    with counted("recorded bits", len(names)) as done:
        for name in names:
            if recorded_bits.found(name) == expected[name]:
                same += 1
            else:
                print(f"{name}: other bits")
            done(name)
    print(f"{same} of {len(names)} recorded motions have the same bits on this machine")
    return int(same < len(names))
