"""A lane of a scene on numbers of any kind that the physics dialect knows: floats, or mpmath's."""

from redundant_envs.lane.interval import Interval
from redundant_envs.lane.memory import Lane


def constants(dynamics, number):
    """Everything that is constant in a step of a scene but the efforts."""
    parameters = {name: number(value) for name, value in dynamics.parameters.items()}
    return parameters | dynamics.prepare(parameters)


def lane_of(dynamics, state, efforts, number):
    """A lane with a state and efforts, and the parameters of its scene."""
    known = constants(dynamics, number)
    for names, values in ((dynamics.states, state), (dynamics.commands, efforts)):
        known |= dict(zip(names, map(number, values), strict=True))
    return Lane(Interval(dynamics).layout(), known.__getitem__)
