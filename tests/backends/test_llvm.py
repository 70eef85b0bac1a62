"""Machine code of lane functions: sines, choices, draws, tables, LLVM's order."""

import hashlib
import itertools

import llvmlite.binding as binding
import mpmath
import numpy as np
import pytest
from catalogue import SCENES
from compiled import compiled, on_columns

from redundant_envs.compiler.backends import llvm, llvm_kernels, llvm_text
from redundant_envs.compiler.backends.processors import AVX2
from redundant_envs.compiler.backends.torch import torch
from redundant_envs.compiler.tracing.flow import LANES, Kernel, LaneFunction, Program
from redundant_envs.compiler.tracing.graph import Graph
from redundant_envs.language import algebra
from redundant_envs.language.draws import uniform
from redundant_envs.language.philox import philox
from redundant_envs.model import programs
from redundant_envs.model.programs import batch_simulator
from redundant_envs.simulator.lane.fields import SCRATCH, STATE, Layout, Lifetime, Variable
from redundant_envs.simulator.lane.memory import traced

# ---- primitives ------------------------------------------------------------------------------------


def test_sines_and_cosines_to_the_last_places():
    rng = np.random.default_rng(0)
    x = [rng.uniform(-1e6, 1e6, 200_000), rng.uniform(-10, 10, 200_000), np.arange(-8, 9) * np.pi / 4]
    x = np.concatenate(x)
    s, c = on_columns(algebra.sincos, x)
    assert np.abs(s - np.sin(x)).max() <= 2.3e-16
    assert np.abs(c - np.cos(x)).max() <= 2.3e-16
    np.testing.assert_array_equal(on_columns(algebra.sincos, np.zeros(1)), [[0.0], [1.0]])
    assert np.isnan(on_columns(algebra.sincos, np.array([np.nan, np.inf, -np.inf]))).all()


@pytest.mark.filterwarnings("ignore:overflow")
@pytest.mark.parametrize(
    "exp", [lambda x: on_columns(algebra.exp, x)[0], algebra.exp], ids=["compiled", "arrays"]
)
def test_exponentials_to_the_last_place_and_at_both_ends(exp):
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.uniform(-745.2, 709.78, 4000), rng.uniform(-1, 1, 4000), [709.782712893384]])
    exact = np.array([float(mpmath.exp(mpmath.mpf(float(v)))) for v in x])
    assert (np.abs(exp(x) - exact) <= np.spacing(exact)).all()  # subnormal ones too
    ends = exp(np.array([0.0, -0.0, 709.79, 800.0, np.inf, -746.0, -np.inf, np.nan]))
    np.testing.assert_array_equal(ends, [1.0, 1.0, np.inf, np.inf, np.inf, 0.0, 0.0, np.nan])


@pytest.mark.quick("compiled")
@pytest.mark.filterwarnings("ignore:overflow")
@pytest.mark.parametrize(
    "expm1", [lambda x: on_columns(algebra.expm1, x)[0], algebra.expm1], ids=["compiled", "arrays"]
)
def test_exponentials_less_one_to_two_units_and_at_both_ends(expm1):
    rng = np.random.default_rng(0)
    small = 10.0 ** rng.uniform(-300.0, 0.0, 2000) * rng.choice([-1.0, 1.0], 2000)
    x = np.concatenate([small, rng.uniform(-45, 709.7, 4000), rng.uniform(-2, 2, 8000), [709.782712893384]])
    exact = np.array([float(mpmath.expm1(mpmath.mpf(float(v)))) for v in x])
    assert (np.abs(expm1(x) - exact) <= 2.0 * np.spacing(np.abs(exact))).all()
    ends = expm1(np.array([0.0, 1e-300, 709.79, 800.0, np.inf, -38.0, -746.0, -np.inf, np.nan]))
    np.testing.assert_array_equal(ends, [0.0, 1e-300, np.inf, np.inf, np.inf, -1.0, -1.0, -1.0, np.nan])


