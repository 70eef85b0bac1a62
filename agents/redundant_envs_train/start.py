"""The policy with which a training begins: its file, and checks that need not open it."""

import hashlib
from pathlib import Path

from redundant_envs.support.bounded import MAX_PACKED, opened
from redundant_envs.support.values import shown

from .config import Config
from .run_folder import read_config

KINDS = {"plain_ppo": "ppo", "plain_sac": "sac", "her": "sac"}
"""Algorithms whose policies are those of another one."""


def policy_file(start: str) -> Path:
    """The file that ``start_from`` names: a policy.zip, or that of a run or an exported policy."""
    path = Path(start)
    file = path / "policy.zip" if path.is_dir() else path
    if not file.is_file():
        raise ValueError(
            f"start_from is {shown(start)}; there is no {file}: give a run folder, the folder of an exported "
            "policy, or a policy.zip"
        )
    return file


def with_start(config: Config) -> Config:
    """A configuration with the hash of the policy that it starts from; ValueError if that policy cannot be
    found, or is of another hash, algorithm or networks."""
    if config.start_from is None:
        return config
    file = policy_file(config.start_from)
    with opened(file, "start_from", MAX_PACKED) as data:
        digest = hashlib.file_digest(data, "sha256").hexdigest()
    if config.start_from_sha256 not in (None, digest):
        raise ValueError(
            f"start_from is {shown(config.start_from)}, whose policy.zip has the SHA-256 {digest}, and "
            f"start_from_sha256 is {config.start_from_sha256}; give that file, or leave the hash out"
        )
    chosen = config.model_copy(update={"start_from_sha256": digest})
    if not (file.parent / "config.yaml").is_file():
        return chosen
    other = read_config(file.parent)  # refuse early, before long imports, what would be refused later
    if KINDS.get(other.algo, other.algo) != KINDS.get(config.algo, config.algo):
        raise ValueError(f"start_from is a policy of {other.algo}, and algo is {config.algo}; give one of it")
    for name in ("net_arch", "activation"):
        theirs, own = (c.settings.model_dump(mode="json")[name] for c in (other, config))
        if theirs != own:
            raise ValueError(
                f"start_from has {name} {theirs}, and {config.algo}.{name} is {own}; give "
                f"{config.algo}.{name}={str(theirs).replace(' ', '')}"
            )
    return chosen
