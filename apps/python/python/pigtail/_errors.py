"""What may go wrong, as exceptions."""

from __future__ import annotations


class Error(Exception):
    """Whatever pigtail raises.

    Attributes:
        message: What happened, in a sentence.
    """

    def __init__(self, message: str) -> None:
        super().__init__(message)
        self.message = message


class InputError(Error, ValueError):
    """Bad input: an argument, or a key of a file.

    Attributes:
        file: The file as it was named; empty where it is an argument.
        key: The key in it, dotted, or the argument.
        value: What stands there, as text; ``None`` where that cannot be told.
        line: The line in the file, from one; ``None`` where it is not known.
    """

    def __init__(
        self,
        message: str,
        file: str = "",
        key: str = "",
        value: str | None = None,
        line: int | None = None,
    ) -> None:
        super().__init__(message)
        self.file, self.key, self.value, self.line = file, key, value, line


class FaultError(Error, RuntimeError):
    """The machine stopped by itself, and is safe.

    Attributes:
        code: The rule that was broken, for programs: the same in every version.
        rule: The same in words.
        axis: The axis or instrument, such as ``left.z``.
        value: The offending value with its unit.
        limit: What would have been accepted, with its unit.
        time_s: Machine time, seconds since power-on.
    """

    def __init__(
        self,
        message: str,
        code: str = "",
        rule: str = "",
        axis: str = "",
        value: str = "",
        limit: str = "",
        time_s: float = 0.0,
    ) -> None:
        super().__init__(message)
        self.code, self.rule, self.axis = code, rule, axis
        self.value, self.limit, self.time_s = value, limit, time_s


class Refused(Error, RuntimeError):
    """A bench does not do what it was asked for, and nothing has moved."""


class TicketOver(Refused):
    """A ticket is over, or never was: control plays its law anew.

    Attributes:
        ticket: The ticket.
    """

    def __init__(self, ticket: int) -> None:
        super().__init__(f"ticket {ticket} is not being played")
        self.ticket = ticket

    def __reduce__(self) -> tuple[type[TicketOver], tuple[int]]:
        return type(self), (self.ticket,)


class OutcomeError(Error, RuntimeError):
    """The machine is well; what was looked for is not there, or was lost.

    Attributes:
        outcome: What came of it, by name.
    """

    def __init__(self, message: str, outcome: str = "") -> None:
        super().__init__(message)
        self.outcome = outcome
