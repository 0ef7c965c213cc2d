"""Where a calibrated profile comes from: files, forms, residuals, date, version, intervals."""

from dataclasses import dataclass

from realitygap.world.files import Value

__all__ = ["Constant", "FittedChannel", "Provenance", "SourceFile"]


@dataclass(frozen=True, kw_only=True)
class SourceFile(Value):
    """A recording that constants were fitted to."""

    file: str
    sha256: str
    kind: str
    object: str = ""
    readings: float = 0.0


@dataclass(frozen=True, kw_only=True)
class FittedChannel(Value):
    """How well a channel was fitted: counts, or cm/s for wheels; ratio is model error over noise."""

    channel: str
    form: str
    rmse: float
    held_out_rmse: float = 0.0
    model_error: float = 0.0
    noise: float = 0.0
    ratio: float = 0.0
    ratio_over_all: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Constant(Value):
    """A constant and its 95 % interval; `told` is false where it is not identifiable from the data."""

    key: str
    value: float
    low: float
    high: float
    told: bool = True


@dataclass(frozen=True, kw_only=True)
class Provenance(Value):
    """The history of a profile; empty for one that was written by hand."""

    base: str = ""
    date: str = ""
    version: str = ""
    notes: tuple[str, ...] = ()
    pulses_per_mm: tuple[float, ...] = ()
    files: tuple[SourceFile, ...] = ()
    fits: tuple[FittedChannel, ...] = ()
    constants: tuple[Constant, ...] = ()

    def cm_per_pulse(self, pulses_per_mm: float) -> tuple[float, float]:
        """Of the left and the right counter, as measured; by `pulses_per_mm` where nothing was."""
        left, right = self.pulses_per_mm if len(self.pulses_per_mm) == 2 else (pulses_per_mm,) * 2
        return 0.1 / left, 0.1 / right
