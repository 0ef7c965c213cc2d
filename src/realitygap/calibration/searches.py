"""The searches of a proximity sensors' fit: none needs another's result, so workers may share them."""

from typing import Any, NamedTuple

from realitygap.calibration.channel_fit import MEASURED
from realitygap.calibration.forms import Tick, fit_forms, mended
from realitygap.calibration.infrared import infrared_problems, with_infrared
from realitygap.calibration.measured import Measured, read_unseen
from realitygap.calibration.rows import FOLDS, Rows
from realitygap.calibration.solve import Fit
from realitygap.values import Floats
from realitygap.work.pool import Here, Pool, Setup, Tell, one_thread
from realitygap.world.robot import Profile

__all__ = ["Found", "searched"]

PRINTED = "printed"
SEARCHES = (MEASURED, *range(FOLDS), PRINTED)
"""The fit of the measured form, each of its folds, and all printed forms with theirs: the longest first."""


class Found(NamedTuple):
    """What the searches found.

    Attributes:
        profiles: of the printed form and of the measured form, by form.
        fits: of every form.
        held_out: readings [n, S] on held-out places, of the forms with a profile.
        doubt: what is not identifiable about surfaces by the printed forms, in words.
    """

    profiles: dict[str, Profile]
    fits: dict[str, Fit]
    held_out: dict[str, Floats]
    doubt: str


def searched(rows: Rows, base: Profile, printed: str, pool: Pool, tick: Tick, *, measured: bool) -> Found:
    """Carry out the searches.

    Args:
        rows: all readings.
        base: the profile to start from.
        printed: the form with a law whose error on held-out places is wanted.
        pool: of workers.
        tick: called after each fit.
        measured: whether the measured form is fitted too.
    """
    made: dict[str | int, Any] = {}

    def heard(message: tuple[str | int, Any] | None) -> None:
        if message is None:
            tick()
        else:
            made.update([message])

    setup = Setup(Searches, (rows, base, printed))
    if measured:
        pool.work(setup, SEARCHES, heard)
    else:
        Here().work(setup, (PRINTED,), heard)
    found: Found = made[PRINTED]
    if measured:
        found.profiles[MEASURED], found.fits[MEASURED] = made[MEASURED]
        found.held_out[MEASURED] = held_out = found.fits[MEASURED].model.copy()
        for fold in range(FOLDS):
            held_out[rows.fold(fold)] = made[fold]
    return found


class Searches:
    """Carries out searches by name: sends None after each fit, and then the name with what was found.

    Args:
        rows, base, printed: as of `searched`.
    """

    def __init__(self, rows: Rows, base: Profile, printed: str) -> None:
        self._rows, self._base, self._form = rows, base, printed

    def carry_out(self, job: str | int, tell: Tell) -> None:
        """One of SEARCHES."""
        one_thread()
        rows, base = self._rows, self._base
        if job == PRINTED:
            tell((job, self._printed(lambda: tell(None))))
            return
        made = Measured(rows, base).fit() if job == MEASURED else read_unseen(rows, base, rows.fold(int(job)))
        tell((job, made))
        tell(None)

    def _printed(self, tick: Tick) -> Found:
        """All forms with a law."""
        rows, form = self._rows, self._form
        problems, doubt = infrared_problems(rows, self._base)
        fits, held_out, _ = fit_forms(rows, problems, form, tick)
        fits[form] = mended(fits[form], problems[form].frees, rows.dead)
        profile = with_infrared(problems[form].base, fits[form].values)
        return Found({form: profile}, fits, {form: held_out}, doubt)

    def close(self) -> None:
        """It holds nothing."""
