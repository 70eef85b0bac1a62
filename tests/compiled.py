"""Small kernels and lane functions of tests, compiled and called."""

import inspect

import numpy as np

from redundant_envs.algebra import where
from redundant_envs.backends import llvm
from redundant_envs.batch.blocks import LANES
from redundant_envs.model.programs import Call
from redundant_envs.tracing.flow import Kernel, LaneFunction, Program
from redundant_envs.tracing.graph import Graph
from redundant_envs.tracing.number import Condition, Number, value_of


def recorded(function, space="row"):
    """The results of a function on numbers 0, 1, ... of a space, as values of a graph."""
    graph = Graph()
    count = len(inspect.signature(function).parameters)
    results = function(*(Number(graph, graph.load(space, k)) for k in range(count)))
    return [
        value_of(where(r, 1.0, 0.0) if isinstance(r, Condition) else r)
        for r in (results if isinstance(results, tuple | list) else (results,))
    ]


def compiled(kernel):
    """A kernel to be called with its arguments by name."""
    call = Call(kernel, llvm.load(llvm.object_code(Program([kernel])), [kernel.name])[kernel.name])

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
    results = recorded(function)
    lanes, count = len(columns[0]), len(columns)
    blocks = -(-lanes // LANES)
    table = np.zeros((count + len(results), blocks * LANES))
    table[:count, :lanes] = columns
    rows = np.ascontiguousarray(table.reshape(len(table), blocks, LANES).swapaxes(0, 1))
    compiled(kernel_of(results, count, known))(rows=rows, blocks=blocks)
    return rows.swapaxes(0, 1).reshape(len(table), -1)[count:, :lanes]
