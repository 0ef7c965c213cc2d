"""Curves of sensors by penalised least squares: `realitygap.calibration.curves`, compiled.

Matrices are kept as bands [3, S, STEPS + 1], diagonal last.
"""

import math

import numpy as np

from realitygap.compiled import routine, step

STEPS = 80
"""Of a curve."""
ROUNDS, STEEP = 12, 1e6
"""Rounds of one fit, and the weight that keeps a curve from falling."""
SETTLED = 1e-3
"""A curve has converged when a round moves it by less than this share of the full scale."""


@step
def _cell(u):
    """The step of a curve that a share of light lies in, and how far along it."""
    at = min(max(u, 0.0), 1.0) * STEPS
    j = min(int(at), STEPS - 1)
    return j, at - j


@routine
def normal(u, use, noise):
    """[3, S, STEPS + 1] bands of the normal equations of readings in use."""
    bread = np.zeros((3, u.shape[1], STEPS + 1))
    for i in range(u.shape[0]):
        for k in range(u.shape[1]):
            if use[i, k]:
                j, share = _cell(u[i, k])
                bread[2, k, j] += (1.0 - share) * (1.0 - share) / noise**2
                bread[2, k, j + 1] += share * share / noise**2
                bread[1, k, j + 1] += (1.0 - share) * share / noise**2
    return bread


@routine
def right_side(u, counts, use, most, dead, dark, noise, curves):
    """[S or 1, STEPS + 1] their right side: readings, and where one ends at 0, in the dead zone or at the top
    what is expected beyond by curves [S or 1, STEPS + 1]."""
    right = np.zeros(curves.shape)
    for i in range(u.shape[0]):
        for k in range(u.shape[1]):
            if not use[i, k]:
                continue
            row = min(k, curves.shape[0] - 1)
            j, share = _cell(u[i, k])
            full = counts[i, k]
            if full <= 0.0 or full >= most[k]:
                model = curves[row, j] + share * (curves[row, j + 1] - curves[row, j])
                full = max(model, full) if full > 0.0 else _dark(model, dead, dark)
            right[row, j] += full * (1.0 - share) / noise**2
            right[row, j + 1] += full * share / noise**2
    return right


@step
def _dark(model, dead, dark):
    """What is expected of a reading of 0 (Tobin 1958)."""
    if dark > 0.0:
        a = min(max(-model / dark, -6.0), 6.0)
        model -= dark * math.sqrt(2.0 / math.pi) * math.exp(-a * a / 2.0) / math.erfc(-a / math.sqrt(2.0))
    return min(model, dead)


@routine
def solved(bread, bends, towards, alike, u, counts, use, most, top, dead, dark, noise):
    """The curves [S, STEPS + 1] of bands [3, S, STEPS + 1], and whether there are any: close to others, by
    `alike`, or with `alike` 0 the one that all sensors share [1, STEPS + 1]."""
    sensors, size, each = bread.shape[1], bread.shape[2], bread[2].mean()
    matrix, pulled = np.empty_like(bread), np.zeros((sensors, size))
    for k in range(sensors):
        held = bends * each
        for j in range(size):
            held[2, j] += (alike * max(towards[k, j], top)) ** -2.0 if alike > 0.0 else 1e-12
            pulled[k, j] += held[2, j] * towards[k, j]
            for back in range(1, min(j, 2) + 1):
                pulled[k, j] += held[2 - back, j] * towards[k, j - back]
                pulled[k, j - back] += held[2 - back, j] * towards[k, j]
        matrix[:, k] = bread[:, k] + held
    curves, falls = towards.copy(), np.zeros((sensors, size - 1), np.bool_)
    factors = matrix.copy()
    if not _factored(factors):
        return curves, False
    for _ in range(ROUNDS):
        right = right_side(u, counts, use, most, dead, dark, noise, curves) + pulled
        _substituted(factors, right)
        moved, more = np.abs(right - curves).max(), False
        curves = right
        for k in range(sensors):
            for j in range(size - 1):
                if curves[k, j + 1] < curves[k, j] and not falls[k, j]:
                    more, falls[k, j] = True, True
        if more:
            factors[:] = matrix
            for k in range(sensors):
                for j in range(size - 1):
                    if falls[k, j]:
                        factors[2, k, j] += STEEP * each
                        factors[2, k, j + 1] += STEEP * each
                        factors[1, k, j + 1] -= STEEP * each
            if not _factored(factors):
                return curves, False
        elif moved < SETTLED * top:
            break
    return curves, True


@routine
def _factored(bands):
    """Cholesky's factors of symmetric matrices [3, S, n], in their place; False where one is not positive
    definite."""
    for k in range(bands.shape[1]):
        for j in range(bands.shape[2]):
            far, near = 0.0, bands[1, k, j]
            if j > 1:
                far = bands[0, k, j] / bands[2, k, j - 2]
                near -= far * bands[1, k, j - 1]
            if j > 0:
                near /= bands[2, k, j - 1]
            left = bands[2, k, j] - far * far - near * near
            if not left > 0.0:
                return False
            bands[0, k, j], bands[1, k, j], bands[2, k, j] = far, near, math.sqrt(left)
    return True


@routine
def _substituted(factors, right):
    """Right sides [S, n] become what solves them."""
    n = right.shape[1]
    for k in range(right.shape[0]):
        for j in range(n):
            for back in range(1, min(j, 2) + 1):
                right[k, j] -= factors[2 - back, k, j] * right[k, j - back]
            right[k, j] /= factors[2, k, j]
        for j in range(n - 1, -1, -1):
            for on in range(1, min(n - 1 - j, 2) + 1):
                right[k, j] -= factors[2 - on, k, j + on] * right[k, j + on]
            right[k, j] /= factors[2, k, j]
