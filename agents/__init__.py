"""Train, evaluate, play and report policies: an application on top of redundant_envs.

In a checkout it is the module ``agents``; a wheel ships it as ``redundant_envs_train``. So modules in
here import each other relatively.
"""

from .naming import COMMAND, command

__all__ = ["COMMAND", "command"]
