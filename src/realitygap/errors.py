"""Every error that a user can meet: what was expected, what came, and a hint."""

from collections.abc import Iterable

__all__ = [
    "BaudError", "CalibrationError", "ConfigError", "FilmError", "FrozenError", "GenotypeError",
    "LineError", "NoSuchNameError", "RealityGapError", "RealityGapWarning", "RecordingError", "RobotError",
    "RobotStoppedError", "StudyBusyError", "StudyError", "StudyInterruptedError", "TaskError", "TrackError",
    "UsageError",
]  # fmt: skip


class RealityGapError(Exception):
    """Base class of all errors: one clear message, never a traceback. `exit_code` 1: not the user's doing."""

    exit_code = 1


class RealityGapWarning(UserWarning):
    """Something that works, but is hardly meant."""


class UsageError(RealityGapError, ValueError):
    """Something that the user can fix: exit code 2."""

    exit_code = 2


class NoSuchNameError(UsageError, KeyError):
    """A name that a mapping does not have; its own names are in the message."""

    __str__ = Exception.__str__  # a KeyError's is quoted

    def __init__(self, what: str, name: object, names: Iterable[object]) -> None:
        super().__init__(f"{what}: expected one of {', '.join(map(str, names))}, got {name!r}.")


class ConfigError(UsageError):
    """A TOML file or a setting: names the file and the key."""


class GenotypeError(UsageError):
    """A genotype's text or array that cannot be read: names the line."""


class TaskError(UsageError):
    """An unknown task, or a user's task file that cannot be used."""


class StudyError(UsageError):
    """A study's folder that cannot be opened, resumed or written."""


class StudyBusyError(StudyError):
    """Another process is working on the study."""


class StudyInterruptedError(RealityGapError, KeyboardInterrupt):
    """Ctrl-C while a study ran: what was saved is kept. It is also a KeyboardInterrupt."""

    exit_code = 130


class RobotError(RealityGapError):
    """A robot that does not do as commanded: names the command and the answer."""


class LineError(RobotError):
    """A serial line that is lost, or on which no answer can be understood."""


class FrozenError(RobotError):
    """A driver that said nothing for too long while its robot drove: the robot was stopped by its guard."""


class RobotStoppedError(RobotError, KeyboardInterrupt):
    """Ctrl-C, Ctrl-Z or SIGTERM while a robot drove: it was stopped first, its recording is kept."""

    exit_code = 130


class BaudError(UsageError):
    """A baud rate too slow for what each step has to carry: shows the arithmetic."""


class FilmError(UsageError):
    """A film, a camera, a disk or a table of poses that cannot be used."""


class RecordingError(UsageError):
    """A recording for a calibration that cannot be read, written or resumed: names file and line."""


class CalibrationError(UsageError):
    """Recordings that no sensible profile can be made from, or judged by."""


class TrackError(UsageError):
    """A track that cannot be compared or named: names the file and the start."""
