"""A stop of one slider with its own restitution."""

from dataclasses import dataclass

from redundant_envs.effects import Effect, Impact


@dataclass(frozen=True)
class Bumper(Effect):
    """Stops of one slider with its own restitution."""

    joint: int = 1
    upper: float = 0.2
    lower: float = 0.0
    restitution: float = 0.0

    static = ("joint",)

    @property
    def key(self):
        return f"bumper{self.joint}"

    def hooks(self, arm):
        return (Impact(self.joint, ".lower", ".upper", ".restitution"),)
