"""Programs outside Python that the tests of WebAssembly run."""

import os
import shutil
import subprocess

import pytest

from redundant_envs.tasks import ReachTask
from redundant_envs.web import module

REQUIRED = "REDUNDANT_ENVS_TEST_PAGE"
"""The variable with which a missing program is a failure: ``make test-page`` sets it."""
FLAGS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip
"""Of Chromium: it asks for nothing by itself."""


def missing(what):
    (pytest.fail if os.environ.get(REQUIRED) else pytest.skip)(f"make test-page requires {what}")


def program(*names):
    """The path of the first of some programs that is installed; without any the test is skipped."""
    return next(filter(None, map(shutil.which, names)), None) or missing(f"one of {', '.join(names)}")


@pytest.fixture(scope="session")
def node():
    """Run Node.js; its output."""
    path = program("node", "nodejs")
    return lambda *words, **how: (
        subprocess.run([path, *words], capture_output=True, text=True, check=True, **how).stdout
    )


@pytest.fixture(scope="module")
def written(request, tmp_path_factory):
    """The folder of the module of one of the SCENES of a file, with its task of the TASKS, written once."""
    folders, tasks = {}, getattr(request.module, "TASKS", {})

    def write(name):
        if name not in folders:
            folders[name] = tmp_path_factory.mktemp(name)
            module.write(request.module.SCENES[name], tasks.get(name, ReachTask()), name, folders[name])
        return folders[name]

    return write


@pytest.fixture(scope="session")
def chromium():
    """A browser of Playwright, without a network."""
    path = program("chromium", "chromium-browser", "google-chrome", "chrome")
    try:
        from playwright.sync_api import sync_playwright
    except ModuleNotFoundError:
        missing("playwright, which it installs")
    with sync_playwright() as playwright:
        # Playwright's flag would let a page change its address as often as it likes; browsers do not.
        own = ["--disable-ipc-flooding-protection"]
        browser = playwright.chromium.launch(executable_path=path, args=FLAGS, ignore_default_args=own)
        yield browser
        browser.close()
