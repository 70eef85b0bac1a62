"""Train, evaluate, play and report policies: an application on top of redundant_envs.

In a checkout it is the module ``agents``; a wheel ships it as ``redundant_envs_train``. So modules in
here import each other relatively.
"""

COMMAND = "python -m agents" if __name__ == "agents" else "redundant-envs-train"
"""What a user types to run this application."""
