"""Records that people bring of their own axes."""

from __future__ import annotations

import datetime
import os
from pathlib import Path
from typing import TYPE_CHECKING

from . import _pigtail
from ._document import Document
from ._errors import Error
from ._input import maybe_number, maybe_text, maybe_whole, number, text
from ._progress import Progress, shown

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class Identified(Document):
    """What a record tells of an axis: ``parameters`` with their deviations, how well they tell what they were not fitted to
    (``validation_error_percent``), and a ``verdict``. What the record does not tell has no value, and its reason stands in
    ``parameters``.

    Attributes:
        arrays: Of shape ``(n,)``: ``time_s``, ``measured_force`` and ``modelled_force`` (N or N m), ``position`` (m or rad), ``velocity``.
        fragment: The axis as a part of a rig, as ``pigtail identify servo`` writes it; ``None`` where the record does not tell all.
    """

    def __init__(self, document: str, words: str, arrays: dict[str, NDArray[np.float64]], fragment: str | None) -> None:
        super().__init__(document)
        self._words, self.arrays, self.fragment = words, arrays, fragment

    @property
    def values(self) -> dict[str, float | None]:  # type: ignore[override]
        """The parameters' values by name, SI units; ``None`` where the record does not tell."""
        return {name: of["value"] for name, of in self["parameters"].items()}

    def write(self, path: str | os.PathLike[str]) -> Path:
        """Writes the fragment: ``pigtail.Rig(axes=[path])`` has the axis in place of its own.

        Raises:
            pigtail.Error: Where there is none.
        """
        if self.fragment is None:
            raise Error(f"there is no fragment: {self['verdict']}")
        to = Path(text("path", path))
        beside = to.with_name(f".{to.name}.{os.getpid()}")
        beside.write_text(self.fragment)
        beside.replace(to)
        return to

    def __str__(self) -> str:
        return self._words.rstrip("\n")


def identify_servo(
    data: str | os.PathLike[str],
    *,
    position: str,
    voltage: str,
    force_per_volt: float,
    time: str | None = None,
    reference: str | None = None,
    rate_hz: float | None = None,
    validate: str | os.PathLike[str] | None = None,
    friction: str = "symmetric",
    injected: str | None = None,
    method: str | None = None,
    cutoff_hz: float | None = None,
    gear_ratio: float | None = None,
    lead_m: float | None = None,
    counts_per_turn: int | None = None,
    voltage_limit_v: float | None = None,
    progress: Progress = None,
) -> Identified:
    """Identifies inertia and friction of a servo axis from your own log of it, as ``pigtail identify servo --data`` does.

    Args:
        data: A file of columns; delimiter, decimal comma, encoding, names and units are told from it.
        position: Its column of position, a length or an angle: ``NAME`` or ``NAME:UNIT``; so with all columns.
        voltage: Its column of motor voltage.
        force_per_volt: Force (N) or torque (N m) of a volt.
        time: Its column of time; one with a usual name if not given.
        reference: Its column of the position's reference; with it the controller is identified too.
        rate_hz: Rows a second, where no column says when they were taken.
        validate: A second record of the same columns, to judge by.
        friction: ``symmetric`` or ``asymmetric``.
        injected: A column of what was added to the controller's voltage, volts or a force.
        method: ``least-squares``, ``weighted``, ``instrumental`` or ``delayed``; ``least-squares`` or ``delayed``, as the record
            supports it, if not given.
        cutoff_hz: Cutoff of the position's filter.
        gear_ratio: Turns of the output for a turn of the motor, for the fragment.
        lead_m: Travel for a turn of the screw, metres, of an axis along a line, for the fragment.
        counts_per_turn: Encoder counts in a turn of the motor, for the fragment.
        voltage_limit_v: The amplifier's bound, for the fragment.
        progress: How to show progress; see :data:`pigtail.Progress`.

    Raises:
        InputError: For what is not accepted, in an argument or in the file: with file, key, value.
    """
    with shown(progress, "identify") as tell:
        return Identified(
            *_pigtail.identify_servo(
                text("data", data),
                text("position", position),
                text("voltage", voltage),
                number("force_per_volt", force_per_volt),
                maybe_text("time", time),
                maybe_text("reference", reference),
                maybe_number("rate_hz", rate_hz),
                maybe_text("validate", validate),
                text("friction", friction),
                maybe_text("injected", injected),
                maybe_text("method", method),
                maybe_number("cutoff_hz", cutoff_hz),
                maybe_number("gear_ratio", gear_ratio),
                maybe_number("lead_m", lead_m),
                maybe_whole("counts_per_turn", counts_per_turn, 4, 2**32 - 1),
                maybe_number("voltage_limit_v", voltage_limit_v),
                datetime.date.today().isoformat(),
                tell,
            )
        )


__all__ = ["Identified", "identify_servo"]
