"""The figures of the cycle model, from `timing.toml`."""

import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

TIMING = Path(__file__).with_name("timing.toml")

# Figures of the pipeline that stand in the state array, in this order
PIPELINE = (
    "fetch_latency",
    "buffer_words",
    "branch_fetch",
    "branch_register_fetch",
    "load_pc_fetch",
    "pop_pc_fetch",
    "table_fetch",
    "speculation",
    "address_after_alu",
    "address_after_load",
    "address_after_base",
    "load_after_store",
    "store_indexed",
    "load_after_store_indexed",
    "nop_hides",
    "fp_result",
    "it_folds",
    "literal",
    "divide_least",
    "divide_most",
    "fp_load_pipelines",
    "unaligned_row",
    "unaligned_floats",
)
(
    FETCH_LATENCY,
    BUFFER_WORDS,
    BRANCH_FETCH,
    BRANCH_REGISTER_FETCH,
    LOAD_PC_FETCH,
    POP_PC_FETCH,
    TABLE_FETCH,
    SPECULATION,
    ADDRESS_AFTER_ALU,
    ADDRESS_AFTER_LOAD,
    ADDRESS_AFTER_BASE,
    LOAD_AFTER_STORE,
    STORE_INDEXED_CYCLES,
    LOAD_AFTER_STORE_INDEXED,
    NOP_HIDES,
    FP_RESULT,
    IT_FOLDS,
    LITERAL_CYCLES,
    DIVIDE_LEAST,
    DIVIDE_MOST,
    FP_LOAD_PIPELINES,
    UNALIGNED_ROW,
    UNALIGNED_FLOATS,
) = range(len(PIPELINE))
SETS = 3
"""The model, its optimistic bound, its pessimistic one."""


@dataclass(frozen=True)
class Timing:
    """The figures, as `timing.toml` explains them.

    pipeline: int64 (SETS, len(PIPELINE)). exceptions: entry, exit and tail-chain, cycles.
    """

    pipeline: NDArray[np.int64]
    exceptions: dict[str, int]
    cycles: dict[str, int]
    fp_cycles: dict[str, int]
    fp_long: frozenset[str]


@cache
def timing() -> Timing:
    """The shipped figures."""
    with TIMING.open("rb") as file:
        data = tomllib.load(file)
    rows = [
        [figure] * SETS if isinstance(figure, int) else figure
        for figure in map(data["pipeline"].get, PIPELINE)
    ]
    return Timing(
        np.array(rows, dtype=np.int64).T.copy(),
        data["exceptions"],
        data["cycles"] | data["fp_long"],
        data["fp_cycles"],
        frozenset(data["fp_long"]),
    )
