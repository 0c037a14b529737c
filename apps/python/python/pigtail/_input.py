"""Arguments, checked before anything runs."""

from __future__ import annotations

import operator
import os
from typing import TYPE_CHECKING, Any

from ._errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_MOST = 2**64 - 1


def whole(name: str, value: Any, least: int = 0, most: int = _MOST) -> int:
    """A whole number from ``least`` to ``most``."""
    try:
        number = operator.index(value)
    except TypeError:
        number = None
    if number is None or isinstance(value, bool) or not least <= number <= most:
        message = f"{name}: is {value!r}; accepted is a whole number from {least} to {most}"
        raise InputError(message, key=name, value=repr(value))
    return number


def maybe_whole(name: str, value: Any, least: int = 0, most: int = _MOST) -> int | None:
    """The same, or nothing."""
    return None if value is None else whole(name, value, least, most)


def number(name: str, value: Any) -> float:
    """A finite number."""
    try:
        if isinstance(value, (str, bytes, bool)):
            raise TypeError
        result = float(value)
    except (TypeError, ValueError, OverflowError):
        result = float("nan")
    if result - result != 0.0:
        message = f"{name}: is {value!r}; accepted is a finite number"
        raise InputError(message, key=name, value=repr(value))
    return result


def duration(name: str, value: Any) -> float:
    """A time of zero or more, which may be without end."""
    try:
        if isinstance(value, (str, bytes, bool)):
            raise TypeError
        if (seconds := float(value)) >= 0.0:
            return seconds
    except (TypeError, ValueError, OverflowError):
        pass
    message = f"{name}: is {value!r}; accepted is a number of seconds, zero or more"
    raise InputError(message, key=name, value=repr(value))


def maybe_number(name: str, value: Any) -> float | None:
    """The same, or nothing."""
    return None if value is None else number(name, value)


def flag(name: str, value: Any) -> bool:
    """Yes or no, numpy's too."""
    if isinstance(value, bool) or type(value).__name__ in ("bool", "bool_"):
        return bool(value)
    raise InputError(f"{name}: is {value!r}; accepted is True or False", key=name, value=repr(value))


def maybe_flag(name: str, value: Any) -> bool | None:
    """The same, or nothing."""
    return None if value is None else flag(name, value)


def switch(name: str, value: Any) -> bool:
    """On or off: a word such as "off" is neither."""
    if isinstance(value, str) or getattr(value, "ndim", 0) != 0 or value not in (0, 1):
        message = f"{name}: is {value!r}; accepted is True or False, or 1 or 0"
        raise InputError(message, key=name, value=repr(value))
    return bool(value)


def floats(name: str, values: Any) -> NDArray[np.float64]:
    """An array of real numbers."""
    import numpy as np

    try:
        array = np.asarray(values)
        if array.dtype.kind == "c":
            # What is not real is no voltage, and would be cut off without a word.
            raise TypeError
        return np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name}: is no array of numbers", key=name, value=repr(values)) from None


def text(name: str, value: Any) -> str:
    """A text, or a path."""
    try:
        result = os.fspath(value)
    except TypeError:
        result = None
    if not isinstance(result, str):
        message = f"{name}: is {value!r}; accepted is a text"
        raise InputError(message, key=name, value=repr(value))
    return result


def maybe_text(name: str, value: Any) -> str | None:
    """The same, or nothing."""
    return None if value is None else text(name, value)


def texts(name: str, value: Any) -> list[str]:
    """Texts, or one."""
    if isinstance(value, (str, os.PathLike)):
        return [text(name, value)]
    try:
        items = list(value)
    except TypeError:
        message = f"{name}: is {value!r}; accepted are texts in a list"
        raise InputError(message, key=name, value=repr(value)) from None
    return [text(name, item) for item in items]
