"""Comparisons of two groups of controllers within strata; slopes within units; a peak's interval.

All tests are two-sided. Positive values favour the first group.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.experiments.noise.contrasts import paired, unpaired
from realitygap.experiments.noise.crossed import Crossed
from realitygap.values import Floats

__all__ = [
    "Groups", "Tested", "by_failures", "by_means", "by_ranks", "by_signed_ranks", "by_slopes", "groups",
    "mean_interval",
]  # fmt: skip

Groups = Sequence[tuple[Floats, Floats]]
"""The values of both groups in each stratum."""

BATCH = 2000
"""Permutations in memory at once."""


class Tested(NamedTuple):
    """Result of a test: an effect, the statistic whose sign counts, and p (1 if nothing can be concluded)."""

    effect: float
    statistic: float
    p: float


NOTHING = Tested(math.nan, 0.0, 1.0)


def groups(data: Crossed, values: Floats, levels: tuple[float, float], least: int) -> Groups:
    """Known values of controllers evolved at either level, within task and calibration unit; strata with
    fewer than `least` of either are left out.

    Args:
        data: the controllers.
        values: [n] one per controller, NaN if unknown.
        levels: of noise: first, second.
        least: smallest number of controllers of either level in a stratum.
    """
    pairs: dict[object, tuple[list[float], list[float]]] = {}
    for which, level in enumerate(levels):
        for i in np.flatnonzero((data.evolved == level) & np.isfinite(values)):
            pairs.setdefault((data.task[i], data.home[i]), ([], []))[which].append(values[i])
    return [(np.array(x), np.array(y)) for x, y in pairs.values() if min(len(x), len(y)) >= least]


def by_signed_ranks(first: Floats, second: Floats) -> Tested:
    """Two values of the same controllers [n]: Wilcoxon's test with Pratt's zeros.

    The effect is the rank-biserial correlation: the sum of ranks in favour minus that against, over both.
    """
    from scipy.stats import rankdata

    gap = first - second
    ranks = rankdata(np.abs(gap)) * np.sign(gap)
    excess, whole = float(ranks.sum()), float(np.abs(ranks).sum())
    return Tested(excess / whole if whole else 0.0, excess, paired(first, second).p)


def by_ranks(pairs: Groups) -> Tested:
    """Mann and Whitney's test within strata; the effect is Cliff's delta."""
    if not pairs:
        return NOTHING
    first, second = (np.concatenate([pair[k] for pair in pairs]) for k in (0, 1))
    keys = tuple([k for k, pair in enumerate(pairs) for _ in pair[which]] for which in (0, 1))
    effect = unpaired(first, second, strata=(keys[0], keys[1]))
    return Tested(effect.delta, effect.delta, effect.p)


def by_means(pairs: Groups, *, permutations: int, seed: int) -> Tested:
    """Difference of means by permutation within strata, weighted by their controllers; without permutations
    there is no p."""
    if not pairs:
        return NOTHING
    share = _shares(pairs)
    gap = float(sum(w * (x.mean() - y.mean()) for w, (x, y) in zip(share, pairs, strict=True)))
    if not permutations:
        return Tested(gap, gap, math.nan)
    draw, beyond, slack = np.random.default_rng(seed), 0, 1e-9 * max(1.0, abs(gap))
    for begin in range(0, permutations, BATCH):
        drawn = np.zeros(min(BATCH, permutations - begin))
        for w, (x, y) in zip(share, pairs, strict=True):
            every = np.tile(np.concatenate([x, y]), (len(drawn), 1))
            mine = draw.permuted(every, axis=1)[:, : len(x)].sum(axis=1)
            drawn += w * (mine / len(x) - (every[0].sum() - mine) / len(y))
        beyond += int((np.abs(drawn) >= abs(gap) - slack).sum())
    return Tested(gap, gap, (1 + beyond) / (1 + permutations))


def mean_interval(pairs: Groups, share: float) -> tuple[float, float]:
    """Interval of the difference of means within strata of at least two controllers: Welch's, over strata."""
    from scipy.stats import t

    if not pairs:
        return (math.nan, math.nan)
    gap = by_means(pairs, permutations=0, seed=0).effect
    parts = [
        (w**2 * group.var(ddof=1) / len(group), len(group) - 1)
        for w, pair in zip(_shares(pairs), pairs, strict=True) for group in pair
    ]  # fmt: skip
    variance, spread = sum(v for v, _ in parts), sum(v**2 / free for v, free in parts)
    if variance <= 0:
        return (gap, gap)
    half = float(t.ppf((1 + share) / 2, variance**2 / spread)) * math.sqrt(variance)
    return (gap - half, gap + half)


def by_failures(pairs: Groups, below: float) -> Tested:
    """Failures (values below a bound): the Cochran-Mantel-Haenszel test, corrected for continuity.

    The effect is the reduction of the first group's share within strata, weighted by controllers.
    """
    if not pairs:
        return NOTHING
    fewer = spread = effect = 0.0
    for w, (x, y) in zip(_shares(pairs), pairs, strict=True):
        n, m, mine, theirs = len(x), len(y), int((x < below).sum()), int((y < below).sum())
        total, failed = n + m, mine + theirs
        fewer += n * failed / total - mine
        spread += n * m * failed * (total - failed) / (total**2 * (total - 1))
        effect += w * (theirs / m - mine / n)
    if spread <= 0:
        return Tested(effect, 0.0, 1.0)
    z = max(abs(fewer) - 0.5, 0.0) / math.sqrt(spread)
    return Tested(effect, fewer, math.erfc(z / math.sqrt(2)))


def by_slopes(x: Floats, y: Floats, units: NDArray[np.int64], tasks: NDArray[np.str_]) -> Tested:
    """Slopes of y over x, both standardised within the task: one for each unit, the mean of its tasks';
    Student's t over units. The effect is the mean slope, a correlation; the statistic is positive if y falls.

    Args:
        x, y: of each controller [n].
        units: its calibration unit [n].
        tasks: its task [n].
    """
    from scipy.stats import ttest_1samp

    slopes = []
    for unit in sorted(set(units.tolist())):
        of_tasks = []
        for task in sorted(set(tasks.tolist())):
            own = tasks == task
            across, up = (_standard(v, own)[units == unit] for v in (x, y))
            across, up = across[np.isfinite(across)], up[np.isfinite(up)]
            away = across - across.mean() if len(across) else across
            if (away**2).sum() > 0:
                of_tasks.append(float(up @ away / (away @ away)))
        if of_tasks:
            slopes.append(float(np.mean(of_tasks)))
    if len(slopes) < 3 or np.ptp(slopes) == 0:
        return NOTHING
    mean = float(np.mean(slopes))
    return Tested(mean, -mean, float(ttest_1samp(slopes, 0.0).pvalue))


def _standard(values: Floats, own: NDArray[np.bool_]) -> Floats:
    """Values [n] as standardised deviations within a subset; nan for the others."""
    spread = values[own].std()
    scaled = (values - values[own].mean()) / (spread or 1.0)
    return np.where(own, scaled, np.nan)


def _shares(pairs: Groups) -> list[float]:
    counts = [len(x) + len(y) for x, y in pairs]
    return [count / sum(counts) for count in counts]