@pytest.mark.parametrize(
    "log", [lambda x: on_columns(algebra.log, x)[0], algebra.log], ids=["compiled", "arrays"]
)
def test_logarithms_to_the_last_place_and_at_both_ends(log):
    rng = np.random.default_rng(0)
    near, far = 1.0 + rng.uniform(-0.5, 1.0, 4000), np.exp(rng.uniform(-745.0, 709.0, 4000))
    x = np.concatenate([near, far, 1.0 + 1e-15 * rng.uniform(-9, 9, 99), [5e-324, 2.0**-1022, 1.79e308]])
    exact = np.array([float(mpmath.log(mpmath.mpf(float(v)))) for v in x])
    assert (np.abs(log(x) - exact) <= np.spacing(np.abs(exact))).all()
    ends = log(np.array([1.0, 0.0, -0.0, np.inf, -1.0, -5e-324, -np.inf, np.nan]))
    np.testing.assert_array_equal(ends, [0.0, -np.inf, -np.inf, np.inf, np.nan, np.nan, np.nan, np.nan])


def test_the_logarithms_of_arrays_are_those_of_every_machine():
    x = np.ldexp(np.linspace(0.5, 1.0, 101)[:, None], np.arange(-1060, 1024))
    bits = algebra.log(x).astype("<f8").tobytes()
    assert hashlib.sha256(bits).hexdigest()[:16] == "7b9439f3b2e8ae12"
    assert algebra.log(np.float64(1.0)) == 0.0
    assert algebra.log(np.array(1.0)).shape == ()


@pytest.mark.skipif(llvm.host().triple[:6] != "x86_64", reason="the other code is that of x86")
def test_the_logarithms_of_another_processor_have_the_same_bits():
    x = np.ldexp(np.linspace(0.5, 1.0, 101)[:, None], np.arange(-1060, 1024, 7)).ravel()
    with llvm.target(AVX2):
        other = on_columns(algebra.log, x)
    np.testing.assert_array_equal(on_columns(algebra.log, x), other)


def test_the_exponentials_of_arrays_are_those_of_every_machine():
    x = np.linspace(-740.0, 700.0, 100_001)
    bits = algebra.exp(x).astype("<f8").tobytes()
    assert hashlib.sha256(bits).hexdigest()[:16] == "f978317a98362c2a"
    assert algebra.exp(np.float64(0.0)) == 1.0
    assert algebra.exp(np.array(1.0)).shape == ()


@pytest.mark.skipif(llvm.host().triple[:6] != "x86_64", reason="the other code is that of x86")
def test_the_exponentials_of_another_processor_have_the_same_bits():
    x = np.concatenate([np.linspace(-50.0, 700.0, 20_001), np.linspace(-1.0, 1.0, 20_001)])
    for function in (algebra.exp, algebra.expm1):
        with llvm.target(AVX2):
            other = on_columns(function, x)
        np.testing.assert_array_equal(on_columns(function, x), other)


CASES = [0.0, -0.0, 1.0, -2.5, np.inf, -np.inf, np.nan]
PAIRS = np.array([(a, b) for a in CASES for b in CASES]).T


@pytest.mark.parametrize("name", ["minimum", "maximum"])
def test_primitives_agree_everywhere_on_ties_zeros_and_nan(name):
    """minimum, maximum: the first of two equal numbers and of a pair with a NaN, bit for bit."""
    primitive = getattr(algebra, name)
    plain = np.array([primitive(*pair) for pair in PAIRS.T.tolist()])
    first = (PAIRS[0] == PAIRS[1]) | np.isnan(PAIRS).any(axis=0)
    np.testing.assert_array_equal(plain[first], PAIRS[0, first])
    for got in (on_columns(lambda a, b: primitive(a, b), *PAIRS)[0], primitive(*PAIRS)):
        np.testing.assert_array_equal(got, plain)
        np.testing.assert_array_equal(np.signbit(got), np.signbit(plain))


