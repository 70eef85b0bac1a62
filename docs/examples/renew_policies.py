"""Write the objects of a policy.zip so that stable-baselines3 loads it under NumPy 1 and 2:

python docs/examples/renew_policies.py policies/*/policy.zip

Weights and all other members keep their bytes. Like stable-baselines3, this unpickles the files, which runs
any code that their authors put in.
"""

import sys
import zipfile
from pathlib import Path

from stable_baselines3.common.save_util import json_to_data

from redundant_envs.support.disk import write_bytes
from redundant_envs_train.policies import portable


def renew(path):
    """Write a file again."""
    with zipfile.ZipFile(path) as archive:
        own = json_to_data(archive.read("data").decode())
    write_bytes(path, portable(path.read_bytes(), own))


if __name__ == "__main__":
    for name in sys.argv[1:]:
        renew(Path(name))
