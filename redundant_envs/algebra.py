"""The name by which users import the physics dialect: :mod:`redundant_envs.language.algebra`."""

import sys

from redundant_envs.language import algebra
from redundant_envs.language.algebra import *  # noqa: F403 - for type checkers

sys.modules[__name__] = algebra
