"""Command line: python -m redundant_envs simulate | study | scene | list."""
