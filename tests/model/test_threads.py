"""A simulator or an environment is for one thread at a time: another one is told so, and need not wait."""

import copy
import dataclasses
import io
import os
import pickle
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from envs.faces import FACES, GOAL_IDS, actions, begin, flat, made, running
from gymnasium.error import NoAsyncCallError

import redundant_envs as rde
from redundant_envs.envs.core import Core
from redundant_envs.model.memory import IN_USE, InUse, Memory, alone

SCENE = rde.load_scene("four_r_reach")
STATES = {}
"""A state of each class of simulators and environments."""


def refused(call):
    """Whether a call finds its simulator in use; InUse, or None."""
    try:
        call()
    except InUse:
        return InUse
    return None


def told(call):
    """What another thread is told by a call; None if it comes back."""
    return ThreadPoolExecutor(1).submit(refused, call).result(20.0)


@alone
def within(used, call):
    """What another thread is told while this one is in a call."""
    return told(call)


def batch():
    return rde.BatchSimulator(SCENE, 3)


OF_BATCH = {
    "advance": lambda b: b.advance(), "advance_partly": lambda b: b.advance_partly(None, 0.01),
    "set_state": lambda b: b.set_state(np.zeros(4), np.zeros(4), [1]), "q": lambda b: b.q,
    "set_parameters": lambda b: b.set_parameters({"gravity.g": 1.0}), "save": lambda b: b.save(),
    "restore": lambda b: b.restore(STATES[type(b)]), "copy": copy.copy, "pickle": pickle.dumps,
}  # fmt: skip
OF_ENV = {
    "step": lambda e: e.step(actions(e, 1)[0]), "reset": begin, "get_state": lambda e: e.get_state(),
    "set_state": lambda e: e.set_state(STATES[type(e)]), "tip": lambda e: e.tip, "qd": lambda e: e.qd,
    "parameters": lambda e: e.parameters, "copy": copy.deepcopy, "pickle": pickle.dumps,
    "set_options": lambda e: e.set_options({"parameters": {"gravity.g": 1.0}}),
    "render": lambda e: e.get_images() if hasattr(e, "get_images") else e.render(),
    "a number": lambda e: setattr(e, "start_angle", 0.5),
}  # fmt: skip


@pytest.mark.parametrize("name", OF_BATCH)
def test_a_batch_in_use_refuses_other_threads(name):
    used, call = batch(), OF_BATCH[name]
    STATES[type(used)] = used.save()
    assert within(used, lambda: call(used)) is InUse
    assert told(lambda: call(used)) is None


@pytest.mark.parametrize("kind", FACES)
def test_an_environment_in_use_refuses_other_threads_and_goes_on(kind):
    env, other = (made(kind, GOAL_IDS[0], render_mode="rgb_array") for _ in range(2))
    before = [flat(begin(e, seed=3)) for e in (env, other)]
    STATES[type(env)] = env.get_state()
    for name, call in OF_ENV.items():
        assert within(env, lambda call=call: call(env)) is InUse, name
    assert before[0] == before[1]
    for action in actions(env, 3):
        assert flat(env.step(action)) == flat(other.step(action))
    for name, call in OF_ENV.items():
        assert told(lambda call=call: call(env)) is None, name
    goals = np.zeros((1, 2))
    assert within(env, lambda: env.compute_reward(goals, goals, [{}])) is None  # from no numbers of the lanes


