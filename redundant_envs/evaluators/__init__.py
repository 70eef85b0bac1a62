"""The dialect evaluated: assembled and compiled, on arrays, on symbols."""

from redundant_envs.evaluators.assemble import source

__all__ = ["source"]
