"""Train, evaluate, play and report policies: an application on top of redundant_envs.

A wheel has this module beside ``redundant_envs``, under the same name. ``python -m agents`` runs it in a
checkout, ``redundant-envs-train`` where the package is installed.
"""

from .naming import COMMAND, command

__all__ = ["COMMAND", "command"]
