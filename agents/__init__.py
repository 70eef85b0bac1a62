"""Train, evaluate, play and report policies: an application on top of redundant_envs."""
