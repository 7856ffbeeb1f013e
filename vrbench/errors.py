"""The errors a user can meet: each says where, what was found, and what would be right."""

from __future__ import annotations

from pathlib import Path


class VrbenchError(Exception):
    """Something the user can mend.

    Args:
        what: what was found, in one sentence.
        file: the file it was found in.
        field: the field, column, topic or option within the file.
        fix: what would be right, or what to do.
    """

    exit_code = 2

    def __init__(
        self,
        what: str,
        *,
        file: str | Path | None = None,
        field: str | None = None,
        fix: str | None = None,
    ) -> None:
        self.what = what
        self.file = None if file is None else str(file)
        self.field = field
        self.fix = fix
        super().__init__(str(self))

    def __str__(self) -> str:
        place = ": ".join(part for part in (self.file, self.field) if part)
        text = f"{place}: {self.what}" if place else self.what
        return f"{text} ({self.fix})" if self.fix else text

    def __reduce__(self) -> tuple[object, ...]:
        return _rebuild, (type(self), self.what, self.file, self.field, self.fix)


def _rebuild(
    kind: type[VrbenchError], what: str, file: str | None, field: str | None, fix: str | None
) -> VrbenchError:
    return kind(what, file=file, field=field, fix=fix)


class ConfigError(VrbenchError):
    """A file, option or name that the user wrote is wrong; exit code 2."""


class DataError(VrbenchError):
    """A recording can't be read, or isn't what it was said to be; exit code 1."""

    exit_code = 1


class EstimationError(VrbenchError):
    """The data do not determine what was asked of them; exit code 1."""

    exit_code = 1


class DeviceError(VrbenchError):
    """A device did not answer, refused, or failed while it ran; exit code 1."""

    exit_code = 1
