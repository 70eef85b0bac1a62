"""Lane functions as instructions: what is fused, the order, the stages, and LLVM's own order."""

import dataclasses
import inspect

import numpy as np
import pytest
from llvmlite import ir

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.evaluators import cpu
from redundant_envs.evaluators.assemble import assemble
from redundant_envs.evaluators.instructions import DOUBLE, LANES, Graph, Number, fuse, reached, specialise
from redundant_envs.evaluators.order import NO_COST, in_order
from redundant_envs.evaluators.prelude import where
from redundant_envs.evaluators.stages import Stages, Subroutine, emit

VECTOR = ir.VectorType(DOUBLE, LANES)
FOUR_R = rde.FourR((1.0, 0.8, 0.6, 0.4), (0.5, 0.4, 0.3, 0.2))


def recorded(function):
    """The results of a function on rows 0, 1, ... as operations of a graph."""
    graph = Graph()
    count = len(inspect.signature(function).parameters)
    results = function(*(Number(graph, graph.load("row", k, VECTOR)) for k in range(count)))
    return [r.value for r in (results if isinstance(results, tuple) else (results,))]


def test_a_product_used_once_is_joined_with_its_sum():
    (total,) = recorded(lambda a, b, c: a * b + c)
    fuse([total])
    assert total.name == "llvm.fma"
    (difference,) = recorded(lambda a, b, c: c - a * b)
    fuse([difference])
    assert difference.name == "llvm.fma"
    assert difference.arguments[0].name == "fneg"


def test_a_product_used_twice_is_rounded_once_for_all():
    def twice(a, b, c):
        p = a * b
        return p + c, p

    total, product = recorded(twice)
    fuse([total, product])
    assert (total.name, product.name) == ("fadd", "fmul")


def test_of_two_products_the_later_one_is_joined():
    (total,) = recorded(lambda a, b: (a / b) * b + a * b)
    fuse([total])
    assert total.arguments[0].name == "fdiv"
    (total,) = recorded(lambda a, b: a * b + (a / b) * b)
    fuse([total])
    assert total.arguments[0].name == "fdiv"


@pytest.mark.parametrize(
    "same", [lambda x: x * 1.0, lambda x: x + -0.0, lambda x: x - 0.0, lambda x: x / 1.0]
)
def test_what_changes_no_bit_is_not_computed(same):
    assert recorded(same)[0].name == "load"


@pytest.mark.parametrize(
    "other", [lambda x: x + 0.0, lambda x: x * -1.0, lambda x: 0.0 - x, lambda x: x - -0.0]
)
def test_what_may_change_a_bit_is_computed(other):
    assert recorded(other)[0].name != "load"


def test_a_known_row_drops_what_is_never_chosen_and_splits_nothing():
    def held(x, y, mode):
        p = x * y
        return where(abs(mode) > 0.0, p - x, y), p + 1.0

    results = recorded(held)
    fuse(results)
    left, total = specialise(results, {2: 0.0})
    assert left.extra == ("row", 1)
    # Without the other choice the product is used once, but the bits must be those of the whole.
    assert (total.name, total.arguments[0].name) == ("fadd", "fmul")
    assert {n.name for n in reached([left, total])} == {"load", "fmul", "fadd"}


def random_results(rng, count=300):
    """Results of a random expression: sums, products, quotients, choices, some used often."""

    def function(a, b, c):
        values = [a, b, c]
        for _ in range(count):
            x, y = (values[k] for k in rng.integers(max(0, len(values) - 40), len(values), 2))
            kind = rng.integers(5)
            values.append((x + y, x - y, x * y, x / y, where(x < y, x, -y))[kind])
        return tuple(values[-8:])

    return recorded(function)


