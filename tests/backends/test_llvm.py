"""Machine code of lane functions: sines, choices, draws, tables, stages, the order of instructions."""

import dataclasses
import itertools
import math
from collections import OrderedDict

import llvmlite.binding as binding
import numpy as np
import pytest
from compiled import compiled, on_columns
from small_scenes import FOUR_R, RPRP, e

import redundant_envs as rde
import redundant_envs.lane.common_step as steps
from redundant_envs import algebra
from redundant_envs.algebra import physics
from redundant_envs.backends import llvm, llvm_kernels
from redundant_envs.batch.blocks import LANES
from redundant_envs.batch.environment import philox, uniform
from redundant_envs.effects.hooks import Effect, Force
from redundant_envs.lane.memory import PARAMETER, SCRATCH, STATE, Field, Layout, Lifetime, traced
from redundant_envs.model import programs
from redundant_envs.model.memory import aligned
from redundant_envs.model.programs import batch_simulator
from redundant_envs.tracing.flow import Kernel, LaneFunction, Program
from redundant_envs.tracing.graph import Graph

# ---- primitives ------------------------------------------------------------------------------------


def test_sines_and_cosines_to_the_last_places():
    rng = np.random.default_rng(0)
    x = np.concatenate(
        [rng.uniform(-1e6, 1e6, 200_000), rng.uniform(-10, 10, 200_000), np.arange(-8, 9) * np.pi / 4]
    )
    s, c = on_columns(algebra.sincos, x)
    assert np.abs(s - np.sin(x)).max() <= 2.3e-16
    assert np.abs(c - np.cos(x)).max() <= 2.3e-16
    np.testing.assert_array_equal(on_columns(algebra.sincos, np.zeros(1)), [[0.0], [1.0]])
    assert np.isnan(on_columns(algebra.sincos, np.array([np.nan, np.inf, -np.inf]))).all()


def test_exponentials_to_the_last_place_and_at_both_ends():
    rng = np.random.default_rng(0)
    x = np.concatenate(
        [rng.uniform(-745.2, 709.8, 200_000), rng.uniform(-1, 1, 200_000), [0.0, -0.0, 709.782712893384]]
    )
    expected = np.array([math.exp(v) if v < 709.7827128933841 else np.inf for v in x])
    (values,) = on_columns(algebra.exp, x)
    finite = np.isfinite(expected)
    error = np.abs(values[finite] - expected[finite])
    assert (error <= np.spacing(expected[finite])).all()  # subnormal ones too
    assert np.isinf(values[~finite]).all()
    (values,) = on_columns(algebra.exp, np.array([0.0, -0.0, 800.0, np.inf, -746.0, -np.inf, np.nan]))
    np.testing.assert_array_equal(values, [1.0, 1.0, np.inf, np.inf, 0.0, 0.0, np.nan])


CASES = [0.0, -0.0, 1.0, -2.5, np.inf, -np.inf, np.nan]
PAIRS = np.array([(a, b) for a in CASES for b in CASES]).T


@pytest.mark.parametrize("name", ["minimum", "maximum"])
def test_primitives_agree_everywhere_on_ties_zeros_and_nan(name):
    """minimum, maximum: the first of two equal numbers and of a pair with a NaN, bit for bit."""
    primitive = getattr(algebra, name)
    plain = np.array([primitive(*pair) for pair in PAIRS.T.tolist()])
    for got in (on_columns(lambda a, b: primitive(a, b), *PAIRS)[0], primitive(*PAIRS)):
        np.testing.assert_array_equal(got, plain)
        np.testing.assert_array_equal(np.signbit(got), np.signbit(plain))


