"""Machine code of lane functions: sines, exponentials, choices, draws, LLVM's order."""

import hashlib
import itertools

import llvmlite.binding as binding
import mpmath
import numpy as np
import pytest
from compiled import compiled, on_columns

from redundant_envs.compiler.backends import llvm, llvm_kernels, llvm_text
from redundant_envs.compiler.backends.torch import torch
from redundant_envs.compiler.tracing.flow import Kernel, LaneFunction, Program
from redundant_envs.compiler.tracing.graph import Graph
from redundant_envs.language import algebra
from redundant_envs.language.draws import uniform
from redundant_envs.language.philox import philox


def test_sines_and_cosines_to_the_last_places():
    rng = np.random.default_rng(0)
    x = [rng.uniform(-1e6, 1e6, 200_000), rng.uniform(-10, 10, 200_000), np.arange(-8, 9) * np.pi / 4]
    x = np.concatenate(x)
    s, c = on_columns(algebra.sincos, x)
    assert np.abs(s - np.sin(x)).max() <= 2.3e-16
    assert np.abs(c - np.cos(x)).max() <= 2.3e-16
    np.testing.assert_array_equal(on_columns(algebra.sincos, np.zeros(1)), [[0.0], [1.0]])
    assert np.isnan(on_columns(algebra.sincos, np.array([np.nan, np.inf, -np.inf]))).all()


def arguments_of_exp(rng):
    return np.concatenate([rng.uniform(-745.2, 709.78, 4000), rng.uniform(-1, 1, 4000), [709.782712893384]])


def arguments_of_expm1(rng):
    small = 10.0 ** rng.uniform(-300.0, 0.0, 2000) * rng.choice([-1.0, 1.0], 2000)
    return np.concatenate([small, rng.uniform(-45, 709.7, 4000), rng.uniform(-2, 2, 8000), [709.7827128933]])


def arguments_of_log(rng):
    near, far = 1.0 + rng.uniform(-0.5, 1.0, 4000), np.exp(rng.uniform(-745.0, 709.0, 4000))
    return np.concatenate([near, far, 1.0 + 1e-15 * rng.uniform(-9, 9, 99), [5e-324, 2.0**-1022, 1.79e308]])


MIN, INF, NAN = 5e-324, np.inf, np.nan
FUNCTIONS = {  # arguments, units in the last place (also of subnormal results), and results at both ends
    "exp": (
        arguments_of_exp, 1.0,
        {0.0: 1.0, 709.79: INF, 800.0: INF, INF: INF, -746.0: 0.0, -INF: 0.0, NAN: NAN},
    ),
    "expm1": (
        arguments_of_expm1, 2.0,
        {0.0: 0.0, 1e-300: 1e-300, 709.79: INF, INF: INF, -38.0: -1.0, -746.0: -1.0, -INF: -1.0, NAN: NAN},
    ),
    "log": (
        arguments_of_log, 1.0,
        {1.0: 0.0, 0.0: -INF, INF: INF, -1.0: NAN, -MIN: NAN, -INF: NAN, NAN: NAN},
    ),
}  # fmt: skip


@pytest.mark.filterwarnings("ignore:overflow")
@pytest.mark.parametrize("compiles", [True, False], ids=["compiled", "arrays"])
@pytest.mark.parametrize("name", FUNCTIONS)
def test_exponentials_and_logarithms_to_the_last_places_and_at_both_ends(name, compiles):
    arguments, units, ends = FUNCTIONS[name]
    primitive = getattr(algebra, name)
    function = (lambda x: on_columns(primitive, x)[0]) if compiles else primitive
    x = arguments(np.random.default_rng(0))
    exact = np.array([float(getattr(mpmath, name)(mpmath.mpf(float(v)))) for v in x])
    assert (np.abs(function(x) - exact) <= units * np.spacing(np.abs(exact))).all()
    np.testing.assert_array_equal(function(np.array([*ends])), [*ends.values()])
    np.testing.assert_array_equal(function(np.array([-0.0])), function(np.array([0.0])))


def test_functions_of_arrays_have_the_bits_of_every_machine():
    of_all_sizes = np.ldexp(np.linspace(0.5, 1.0, 101)[:, None], np.arange(-1060, 1024))
    for function, x, digest in (
        (algebra.log, of_all_sizes, "7b9439f3b2e8ae12"),
        (algebra.exp, np.linspace(-740.0, 700.0, 100_001), "f978317a98362c2a"),
    ):
        assert hashlib.sha256(function(x).astype("<f8").tobytes()).hexdigest()[:16] == digest
        assert function(np.array(1.0)).shape == ()


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


def words(interval, *key):
    return algebra.philox(0xFFFFFF07, interval, *key)


def test_words_are_those_of_philox_on_all_kinds_of_numbers():
    """Of intervals of any number, which counts on beyond a word."""
    lanes = np.random.default_rng(0).integers(0, 2**32, (5, 100)).astype(float)
    lanes[:, :3] = np.array([0.0, 1.0, 2.0**32 - 1.0])
    known = [philox([k0, k1], [0xFFFFFF07, c, k2, k3]) for c, k0, k1, k2, k3 in lanes.T.astype(int).tolist()]
    lanes[0, 50:] += 2.0**32
    of_tensors = words(*map(torch.tensor, lanes))
    single = np.transpose([words(*row) for row in lanes.T.tolist()])
    for found in (on_columns(words, *lanes), words(*lanes), np.stack(of_tensors), single):
        np.testing.assert_array_equal(found, np.transpose(known))


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