@pytest.mark.parametrize("kind", [*FACES, "batch"])
def test_at_no_line_of_a_call_a_signal_handler_is_let_in(kind):
    """And the call gives what it gives without one."""
    used, other = (batch() if kind == "batch" else made(kind, render_mode="rgb_array") for _ in range(2))
    if kind == "batch":
        STATES[type(used)] = used.save()
        calls, left_out = (OF_BATCH["advance"], OF_BATCH["advance_partly"], lambda b: b.q), ("q",)
    else:
        for one in (used, other):
            begin(one)
        STATES[type(used)] = used.get_state()
        (action,) = actions(used, 1)
        calls = (lambda e: begin(e, seed=4), lambda e: e.step(action))
        left_out = ("tip", "qd", "a number", *(["set_options"] if kind == "single" else []))
    tried = OF_BATCH if kind == "batch" else OF_ENV
    inner = [lambda call=call: call(used) for name, call in tried.items() if name not in left_out]
    found, before = [], sys.gettrace()

    def trace(frame, event, argument):
        if used._memory.free == IN_USE:
            found.extend(map(refused, inner))
        return trace

    for call in calls:
        sys.settrace(trace)
        try:
            got = call(used)
        finally:
            sys.settrace(before)
        assert flat(got) == flat(call(other))
    assert len(found) > 20 * len(inner)
    assert {*found} == {InUse}


@pytest.mark.parametrize("kind", FACES)
def test_a_copy_is_of_one_moment(kind):
    """Another thread goes on while the environment is written."""
    env = running(kind)
    before, (action, later) = copy.deepcopy(env), actions(env, 2)

    class Slow(pickle.Pickler):
        def reducer_override(self, thing):
            if isinstance(thing, Core | Memory):
                assert told(lambda: env.step(action)) is None
            return NotImplemented

    Slow(file := io.BytesIO()).dump(env)
    assert env.core.get_state()["states"].tolist() != before.core.get_state()["states"].tolist()
    again = pickle.loads(file.getvalue())
    assert again.core.get_state()["states"].tolist() == before.core.get_state()["states"].tolist()
    assert flat(again.step(later)) == flat(before.step(later))


@pytest.mark.parametrize("kind", FACES)
def test_a_copy_of_a_copy_has_one_memory(kind):
    env = running(kind)
    env.itself, env.call_it = [env], env.get_state
    for again in (copy.deepcopy, copy.copy, lambda x: pickle.loads(pickle.dumps(x))):
        one = again(again(env))
        assert one._memory is one.core.memory is not env.core.memory
        assert one.itself[0] is one is one.call_it.__self__


def test_a_thread_is_refused_while_another_one_is_in_machine_code():
    long = rde.BatchSimulator(dataclasses.replace(SCENE, tolerance=None, substeps=20_000), 16)
    thread = threading.Thread(target=long.advance)
    thread.start()
    while long._memory.free != IN_USE:
        time.sleep(0)
    with pytest.raises(InUse, match=r"another thread uses.*give each thread its own"):
        long.advance()
    thread.join()
    long.advance()


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
@pytest.mark.parametrize("kind", FACES)
def test_errors_and_interrupts_leave_nothing_in_use(kind, error, monkeypatch):
    env = running(kind)
    (action,) = actions(env, 1)

    def stop(*_):
        raise error

    with monkeypatch.context() as context:
        if kind == "single":
            context.setattr(env._lane, "_call", stop)
            context.setattr(env._lane, "_operation", env._operation)  # whose arguments are there already
        else:
            context.setattr(env.core._team.parts[0], "entry", stop)
        with pytest.raises(error):
            env.step(action)
    assert told(lambda: env.step(action)) is None


def test_actions_of_one_thread_are_not_those_of_another_ones_step():
    env, other = made("sb3"), made("sb3")
    first, second = actions(env, 2)
    for one in (env, other):
        begin(one, seed=3)
    env.step_async(first)  # an interrupt may end a step here
    assert told(lambda: env.step_async(second)) is None
    assert told(lambda: copy.deepcopy(env).step(first)) is None
    assert flat(env.step_wait()) == flat(other.step(first))
    assert flat(env.step_wait()) == flat(other.step(second))  # of a thread that has ended
    with pytest.raises(NoAsyncCallError, match="call step_async"):
        env.step_wait()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_a_forked_process_has_its_own_copy_and_no_hang_of_one_that_was_in_use():
    used = batch()
    used._memory.free = IN_USE  # as in the middle of a step of another thread
    for simulator, expected in ((used, 1), (batch(), 0)):
        child = os.fork()
        if not child:
            os._exit(refused(simulator.advance) is InUse)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == expected
