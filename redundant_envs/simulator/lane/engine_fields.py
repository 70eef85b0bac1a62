"""Fields that a lane has once, whatever its arm, effects and task."""

from __future__ import annotations

from collections.abc import Iterator

from redundant_envs.simulator.lane.fields import PARAMETER, STATE, EngineField, Variable


class EngineFields:
    """The fields of the engine, by what sets them."""

    __slots__ = ()

    # ---- the interval
    interval = EngineField("s", "control interval", PARAMETER)
    h = EngineField("s", "length of the common step", PARAMETER)
    tip_tolerance = EngineField("SI", "parameter of the scene", PARAMETER)
    least_step_rate = EngineField("SI", "follows from parameters alone", PARAMETER)
    work = EngineField("J", "work of motors and of forces without a potential", STATE, book=True)
    error = EngineField("m", "estimated tip error of the interval so far")
    fault = EngineField("", "faults of the interval")
    evaluations = EngineField("", "evaluations of the right-hand side")

    # ---- its pieces, and attempts at all of them
    piece_end = EngineField("s", "end of the present piece of the interval")
    attempts = EngineField("", "times that the interval was crossed")
    again = EngineField("", "the interval has to be crossed again", truth=True)
    longest_step = EngineField("s", "longest step allowed in this attempt")
    divisions = EngineField("", "steps of the piece")
    shortest_step = EngineField("s", "shortest step of pieces with several")
    steps_taken = EngineField("", "steps of the pieces before")
    error_carried = EngineField("m", "error at the start of the piece")
    unsure = EngineField("", "the error of a piece so far may exceed its estimate", truth=True)
    carries_doubt = EngineField("", "one did at the start of the piece", truth=True)

    # ---- the common step
    reason = EngineField("", "why the lane leaves the common step (Reason)")
    error_start = EngineField("m", "error before the common step")
    min_steps = EngineField("", "least number of steps allowed; 0 where one may serve")
    impacts_start = EngineField("", "before the common step")

    # ---- the program of a lane
    state = EngineField("", "where the program of the lane waits")
    entered = EngineField("", "has just left the common step", truth=True)
    due = EngineField("", "has made the trial step that it asked for", truth=True)
    moving = EngineField("", "asks for a trial step", truth=True)
    touching = EngineField("", "asks for the forces at its stops", truth=True)
    complete = EngineField("", "has crossed its interval, or given it up", truth=True)
    next_step = EngineField("s", "length of the next step", STATE)
    steps_left = EngineField("", "planned steps that are left, or have been tried")
    left = EngineField("s", "left of the planned step where the trial step starts")
    error_trial = EngineField("m", "error at the start of the trial step")
    elapsed = EngineField("s", "time since the interval, or its piece, began")
    changes = EngineField("", "resolutions of contacts")
    at_stop = EngineField("", "contacts, or which joints stick, have to be resolved", truth=True)
    step = EngineField("s", "length of the trial step")
    searched = EngineField("", "trial steps in search of an event")
    for_turn = EngineField("", "seeks a turn, and no event", truth=True)
    target = EngineField("", "number of the boundary whose event is sought")
    side = EngineField("", "of its limit; of a release, that on which the trial step before ended")
    low = EngineField("s", "trial step before the event")
    high = EngineField("s", "trial step after it")
    gap_low = EngineField("", "value at the end of the one before")
    gap_high = EngineField("", "value at the end of the one after")
    tries = EngineField("", "trial steps of this search")

    # ---- laws, contacts and their log
    departure = EngineField("m/s", "by which laws that hold no more lead off the motion")
    resolving = EngineField("", "contacts are being resolved", truth=True)
    impacts = EngineField("", "impacts of the interval")
    lowest_bounce = EngineField("m", "height of a bounce below which it ends in rest")
    bounces_end = EngineField("s", "when all bounces that were left out would be over")
    bounce_missed = EngineField("", "there was an impact before", truth=True)
    span_start = EngineField("s", "when the common step began", book=True)
    logged_start = EngineField("", "events kept before the common step", book=True)
    logged = EngineField("", "events kept", STATE, book=True)

    # ---- the episode
    limit = EngineField("", "control steps of an episode", PARAMETER)
    steps = EngineField("", "control steps of the episode before this one", STATE)
    saturated = EngineField("", "entries of actions outside [-1, 1] in the episode", STATE)
    numerics = EngineField("", "faults of the last step", STATE)
    evaluations_sum = EngineField("", "evaluations of the equations of motion in the episode", STATE)
    events_sum = EngineField("", "events at stops in the episode", STATE)
    error_most = EngineField("", "largest estimated error of a control step in the episode, m", STATE)
    reward = EngineField("", "of the last step", STATE)
    terminated = EngineField("", "of the last step", STATE)
    truncated = EngineField("", "of the last step", STATE)
    resetting = EngineField("", "a new episode begins", truth=True)


def engine(*names: str) -> Iterator[Variable]:
    """Declarations of some of these fields."""
    return (getattr(EngineFields, name).field() for name in names)