@pytest.mark.parametrize("seed", range(5))
def test_order_is_complete_and_each_operation_follows_its_operands(seed):
    results = random_results(np.random.default_rng(seed))
    fuse(results)
    order = in_order(results)
    assert set(order) == {n for n in reached(results) if n.name not in NO_COST}
    assert len(order) == len(set(order))
    place = {n: k for k, n in enumerate(order)}
    for n in order:
        for a in reached(n.operands):
            assert a.name in NO_COST or place[a] < place[n]


def test_order_is_the_same_every_time():
    orders = [[n.name for n in in_order(random_results(np.random.default_rng(3)))] for _ in range(2)]
    assert orders[0] == orders[1]


def test_a_chain_does_not_keep_other_work_waiting():
    """Beside a chain of divisions there is time for all sums that do not need it."""

    def function(a, b):
        chain = a
        for _ in range(4):
            chain = b / chain
        sums = [a + b * float(k) for k in range(12)]
        total = sums[0]
        for s in sums[1:]:
            total = total + s
        return chain + total

    names = [n.name for n in in_order(recorded(function))]
    assert max(k for k, name in enumerate(names) if name == "fdiv") > 15


def test_positions_that_need_the_stage_before_are_refused():
    double = Subroutine(lambda x, v: (x + v,), positions=1, results=1)
    graph = Graph()
    x, v = (Number(graph, graph.load("row", k, VECTOR)) for k in range(2))
    for _ in range(2):
        (x,) = double(x, v)
    calls = [n for n in reached([x.value]) if n.name == "stage"]
    with pytest.raises(ValueError, match="follow from its results in the stage before"):
        Stages(calls, None, {})


def test_stages_share_one_copy_of_the_right_hand_side():
    rate = Subroutine(lambda x, v, k: (-(k * x) - v * v,), positions=1, results=1)

    def step(x, v, k):
        for _ in range(5):
            (a,) = rate(x, v, k)
            x, v = x + v, v + a
        return x, v

    module = ir.Module()
    function = ir.Function(module, ir.FunctionType(ir.VoidType(), [DOUBLE.as_pointer()]), "step")
    builder = ir.IRBuilder(function.append_basic_block())
    emit(builder, recorded(step), function.args[0], {})
    text = str(module)
    assert text.count("define internal") == 3
    assert text.count("call {<8 x double>}") == 5
    assert text.count("call void") == 1


SCENES = {
    "4R": rde.Scene(FOUR_R, (e.Gravity(), e.ViscousFriction(0.1)), integrator="rk8"),
    "RPRP held": rde.Scene(
        rde.RPRP((1.0, 0.8, 0.6, 0.4), (0.5, 0.4)),
        (e.Gravity(), e.PrismaticStop((0.0, 0.0), (0.3, 0.3))),
        integrator="rk8",
    ),
    "RPRP, springs in positions alone": rde.Scene(
        rde.RPRP((1.0, 0.8, 0.6, 0.4), (0.5, 0.4)),
        (e.CentringSpring((30.0, 20.0), (0.0, 0.0), (0.3, 0.3)),),
        integrator="rk8",
    ),
}


