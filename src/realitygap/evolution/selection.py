"""Selection by linear rank (§5.1), compiled.

Ranks 1 (worst) .. n (best) weigh as much as they say: rank r is drawn with probability
2r / (n(n + 1)); by inverse rank the worst weighs n and the best 1. Ties are in random order.

Every cell holds somebody: fitness is finite. Draws under an event's stream are named CELL, MATE
and REPLACED (`streams.py`).

A draw needs no sorting: of n candidates and one nobody, two are drawn without repetition and the
fitter wins, nobody losing to all. Rank r wins against the r − 1 below it and against nobody: in r
of n(n + 1)/2 pairs.
"""

# mypy: allow-untyped-defs, no-check-untyped-defs
import numpy as np

from realitygap.kernels.jit import routine, step
from realitygap.kernels.rng import below, bits, substream
from realitygap.streams import CELL, MATE, REPLACED

__all__ = ["panmictic_event", "torus_event"]


@step
def _by_rank(fitness, cells, n, sign, stream):
    """One of cells[:n] by linear rank of sign · fitness: the winner of a pair (see above)."""
    i = below(stream, 0, n + 1)
    j = below(stream, 1, n)
    if j >= i:
        j += 1
    if i == n:
        return cells[j]
    if j == n:
        return cells[i]
    a = sign * fitness[cells[i]]
    b = sign * fitness[cells[j]]
    if a > b or (a == b and bits(stream, 2) & np.uint64(1)):
        return cells[i]
    return cells[j]


@step
def _neighbourhood(cell, rows, columns, cells):
    """Fills `cells` with the eight neighbours of a cell on the torus, then itself."""
    row = cell // columns
    column = cell - row * columns
    n = 0
    for down in range(-1, 2):
        for right in range(-1, 2):
            if down != 0 or right != 0:
                cells[n] = (row + down + rows) % rows * columns + (column + right + columns) % columns
                n += 1
    cells[8] = cell


@routine
def torus_event(fitness, rows, columns, event):
    """(cell that breeds, its mate, the cell that the offspring takes) on a grid with fitness [rows · columns]
    (§5.1).

    Args:
        fitness: [rows · columns] of the grid.
        rows, columns: its size.
        event: random numbers.
    """
    cell = below(substream(event, CELL), 0, rows * columns)
    cells = np.empty(9, np.int64)
    _neighbourhood(cell, rows, columns, cells)
    mate = _by_rank(fitness, cells, 8, 1.0, substream(event, MATE))
    replaced = _by_rank(fitness, cells, 9, -1.0, substream(event, REPLACED))
    return cell, mate, replaced


@routine
def panmictic_event(fitness, event):
    """(cell that breeds, its mate, the cell that the offspring takes) among all cells."""
    size = len(fitness)
    cell = below(substream(event, CELL), 0, size)
    cells = np.arange(size)
    cells[cell] = size - 1
    cells[size - 1] = cell
    mate = _by_rank(fitness, cells, size - 1, 1.0, substream(event, MATE))
    replaced = _by_rank(fitness, cells, size, -1.0, substream(event, REPLACED))
    return cell, mate, replaced
