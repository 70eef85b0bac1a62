"""Programs outside Python that the tests of WebAssembly run."""

import os
import shutil

import pytest

REQUIRED = "REDUNDANT_ENVS_TEST_PAGE"
"""The variable with which a missing program is a failure: ``make test-page`` sets it."""


def program(*names):
    """The path of the first of some programs that is installed; without any the test is skipped."""
    for name in names:
        if path := shutil.which(name):
            return path
    missing = f"none of {', '.join(names)} is installed, which make test-page requires"
    if os.environ.get(REQUIRED):
        pytest.fail(missing)
    pytest.skip(missing)


@pytest.fixture(scope="session")
def node():
    """The path of Node.js."""
    return program("node", "nodejs")