@pytest.mark.parametrize(
    "name", ["4R", *(pytest.param(n, marks=pytest.mark.long) for n in SCENES if n != "4R")]
)
def test_a_step_by_calls_is_the_step_of_copies(name, monkeypatch):
    """One function for all stages or a copy in each: the same to rounding."""
    from redundant_envs.evaluators import assemble as assembling

    scene = dataclasses.replace(SCENES[name], control_dt=0.02)
    rng = np.random.default_rng(0)
    q, qd = rng.uniform(0.0, 0.3, (40, 4)), rng.normal(0.0, 1.0, (40, 4))
    states = []
    for most in (4, 12):
        monkeypatch.setattr(assembling, "MOST_INLINED", most)
        assert ("Subroutine(rhs" in assemble(scene).text) == (most == 4)
        batch = rde.BatchSimulator(scene, 40)
        batch.set_state(q, qd)
        for _ in range(3):
            assert batch.advance().finite.all()
        states.append(np.hstack([batch.q, batch.qd]))
    np.testing.assert_allclose(states[0], states[1], rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("integrator", ["euler", "rk4", "rk8"])
def test_the_step_of_free_sliders_is_the_step_of_all_to_the_last_bit(integrator):
    """Which of the two a lane goes through depends on its neighbours, so no bit may."""
    assembly = assemble(dataclasses.replace(SCENES["RPRP held"], integrator=integrator))
    text = (
        assembly.text.split("SIGNATURES")[0]
        + """
def free(W):
    step(W, 0)


def every(W):
    step_held(W, 0)


SIGNATURES = dict.fromkeys(("free", "every"), "void(float64[::1])")
"""
    )
    namespace = {"CACHE": False}
    with cpu._order_kept():
        exec(compile(text + cpu.KERNELS, "probe", "exec"), namespace)
    rng, rows = np.random.default_rng(0), assembly.every_row
    held_somewhere = 0
    for _ in range(300):
        block = np.zeros((len(rows), LANES))
        block[: len(assembly.rows)] = cpu.Memory(assembly, LANES).blocks[0]
        for name in (*assembly.states[:8], *(f"command{k}" for k in range(1, 5))):
            block[rows[name]] = rng.normal(0.0, 2.0, LANES)
        block[rows["phase"]] = 2.0
        for mode in ("mode_a", "mode_b"):
            block[rows[mode]] = rng.choice([0.0, 0.0, 1.0, -1.0], LANES)
        unheld = np.abs(block[rows["mode_a"]]) + np.abs(block[rows["mode_b"]]) == 0.0
        free, every = block.reshape(-1).copy(), block.reshape(-1).copy()
        namespace["free"](free)
        namespace["every"](every)
        free, every = free.reshape(-1, LANES), every.reshape(-1, LANES)
        np.testing.assert_array_equal(free[:, unheld], every[:, unheld])
        assert (free[rows["r1"], unheld] != block[rows["r1"], unheld]).all()
        for mode, rate in (("mode_a", "v1"), ("mode_b", "v2")):
            held = block[rows[mode]] != 0.0
            assert (every[rows[rate], held] == block[rows[rate], held]).all()
        held_somewhere += (~unheld).sum()
    assert held_somewhere > 100


def test_llvm_has_its_own_order_again_afterwards():
    """The switch is one for all of LLVM: what others compile is as it would be without us."""

    text = assemble(dataclasses.replace(SCENES["4R"], integrator="rk4")).text + cpu.KERNELS

    def compiled():
        namespace = {"CACHE": False}
        exec(compile(text, "probe", "exec"), namespace)
        return "\n".join(namespace["advance"].inspect_asm().values())

    def without_names(text):
        return [
            line for line in text.splitlines() if line.startswith("\t") and "%" in line and "$" not in line
        ]

    before = without_names(compiled())
    with cpu._order_kept():
        inside = without_names(compiled())
    assert inside != before
    assert without_names(compiled()) == before


def test_pairs_of_columns_are_taken_in_any_even_number():
    text = assemble(rde.Scene(FOUR_R, (), integrator="euler")).text
    code = """
fetch = take((0, 2, 1, 3, 5, 4))


def fetch_all(source, rows):
    fetch(source, 0, rows, 0)


SIGNATURES = {"fetch_all": "void(KIND[:, ::1], float64[::1])"}
"""
    for kind in (np.float64, np.float32):
        namespace = {"CACHE": False}
        body = code.replace("KIND", kind.__name__)
        exec(compile(text.split("SIGNATURES")[0] + body + cpu.KERNELS, "probe", "exec"), namespace)
        table = np.arange(48, dtype=kind).reshape(8, 6)
        rows = np.zeros((6, 8))
        namespace["fetch_all"](table, rows.reshape(-1))
        for column, row in enumerate((0, 2, 1, 3, 5, 4)):
            np.testing.assert_array_equal(rows[row], table[:, column])
