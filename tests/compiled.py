"""Small kernels and lane functions of tests, compiled and called."""

import inspect

import numpy as np

from redundant_envs.compiler.backends import llvm
from redundant_envs.compiler.tracing.flow import LANES, Kernel, LaneFunction, Program
from redundant_envs.compiler.tracing.graph import Graph
from redundant_envs.compiler.tracing.number import Condition, Number, value_of
from redundant_envs.language.algebra import where
from redundant_envs.model.programs import Call


def flat(result):
    """Numbers of a result, conditions as 1 or 0."""
    if isinstance(result, tuple | list):
        return [x for part in result for x in flat(part)]
    return [where(result, 1.0, 0.0) if isinstance(result, Condition | bool | np.bool_) else result]


def rows_of(graph, count):
    """Numbers in rows 0, 1, ..."""
    return [Number(graph, graph.load("row", k)) for k in range(count)]


def recorded(function, count=None, graph=None):
    """The results of a function of rows 0, 1, ... as values of a graph."""
    count = count or len(inspect.signature(function).parameters)
    return [value_of(r) for r in flat(function(*rows_of(graph or Graph(), count)))]


def compiled(kernel):
    """A kernel to be called with its arguments by name."""
    call = Call(kernel.arguments, llvm.load(llvm.object_code(Program([kernel])), [kernel.name])[kernel.name])

    def run(**arguments):
        call.set(**arguments)
        call()

    return run


def kernel_of(results, count, known=None):
    """A kernel that takes all blocks of 8 lanes, (count + len(results)) rows each, through some results."""
    stores = [("row", count + k, r) for k, r in enumerate(results)]
    function = LaneFunction("probe", ("row",), stores, known=known or {})
    p = Kernel("probe", {"rows": "f64", "blocks": "int"})
    with p.each(p["blocks"]) as block:
        p.call(function, row=p["rows"] + block * (LANES * (count + len(results))))
    return p


def on_columns(function, *columns, known=None):
    """Results of a function, compiled, where its arguments are columns of numbers; (results, lanes)."""
    lanes, count = len(columns[0]), len(columns)
    results = recorded(function, count)
    blocks = -(-lanes // LANES)
    table = np.zeros((count + len(results), blocks * LANES))
    table[:count, :lanes] = columns
    rows = np.ascontiguousarray(table.reshape(len(table), blocks, LANES).swapaxes(0, 1))
    compiled(kernel_of(results, count, known))(rows=rows, blocks=blocks)
    return rows.swapaxes(0, 1).reshape(len(table), -1)[count:, :lanes]
