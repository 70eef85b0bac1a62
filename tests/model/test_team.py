"""Threads of a simulator finish every call that they begin, and end with it."""

import copy
import dataclasses
import gc
import itertools
import signal
import sys
import threading
import time

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import redundant_envs as rde
from redundant_envs.model.memory import IN_USE


def workers():
    return {t for t in threading.enumerate() if t.name.startswith("redundant-envs")}


@pytest.mark.long
def test_threads_end_with_their_simulator_and_its_copies():
    before = workers()
    batch = rde.BatchSimulator(rde.load_scene("four_r_reach"), 64, threads=3)
    twin = copy.deepcopy(batch)
    for one in (batch, twin):
        one.advance()
    own = workers() - before
    assert len(own) == 6  # two for the other parts, and one for the first call, whose length nobody knows
    del batch, twin, one
    gc.collect()
    for thread in own:
        thread.join()


def interrupted(call, place):
    """Interrupt a call where Python does: at the beginning of functions, and after those in C."""
    places = itertools.count(1)

    def look(frame, event, argument):
        if event in ("call", "c_return") and next(places) == place:
            raise KeyboardInterrupt

    sys.setprofile(look)
    try:
        call()
    finally:
        sys.setprofile(None)


@pytest.mark.parametrize("long", [False, True], ids=["short", "long"])
def test_an_interrupt_anywhere_in_a_call_leaves_no_part_running(monkeypatch, long):
    batch = rde.BatchSimulator(rde.load_scene("four_r_reach"), 64, threads=3)
    team, running, interrupts = batch._team, [], 0
    team._took = team._long if long else 0
    batch.advance()

    def part_runs(self):
        if threading.current_thread() is not threading.main_thread():
            running.append(self)
            time.sleep(0.002)
            running.remove(self)

    monkeypatch.setattr(type(team.parts[0]), "__call__", part_runs)
    for place in range(2, 1000):
        team._took = team._long if long else 0
        before = batch.save()
        try:
            interrupted(team, place)
            break
        except KeyboardInterrupt:
            interrupts += 1
        assert not running, place
        for name, content in batch.save().items():
            assert_array_equal(content, before[name])
    assert interrupts > 10
    monkeypatch.undo()
    assert np.isfinite(batch.advance().evaluations).all()


@pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="this system interrupts no thread")
@pytest.mark.parametrize(
    ("threads", "long"),
    [
        (2, {"tolerance": None, "substeps": 1_000_000}),
        (1, {"tolerance": 1e-13, "control_dt": 10.0}),  # it takes 16384 steps, which nothing foretells
    ],
    ids=["substeps", "tolerance"],
)
def test_an_interrupt_stops_a_long_call_which_then_has_changed_nothing(threads, long):
    scene = dataclasses.replace(rde.load_scene("four_r_reach"), **long)
    batch = rde.BatchSimulator(scene, 256, threads=threads)
    before, main = batch.save(), threading.get_ident()

    def interrupt():
        while batch._memory.free != IN_USE:
            time.sleep(0.0)
        time.sleep(0.05)
        signal.pthread_kill(main, signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        batch.advance()
    thread.join()
    for name, content in batch.save().items():
        assert_array_equal(content, before[name])