def test_comparisons_and_choices_agree_with_plain_ones():
    def function(a, b):
        conditions = (
            a < b,
            a <= b,
            a > b,
            a >= b,
            a == b,
            a != b,
            (a < b) | (a == 1.0),
            algebra.logical_not(a < b) & (b != b),
        )
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
    ("key", "counter", "words"),
    [  # Random123's known-answer vectors of philox4x32-10
        ((0, 0), (0, 0, 0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
        ((2**32 - 1,) * 2, (2**32 - 1,) * 4, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
        (
            (0xA4093822, 0x299F31D0),
            (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
            (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
        ),
    ],
)
def test_philox_known_answers(key, counter, words):
    p = Kernel("draw", {"given": "u32", "words": "u32", "numbers": "f64"})
    given = [p.load(p["given"], k) for k in range(6)]
    for k, word in enumerate(philox(given[:2], given[2:])):
        p.store(p["words"], k, word)
        p.store(p["numbers"], k, uniform(p, word))
    got, numbers = np.zeros(4, np.uint32), np.zeros(4)
    compiled(p)(given=np.array([*key, *counter], np.uint32), words=got, numbers=numbers)
    assert tuple(got) == words
    np.testing.assert_array_equal(numbers, (np.array(words) + 0.5) / 2**32)


@pytest.mark.parametrize("word", [0, 2**32 - 1])
def test_a_draw_is_neither_zero_nor_one(word):
    p = Kernel("draw", {"words": "u32", "numbers": "f64"})
    p.store(p["numbers"], 0, uniform(p, p.load(p["words"])))
    numbers = np.zeros(1)
    compiled(p)(words=np.array([word], np.uint32), numbers=numbers)
    assert 0.0 < numbers[0] < 1.0


# ---- tables ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("columns", [1, 2, 3, 4, 5, 7, 8, 11])
def test_tables_of_any_number_of_columns_are_read_and_written(columns, kind):
    """The rows of tables, one for each lane, are contiguous; a row beyond the last is not touched."""
    element = {np.float32: "f32", np.float64: "f64"}[kind]
    names = tuple(f"x{k}" for k in range(columns))
    layout = Layout([Field(n, "", "", SCRATCH) for n in names])

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
    layout = Layout([Field("x", "", "", STATE), Field("y", "", "", STATE)])

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


# ---- a long step as calls --------------------------------------------------------------------------


@physics
def braking(coordinate, rate, level):
    return -level * (coordinate * rate)


@dataclasses.dataclass(frozen=True)
class Brake(Effect):
    """A force of a position times a rate: the later part of a stage needs its own position."""

    level: float = 0.5

    def hooks(self, arm):
        bind = {"coordinate": arm.coordinates[1], "rate": arm.rates[1], "level": ".level"}
        return (Force(1, braking, bind=bind),)


STEPPED = {
    "4R": rde.Scene(FOUR_R, (e.Gravity(), e.ViscousFriction(0.1)), integrator="rk8"),
    "RPRP held": rde.Scene(
        RPRP, (e.Gravity(), e.PrismaticStop((0.0, 0.0), (0.3, 0.3))), integrator="rk8"
    ),
    "RPRP, springs in positions alone": rde.Scene(
        RPRP, (e.CentringSpring((30.0, 20.0), (0.0, 0.0), (0.3, 0.3)),), integrator="rk8"
    ),
    "RPRP, a force of position times rate": rde.Scene(RPRP, (Brake(),), integrator="rk8"),
}  # fmt: skip
LONG = ("RPRP held", "RPRP, springs in positions alone")


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.long) if n in LONG else n for n in STEPPED]
)
def test_a_step_by_calls_is_the_step_of_copies(name, monkeypatch):
    """One function for all stages or a copy in each: the same to rounding."""
    scene = dataclasses.replace(STEPPED[name], control_dt=0.02)
    rng = np.random.default_rng(0)
    q, qd = rng.uniform(0.0, 0.3, (40, 4)), rng.normal(0.0, 1.0, (40, 4))
    states, keys = [], set()
    for most in (4, 12):
        monkeypatch.setattr(steps, "MOST_INLINED", most)
        monkeypatch.setattr(programs, "_kept", OrderedDict())
        batch = rde.BatchSimulator(scene, 40)
        batch.set_state(q, qd)
        for _ in range(3):
            assert batch.advance().finite.all()
        states.append(np.hstack([batch.q, batch.qd]))
        keys.add(batch.simulator.key)
    np.testing.assert_allclose(states[0], states[1], rtol=1e-12, atol=1e-13)
    assert len(keys) == 2


@pytest.mark.parametrize("integrator", ["euler", "rk4", "rk8"])
def test_the_step_of_free_sliders_is_the_step_of_all_to_the_last_bit(integrator):
    """The form that a lane goes through depends on its neighbours, so its bits must not depend on the
    form."""
    simulator = batch_simulator(dataclasses.replace(STEPPED["RPRP held"], integrator=integrator), False)
    blocks, layout = simulator.blocks, simulator.blocks.layout
    interval, features = simulator.interval, simulator.interval.dynamics
    known, arm = dict.fromkeys(features.active, 0.0), simulator.dynamics.arm
    p = Kernel("both", {f"{life}_{name}": "f64" for name in ("free", "every") for life in Lifetime})
    for name, numbers in (("free", known), ("every", {})):
        function = traced(name, layout, interval.step.common_step, known=numbers)
        p.call(function, **{str(life): p[f"{life}_{name}"] for life in Lifetime})
    step = compiled(p)
    assert {"common", "common_held"} <= set(blocks.functions)
    rng = np.random.default_rng(0)
    parameters = rde.BatchSimulator(simulator.dynamics.scene)._memory.arrays[str(PARAMETER)][0]
    held_somewhere = 0
    for _ in range(300):
        memories = {
            name: {str(life): aligned(layout.size(life), LANES) for life in Lifetime}
            for name in ("free", "every")
        }
        for field in (*simulator.dynamics.states, *simulator.dynamics.commands, *features.active):
            space, row = layout.row_of(field)
            values = rng.normal(0.0, 2.0, LANES)
            if field in features.active:
                values = rng.choice([0.0, 0.0, 1.0, -1.0], LANES)
            for memory in memories.values():
                memory[space][row] = values
        for memory in memories.values():
            memory[str(PARAMETER)][:] = parameters
        before = memories["free"][str(STATE)].copy()
        step(**{f"{life}_{name}": a for name, memory in memories.items() for life, a in memory.items()})
        free, every = (memory[str(STATE)] for memory in memories.values())
        held = {n: before[layout.row_of(n)[1]] != 0.0 for n in features.active}
        unheld = ~np.any(list(held.values()), axis=0)
        np.testing.assert_array_equal(free[:, unheld], every[:, unheld])
        rates = {b.active: layout.row_of(arm.rates[b.joint])[1] for b in features.holding}
        assert (free[0, unheld] != before[0, unheld]).all()
        for name, row in rates.items():
            assert (every[row, held[name]] == before[row, held[name]]).all()
        held_somewhere += (~unheld).sum()
    assert held_somewhere > 100


# ---- the compiler ----------------------------------------------------------------------------------


def probe():
    """A program whose order LLVM would change: sums and products of many rows."""
    graph = Graph()
    rows = [graph.load("row", k) for k in range(40)]
    total = rows[0]
    for a, b in itertools.pairwise(rows):
        total = graph.add(graph.multiply(graph.divide(a, b), total), b)
    p = Kernel("probe", {"row": "f64"})
    p.call(LaneFunction("probe", ("row",), [("row", 40, total)]), row=p["row"])
    return Program([p])


def test_llvm_has_its_own_order_again_afterwards():
    """The switch is global to LLVM: code that others compile must be the same as without us."""
    llvm.initialise()
    text = str(llvm_kernels.module_of(probe(), False, llvm.host().triple))

    def by_others():
        return llvm.machine().emit_assembly(binding.parse_assembly(text))

    before = by_others()
    binding.set_option("test", llvm.ORDER_OPTION.format("false"))
    try:
        assert by_others() != before
    finally:
        binding.set_option("test", llvm.ORDER_OPTION.format("true"))
    assert by_others() == before
    llvm.object_code(probe())
    assert by_others() == before
    with pytest.raises(RuntimeError):
        llvm._emitted(probe(), lambda target, module: binding.parse_assembly("no assembly"))
    assert by_others() == before


def test_a_program_is_compiled_to_the_same_code_every_time():
    """Another process requests the same program, even for one whose graphs were changed."""
    program = batch_simulator(STEPPED["4R"], False).program
    code = llvm.object_code(program)
    assert llvm.object_code(program) == code
    assert llvm.object_code(batch_simulator(STEPPED["4R"], False).program) == code
