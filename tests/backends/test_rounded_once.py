"""Products and sums with one rounding, computed by our own function: equal to the last bit."""

import ctypes
import itertools
import platform
import warnings
from fractions import Fraction

import llvmlite.binding as llvm
import numpy as np
import pytest
from compiled import on_columns
from llvmlite import ir

from redundant_envs.compiler.backends import llvm as backend
from redundant_envs.compiler.backends.llvm_fma import rounded_once
from redundant_envs.compiler.backends.processors import Processor

CASES = 1 << 18
WIDTHS = 2, 4, 8
OLD = Processor("x86-64-v2", "")
SPECIAL = [0.0, -0.0, 1.0, -1.0, 0.1, 3.0, -3.0, np.inf, -np.inf, np.nan]
OUTSIDE = [*SPECIAL, 5e-324, -5e-324, 2.0**-1022, 1e-300, 1e308, -1.7e308]


def machine_code(lanes, checked):
    """x * y + c of arrays by our function, and by the processor's or the library's."""
    pointer, count = ir.DoubleType().as_pointer(), ir.IntType(64)
    module, numbers = ir.Module("probe"), ir.VectorType(ir.DoubleType(), lanes)
    ours = rounded_once(module, lanes, checked)
    name = f"llvm.fma.v{lanes}f64"
    known = module.globals.get(name) or ir.Function(module, ours.function_type, name)
    for name, called in (("ours", ours), ("known", known)):
        kind = ir.FunctionType(ir.VoidType(), [pointer] * 4 + [count])
        function = ir.Function(module, kind, name)
        entry, body, end = (function.append_basic_block() for _ in range(3))
        ir.IRBuilder(entry).branch(body)
        b = ir.IRBuilder(body)
        i = b.phi(count)
        i.add_incoming(ir.Constant(count, 0), entry)
        places = [b.bitcast(b.gep(a, [i]), numbers.as_pointer()) for a in function.args[:4]]
        values = [b.load(place, align=8) for place in places[:3]]
        b.store(b.call(called, values), places[3], align=8)
        after = b.add(i, ir.Constant(count, lanes))
        i.add_incoming(after, body)
        b.cbranch(b.icmp_signed("<", after, function.args[4]), body, end)
        ir.IRBuilder(end).ret_void()
    parsed = llvm.parse_assembly(str(module))
    parsed.verify()
    engine = llvm.create_mcjit_compiler(parsed, backend.machine())
    engine.finalize_object()

    kind = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4, ctypes.c_int64)

    def run(name, *arrays):
        found = np.empty(len(arrays[0]))
        kind(engine.get_function_address(name))(*(x.ctypes.data for x in (*arrays, found)), len(found))
        return found

    run.engine = engine  # it owns the code
    return run


def numbers(rng, low, high, count=CASES):
    """Of either sign, with exponents from ``low`` to ``high``."""
    return np.ldexp(rng.uniform(1.0, 2.0, count), rng.integers(low, high, count)) * rng.choice([-1, 1], count)


def short(rng):
    """Numbers of few digits, whose sums are often halfway between two others."""
    digits = rng.integers(1, 2 ** rng.integers(1, 30, CASES)).astype(float)
    return np.ldexp(digits, rng.integers(-30, 30, CASES)) * rng.choice([-1, 1], CASES)


def inside(rng):
    """Cases in the range that the function serves."""
    yield "moderate", (numbers(rng, -20, 20), numbers(rng, -20, 20), numbers(rng, -40, 40))
    a, b = numbers(rng, -5, 5), numbers(rng, -5, 5)
    yield "cancelling", (a, b, -(a * b) * (1.0 + rng.integers(-4, 5, CASES) * 2.0**-52))
    yield "short", (short(rng), short(rng), short(rng))
    yield "wide", (numbers(rng, -480, 480), numbers(rng, -480, 480), numbers(rng, -960, 960))
    yield "small sums", (numbers(rng, -300, 300), numbers(rng, -300, 300), numbers(rng, -1074, -1000))
    yield "large sums", (numbers(rng, -300, 480), numbers(rng, -300, 480), numbers(rng, 900, 1000))
    near_one = 1.0 + 2.0**-52 * rng.integers(0, 8, CASES)
    yield "long products", (numbers(rng, 0, 1), near_one, numbers(rng, -54, 2))


def special(values):
    """All triples of some values, to a multiple of all widths."""
    table = np.array(list(itertools.product(values, repeat=3))).T
    more = -table.shape[1] % max(WIDTHS)
    return [np.ascontiguousarray(np.concatenate([column, column[:more]])) for column in table]


def differing(run, arrays):
    """Cases whose bits are not the known ones; numbers that are not defined are alike."""
    ours, known = (run(name, *arrays) for name in ("ours", "known"))
    bad = (ours.view(np.int64) != known.view(np.int64)) & ~(np.isnan(ours) & np.isnan(known))
    return np.array(arrays)[:, bad]


@pytest.mark.quick("False-2", "True-2")
@pytest.mark.parametrize("lanes", WIDTHS)
@pytest.mark.parametrize("checked", [False, True])
def test_it_rounds_as_the_processor_does(lanes, checked):
    """Checked, for all numbers."""
    run, rng = machine_code(lanes, checked), np.random.default_rng([41, lanes])
    cases = dict(inside(rng)) | {"special": special(OUTSIDE if checked else SPECIAL)}
    if checked:
        cases["huge"] = numbers(rng, 990, 1023), numbers(rng, -1000, -900), numbers(rng, -5, 5)
        cases["tiny"] = numbers(rng, -600, -480), numbers(rng, -600, -400), numbers(rng, -1074, -900)
    for what, arrays in cases.items():
        assert differing(run, arrays).shape[1] == 0, what


def test_it_rounds_exact_sums():
    """Without another function that might share its mistakes: Python rounds fractions correctly."""
    run, rng = machine_code(2, checked=False), np.random.default_rng(44)
    for what, arrays in inside(rng):
        few = [x[:2000] for x in arrays]
        exact = [float(Fraction(a) * Fraction(b) + Fraction(c)) for a, b, c in zip(*few, strict=True)]
        found = run("ours", *few)
        assert (found == np.array(exact)).all(), what


@pytest.mark.skipif(platform.machine().lower() not in ("x86_64", "amd64"), reason="other processors have it")
def test_programs_for_processors_without_the_instruction_compute_with_it():
    rng = np.random.default_rng(45)
    ends = ([0.0, 2.0**-600, 1e300], [2.0, 2.0**-500, 1e300], [1.0, -(2.0**-1070), 0.0])
    random = numbers(rng, -20, 20, 64), numbers(rng, -20, 20, 64), numbers(rng, -40, 40, 64)
    columns = [np.concatenate(pair) for pair in zip(random, ends, strict=True)]
    with warnings.catch_warnings(), backend.target(OLD):
        warnings.simplefilter("ignore")
        (found,) = on_columns(lambda x, y, c: x * y + c, *columns)
    *cases, _ = zip(*columns, strict=True)
    exact = [float(Fraction(a) * Fraction(b) + Fraction(c)) for a, b, c in cases]
    assert found.tolist() == [*exact, np.inf]