def test_comparisons_and_choices_agree_with_plain_ones():
    def function(a, b):
        joined = (a < b) | (a == 1.0), algebra.logical_not(a < b) & (b != b)
        conditions = a < b, a <= b, a > b, a >= b, a == b, a != b, *joined
        chosen = [algebra.where(c, 1.0, 0.0) for c in conditions]
        return (*chosen, algebra.where((a < b) ^ (a < 0.0), a, b), abs(a), -a, algebra.floor(b * 0.5))

    with np.errstate(invalid="ignore"):
        expected = np.array(np.broadcast_arrays(*function(*PAIRS)))
    got = on_columns(function, *PAIRS)
    np.testing.assert_array_equal(got, expected)
    number = ~np.isnan(expected)  # the sign of a NaN is not specified
    np.testing.assert_array_equal(np.signbit(got[number]), np.signbit(expected[number]))


# ---- draws -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "words"),
    [  # Random123's known-answer vectors of philox4x32-10: key and counter
        ([0] * 6, (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
        ([2**32 - 1] * 6, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
        (
            [0xA4093822, 0x299F31D0, 0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344],
            (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
        ),
    ],
)
def test_draws_are_those_of_philox_and_neither_zero_nor_one(given, words):
    p = Kernel("draw", {"given": "u32", "words": "u32", "numbers": "f64"})
    loaded = [p.load(p["given"], k) for k in range(6)]
    for k, word in enumerate([*philox(loaded[:2], loaded[2:]), loaded[0]]):
        p.store(p["words"], k, word)
        p.store(p["numbers"], k, uniform(p.number(word)))
    got, numbers = np.zeros(5, np.uint32), np.zeros(5)
    compiled(p)(given=np.array(given, np.uint32), words=got, numbers=numbers)
    assert tuple(got) == (*words, given[0])
    np.testing.assert_array_equal(numbers, (got + 0.5) / 2**32)
    assert ((numbers > 0.0) & (numbers < 1.0)).all()


LANES_OF_KEYS = np.random.default_rng(0).integers(0, 2**32, (5, 100)).astype(float)
"""Numbers of intervals, and the words of keys."""
LANES_OF_KEYS[:, :3] = np.array([0.0, 1.0, 2.0**32 - 1.0])


def words(interval, *key):
    return algebra.philox(0xFFFFFF07, interval, *key)


def test_words_are_those_of_philox_on_all_kinds_of_numbers():
    known = [
        philox([k0, k1], [0xFFFFFF07, c1, k2, k3])
        for c1, k0, k1, k2, k3 in LANES_OF_KEYS.T.astype(int).tolist()
    ]
    of_tensors = words(*map(torch.tensor, LANES_OF_KEYS))
    single = np.transpose([words(*row) for row in LANES_OF_KEYS.T.tolist()])
    for found in (on_columns(words, *LANES_OF_KEYS), words(*LANES_OF_KEYS), np.stack(of_tensors), single):
        np.testing.assert_array_equal(found, np.transpose(known))


def test_the_number_of_an_interval_counts_on_beyond_a_word():
    key = LANES_OF_KEYS[1:]
    for on in (lambda x: on_columns(words, x, *key), lambda x: words(x, *key)):
        np.testing.assert_array_equal(on(np.full(100, 2.0**32 + 5.0)), on(np.full(100, 5.0)))


# ---- tables ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("columns", [1, 2, 3, 4, 5, 7, 8, 11])
def test_tables_of_any_number_of_columns_are_read_and_written(columns, kind):
    """The rows of tables, one for each lane, are contiguous; a row beyond the last is not touched."""
    element = {np.float32: "f32", np.float64: "f64"}[kind]
    names = tuple(f"x{k}" for k in range(columns))
    layout = Layout([Variable(n, "", "", SCRATCH) for n in names])

    def turned(lane):
        return {("out", element, k, columns): lane[names[-1 - k]] * 2.0 for k in range(columns)}

    function = traced("turned", layout, turned, inputs={"given": (element, names)})
    p = Kernel("turn", {"given": element, "out": element, "rows": "f64"})
    with p.each(2) as block:
        first = block * (LANES * columns)
        memory = dict.fromkeys(map(str, Lifetime), p["rows"])
        p.call(function, given=p["given"] + first, out=p["out"] + first, **memory)
    given = np.random.default_rng(0).normal(size=(2 * LANES, columns)).astype(kind)
    out, rows = np.full((2 * LANES + 1, columns), 9.0, kind), np.zeros((columns, LANES))
    compiled(p)(given=given, out=out, rows=rows)
    np.testing.assert_array_equal(out[:-1], 2.0 * given[:, ::-1])
    assert (out[-1] == 9.0).all()
    np.testing.assert_array_equal(rows, given[LANES:].T)  # what was read is kept in the lane


def test_numbers_and_conditions_go_to_arrays_of_every_type():
    layout = Layout([Variable("x", "", "", STATE), Variable("y", "", "", STATE)])

    def told(lane):
        return {
            ("less", "i8", 0, 0): lane.x < lane.y, ("whole", "i64", 0, 0): lane.x,
            ("short", "i8", 0, 0): lane.y, ("real", "f64", 0, 0): lane.x,
            ("real", "f64", 2, 0): lane.y, ("single", "f32", 1, 0): lane.x,
        }  # fmt: skip

    function = traced("told", layout, told)
    arrays = {"less": "i8", "whole": "i64", "short": "i8", "real": "f64", "single": "f32"}
    strides = {"real_stride": "int", "single_stride": "int"}
    p = Kernel("tell", {"rows": "f64", **arrays, **strides})
    memory = dict.fromkeys(map(str, Lifetime), p["rows"])
    p.call(function, **memory, **{name: p[name] for name in (*arrays, *strides)})
    rows = np.array([[-3.7, -2.0, -0.5, 0.0, 0.5, 1.0, 2.9, 100.0], np.arange(8.0)])
    out = {
        "less": np.zeros(8, np.int8), "whole": np.zeros(8, np.int64), "short": np.zeros(8, np.int8),
        "real": np.zeros((3, 10)), "single": np.zeros((2, 8), np.float32),
    }  # fmt: skip
    compiled(p)(rows=rows.reshape(-1).copy(), **out, real_stride=10, single_stride=8)
    np.testing.assert_array_equal(out["less"], rows[0] < rows[1])
    np.testing.assert_array_equal(out["whole"], [-3, -2, 0, 0, 0, 1, 2, 100])
    np.testing.assert_array_equal(out["short"], range(8))
    np.testing.assert_array_equal(out["real"][:, :8], [rows[0], np.zeros(8), rows[1]])
    np.testing.assert_array_equal(out["single"], np.float32([np.zeros(8), rows[0]]))


# ---- the compiler ----------------------------------------------------------------------------------


def probe():
    """A program whose order LLVM would change: sums and products of many rows."""
    graph = Graph()
    rows = [graph.load("row", k) for k in range(40)]
    total = rows[0]
    for a, b in itertools.pairwise(rows):
        total = graph.combine("+", graph.combine("*", graph.combine("/", a, b), total), b)
    p = Kernel("probe", {"row": "f64"})
    p.call(LaneFunction("probe", ("row",), [("row", 40, total)]), row=p["row"])
    return Program([p])


def test_llvm_has_its_own_order_again_afterwards():
    """The switch is global to LLVM: code that others compile must be the same as without us."""
    text = str(llvm_kernels.module_of(probe(), llvm.host()._replace(features="+fma")))

    def by_others():
        return llvm.machine().emit_assembly(binding.parse_assembly(text))

    before = by_others()
    binding.set_option("test", llvm_text.ORDER_OPTION.format("false"))
    try:
        assert by_others() != before
    finally:
        binding.set_option("test", llvm_text.ORDER_OPTION.format("true"))
    assert by_others() == before
    llvm.object_code(probe())
    assert by_others() == before
    with pytest.raises(RuntimeError):
        llvm._emitted(text, lambda target, module: binding.parse_assembly("no assembly"))
    assert by_others() == before


@pytest.mark.long
def test_a_program_is_compiled_to_the_same_code_every_time():
    """Another process requests the same program, even for one whose graphs were changed."""
    scene = SCENES["4R friction rk8"]
    program = batch_simulator(scene, False).program
    code = llvm.object_code(program)
    assert llvm.object_code(program) == code
    assert llvm.object_code(programs.traced_batch(scene, False).program) == code
