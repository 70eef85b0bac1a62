"""The folder of the application, whose modules are imported as ``redundant_envs_train``."""
