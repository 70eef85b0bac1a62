"""Scenes whose programs are long: refused at once, compiled without deep calls."""

import signal
import threading
import time

import pytest
from compiled import kernel_of, on_columns, recorded
from numpy.testing import assert_array_equal

import redundant_envs as rde
from redundant_envs.compiler.backends import llvm, llvm_text
from redundant_envs.compiler.backends.llvm_lanes import Vectors
from redundant_envs.compiler.tracing import graph
from redundant_envs.compiler.tracing.flow import Program
from redundant_envs.language.algebra import all_of, where
from redundant_envs.model.programs import traced_batch

e = rde.effects
ARM = rde.Chain("RR", (1.0, 1.0), (1.0, 1.0))


@pytest.mark.parametrize("order", [Vectors.in_order, lambda vectors, results: []], ids=["ours", "as needed"])
def test_a_chain_of_conditions_is_as_long_as_it_likes(order, monkeypatch):
    monkeypatch.setattr(Vectors, "in_order", order)

    def every(x):
        return where(all_of(x > float(k) for k in range(2000)), 1.0, 0.0)

    assert_array_equal(on_columns(every, [1998.5, 1999.5])[0], [0.0, 1.0])


def test_a_program_of_too_many_operations_is_refused(monkeypatch):
    monkeypatch.setattr(graph, "MAX_OPERATIONS", 2_000)
    walls = [e.HalfPlane(point=(0.0, -3.0 - i), name=f"p{i}") for i in range(3)]
    scene = rde.Scene(ARM, (*walls, e.Disc((1.0, 1.0), 0.1, along_links=True)), tolerance=1e-6)
    said = "more than 2000 operations.*leave some of its effects out"
    for refuses in (rde.BatchSimulator, rde.listing, rde.bill):
        with pytest.raises(ValueError, match=said):
            refuses(scene)


def doubling():
    return kernel_of(recorded(lambda x: [x + x]), 1)


def test_a_process_of_its_own_makes_the_same_code(monkeypatch):
    code = llvm.object_code(Program([doubling()]))
    monkeypatch.setattr(llvm, "LONG_TEXT", 0)
    assert llvm.object_code(Program([doubling()])) == code


def test_a_compiler_that_fails_is_told(monkeypatch):
    monkeypatch.setattr(llvm, "LONG_TEXT", 0)
    monkeypatch.setattr(llvm, "EFFORT", 9)
    with pytest.raises(RuntimeError, match="the compiler ended with status 1: AssertionError"):
        llvm.object_code(Program([doubling()]))


@pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="this system interrupts no thread")
def test_an_interrupt_ends_the_compiler_and_the_next_one_begins_with_the_equations(monkeypatch, tmp_path):
    endless, began, main = tmp_path / "endless.py", tmp_path / "began", threading.get_ident()
    endless.write_text(f"import time, pathlib; pathlib.Path({str(began)!r}).touch(); time.sleep(1000)")
    monkeypatch.setenv("REDUNDANT_ENVS_CACHE", str(tmp_path))
    simulator = traced_batch(rde.Scene(ARM, (e.Gravity(),), integrator="euler"), False)

    def interrupt():
        while not began.exists():
            time.sleep(0.01)
        signal.pthread_kill(main, signal.SIGINT)

    with monkeypatch.context() as context:
        context.setattr(llvm, "LONG_TEXT", 0)
        context.setattr(llvm_text, "__file__", str(endless))
        thread = threading.Thread(target=interrupt)
        thread.start()
        with pytest.raises(KeyboardInterrupt):
            simulator.kernels(1)
        thread.join()
    assert "_traced" not in vars(simulator)
    assert {*simulator.kernels(1)} == {"advance"}
