"""What can go wrong, by kind. Every message is one line: what was found, what was expected, what to do."""


class ContactWrenchError(Exception):
    """Base of every error that this package raises on purpose."""


class InputError(ContactWrenchError, ValueError):
    """Values that cannot be what they are given as: a shape, a NaN, a matrix that is no rotation.

    Attributes:
        row: index of the first row that is wrong, where there is one.
    """

    def __init__(self, message: str, row: int | None = None) -> None:
        super().__init__(message)
        self.row = row


def refuse(*cases: tuple[object, str]) -> None:
    """Raise `InputError` with the message of the first case that holds."""
    for holds, message in cases:
        if holds:
            raise InputError(message)


class FileFormatError(InputError):
    """A file that cannot be read; the message names the file, and the row and column where there is one."""


class FileAccessError(ContactWrenchError, OSError):
    """A file that cannot be opened, read or written."""


class UnobservableError(ContactWrenchError, ArithmeticError):
    """The poses cannot separate the parameters that the message names."""


class AmbiguityError(ContactWrenchError, ValueError):
    """Free-air data fit two readings; the message names both, and the flag that decides."""


class MissingExtraError(ContactWrenchError, ImportError):
    """An optional dependency is not installed; the message gives the command that installs it."""
