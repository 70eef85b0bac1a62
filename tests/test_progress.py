"""Progress on standard error: a bar on a terminal, lines elsewhere."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys

import pytest

from redundant_envs.progress import counted

PROGRAM = """
from redundant_envs.progress import counted
with counted("parts", 2) as done:
    done("the first")
    print("a result")
    done("the second")
"""
HIDE = "import importlib.util as u; f = u.find_spec; u.find_spec = lambda n: None if n == 'rich' else f(n)\n"


def test_each_part_is_a_line(capsys):
    with counted("parts", 4, each=2) as done:
        for name in "abcd":
            done(name)
    assert capsys.readouterr() == ("", "parts 1/2: b\nparts 2/2: d\n")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pty")
@pytest.mark.parametrize("blocked", [False, True], ids=["rich", "without rich"])
def test_a_terminal_has_a_bar_if_rich_is_installed(blocked):
    if not blocked and importlib.util.find_spec("rich") is None:
        pytest.skip("rich is in the extras 'train' and 'verify'")
    import pty

    ours, theirs = pty.openpty()
    command = [sys.executable, "-c", HIDE * blocked + PROGRAM]
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "100"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=theirs, env=environment) as process:
        os.close(theirs)
        shown = b""
        with open(ours, "rb", buffering=0) as terminal:
            try:
                while some := terminal.read(4096):
                    shown += some
            except OSError:  # the other end is closed
                pass
        assert process.stdout.read() == b"a result\n"
    assert b"the second" in shown
    assert (b"100 %" in shown) != blocked
