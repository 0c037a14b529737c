"""Producing trays of devices."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, overload

from . import _pigtail
from ._document import Document
from ._errors import InputError
from ._input import flag, maybe_flag, maybe_whole, text, whole
from ._progress import Progress, shown
from ._rig import Rig, native


@dataclass(frozen=True)
class Cured:
    """What the cure has done to a fiber, as far as its light tells."""

    added_loss_db: float
    """Loss that cure and release have added, decibels."""
    sigma_db: float
    """One standard deviation of it, decibels."""
    off_um: float
    """How far the fiber is from its peak in the end, micrometres."""
    off_sigma_um: float
    """One standard deviation of it, micrometres."""
    shift_um: float
    """How far the adhesive has shifted it in all, micrometres."""


@dataclass(frozen=True)
class Pigtail:
    """How one fiber's production went, by control's own word."""

    device: str
    """Serial number of its device."""
    port: str
    """The port: ``input``, ``output1``, ``output2``."""
    fiber: str
    """Serial number of the fiber."""
    place: str
    """Where on the tray it lay."""
    passed: bool
    """Whether it passed."""
    cause: str
    """Why it did not; empty where it did."""
    detail: str
    """The same in a sentence."""
    seconds: float
    """Machine time from pick to verified, seconds."""
    align_seconds: float
    """That of its alignment, seconds."""
    cured: Cured | None
    """What the cure has done; ``None`` where it did not come to that."""


@dataclass(frozen=True)
class Step:
    """Something that a manipulator did."""

    side: str
    """Which: ``left`` or ``right``."""
    device: str
    """Serial number of the device."""
    port: str
    """The port whose fiber it was about."""
    what: str
    """What: ``pick``, ``align``, ``cure``, ..."""
    held: bool
    """Whether it held a fiber under the lamp, or still for one that was."""
    start: float
    """When it began, seconds of machine time."""
    end: float
    """When it was over."""


class Production(Document):
    """What came of a tray. As a mapping it has what ``pigtail produce`` keeps as ``summary.json``, whose keys are those of
    the last line of ``pigtail produce --json`` and more; ``produced`` holds the twin's truth, to judge by.

    Attributes:
        events: What happened, in order: mappings with the keys of the lines of ``pigtail produce --json``; of a device's
            end only what control says.
    """

    def __init__(self, text: str, events: Iterable[str]) -> None:
        super().__init__(text)
        self.events: tuple[dict[str, Any], ...] = tuple(json.loads(event) for event in events)

    @property
    def pigtails(self) -> tuple[Pigtail, ...]:
        """Every fiber that was begun, in order."""
        return tuple(_pigtail_of(row) for device in self["produced"] for row in device["fibers"])

    @property
    def steps(self) -> tuple[Step, ...]:
        """What the manipulators did, in the order in which it was over: what a Gantt chart is drawn from."""
        keys = ("side", "device", "port", "what", "held", "start", "end")
        return tuple(
            Step(**{key: event[key] for key in keys}) for event in self.events if event["event"] == "did"
        )

    @property
    def rejected(self) -> dict[str, int]:
        """Devices that were rejected, by cause."""
        rejected: dict[str, int] = self["rejected"]
        return rejected

    @property
    def fault(self) -> dict[str, Any] | None:
        """Why the machine stopped by itself: code, rule, axis, value, limit, time; ``None`` where it did not."""
        fault: dict[str, Any] | None = self["fault"]
        return fault

    def __str__(self) -> str:
        # Each device is a screen of its own.
        return json.dumps({key: value for key, value in self.items() if key != "produced"}, indent=2)


def _pigtail_of(row: dict[str, Any]) -> Pigtail:
    told = row["cured"]
    cured = None
    if told is not None:
        cured = Cured(
            added_loss_db=told["after_release_db"],
            sigma_db=told["sigma_db"],
            off_um=told["off_um"],
            off_sigma_um=told["off_sigma_um"],
            shift_um=told["shift_um"],
        )
    keys = ("device", "port", "fiber", "place", "passed", "cause", "detail", "seconds", "align_seconds")
    return Pigtail(**{key: row[key] for key in keys}, cured=cured)


class Trays(Document):
    """What came of many trays. As a mapping it has the keys of the last line of ``pigtail produce --trays N --json``, over all
    trays, among them ``exact_95``: exact 95 % intervals of the shares that were counted.

    Attributes:
        productions: What came of each tray, by its seed, in order; without events.
        refused: Why a machine was refused when it was commissioned, by its seed: no tray was run on it.
    """

    def __init__(self, text: str, each: Iterable[str]) -> None:
        super().__init__(text)
        self.productions: dict[int, Production] = {}
        self.refused: dict[int, str] = {}
        for tray in map(json.loads, each):
            if tray["document"] is None:
                self.refused[tray["seed"]] = tray["refused"]
            else:
                self.productions[tray["seed"]] = Production(json.dumps(tray["document"]), ())

    @property
    def pigtails(self) -> tuple[Pigtail, ...]:
        """Every fiber that was begun on any tray, in order."""
        return tuple(each for production in self.productions.values() for each in production.pigtails)


@overload
def produce(
    tray: str | os.PathLike[str] = ...,
    rig: Rig | str | None = ...,
    *,
    seed: int = ...,
    trays: None = ...,
    threads: None = ...,
    track: bool | None = ...,
    precompensate: bool | None = ...,
    commissioned: bool = ...,
    progress: Progress = ...,
) -> Production: ...


@overload
def produce(
    tray: str | os.PathLike[str] = ...,
    rig: Rig | str | None = ...,
    *,
    seed: int = ...,
    trays: int,
    threads: int | None = ...,
    track: bool | None = ...,
    precompensate: bool | None = ...,
    commissioned: bool = ...,
    progress: Progress = ...,
) -> Trays: ...


def produce(
    tray: str | os.PathLike[str] = "four",
    rig: Rig | str | None = None,
    *,
    seed: int = 0,
    trays: int | None = None,
    threads: int | None = None,
    track: bool | None = None,
    precompensate: bool | None = None,
    commissioned: bool = False,
    progress: Progress = None,
) -> Production | Trays:
    """Produces a tray on the twin that a seed draws: pick, adhesive, align, cure and release of every fiber of every device,
    with both manipulators side by side. Or many trays, each on the machine that its own seed draws.

    The numbers are those of ``pigtail produce --json``, digit for digit, but for how fast it was. Nothing is written, so
    there is nothing to go on from: what is to be resumed and kept in the store is done by the program.

    Args:
        tray: A tray's file, or the name of one below ``trays``; ``four`` is built in.
        rig: The rig, its folder or name; the one that is built in if not given. Its recipe is the tray's.
        seed: The machine, and the device in the first place of the tray; the next places have the next ones.
        trays: How many trays, 1 to 1,000,000: the first with this seed, each next one with the next. One, with all its events,
            if not given.
        threads: Trays at a time, which does not change a digit; one for each core if not given. Goes with ``trays`` alone.
        track: Whether the micro follows the light's peak until the gel point, in place of what the recipes say.
        precompensate: Whether it then goes beyond the peak by the shift that is expected, in place of what the recipes
            say.
        commissioned: Commission each machine first, as one of a fleet needs it.
        progress: How to show progress; see :data:`pigtail.Progress`.

    Returns:
        ``devices``, ``fibers``, ``yield`` (0 to 1), ``seconds_per_fiber``, ``devices_per_hour``, ``loss_db_after_cure`` and
        all else that the program says: of one tray a :class:`Production`, of many :class:`Trays`. A device that was
        rejected, a machine that stopped by itself and, of many, a machine that was refused are results, not exceptions.

    Raises:
        InputError: For what is not accepted: all that is wrong with tray and recipes at once, before anything moves. Also
            where all machines were refused.
        KeyboardInterrupt: On Ctrl-C; the machine is stopped first.
    """
    asked = maybe_whole("trays", trays, 1, 1_000_000)
    at_once = maybe_whole("threads", threads, 1, 1024)
    if asked is None and at_once is not None:
        message = f"threads: is {threads!r}; accepted is a number of them with `trays` alone"
        raise InputError(message, key="threads", value=repr(threads))
    # Seeds count on from the first.
    of = native(rig), text("tray", tray), whole("seed", seed, 0, 2**64 - (asked or 1))
    how = maybe_flag("track", track), maybe_flag("precompensate", precompensate)
    with _kept(flag("commissioned", commissioned)) as folder, shown(progress, "produce") as tell:
        if asked is None:
            return Production(*_pigtail.produce(*of, folder, *how, tell))
        return Trays(*_pigtail.produce_trays(*of, asked, at_once or os.cpu_count() or 1, folder, *how, tell))


@contextmanager
def _kept(commissioned: bool) -> Iterator[str | None]:
    """Where to keep what commissioning finds, for as long as it is needed."""
    if not commissioned:
        yield None
        return
    with tempfile.TemporaryDirectory(prefix="pigtail-") as folder:
        yield folder
