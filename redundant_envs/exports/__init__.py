"""Scenes for other programs: MuJoCo and URDF readers, CasADi, C. What has no exact counterpart there is
refused by its name, or left out and noted."""
