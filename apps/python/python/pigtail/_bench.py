"""A rig that is controlled by position, its twin, and our alignment on benches."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from typing import Any

from . import _pigtail
from ._align import Alignment
from ._errors import InputError
from ._input import maybe_number, maybe_text, number, text, whole
from ._progress import Progress, shown
from ._rig import same_files
from ._wire import caps_of, event_of, finite, index, law_wire, native_bench, pose_wire, real, request_wire
from .bench import Bench, Caps, Estimate, Event, Law, Pose, Request


@dataclass(frozen=True)
class Taught:
    """A pose that was taught: with the coarse group there and the fine group in its middle the tip touches the facet at
    the port's peak."""

    arm: int
    port: int
    """Of its side, from zero."""
    pose: Pose
    """Of the coarse group."""
    across_m: float
    """Standard deviation of where the peak of a device is from there, in x and in y, metres."""
    deviation_z_m: float
    """Standard deviation of where the facet is along z, metres."""
    bound_z_m: float
    """How far off it is at the most, metres: that plane is never passed."""


def _gap(name: str, gap: float, unit: str) -> float:
    value = number(name, gap)
    if value < 0.0:
        raise InputError(f"{name}: is {gap!r}; accepted is 0 {unit} or more", key=name, value=repr(gap))
    return value


class BenchRig:
    """A rig that is controlled by position (``kind = "bench"`` in its ``machine.toml``), and a recipe.

    It can be pickled as a :class:`pigtail.Rig` can.

    Args:
        rig: A folder, or the name of one below ``rigs``; ``bench-piezo`` is built in.
        recipe: A recipe's file, or the name of one below ``recipes``.
        calibration: A file in place of the rig's.

    Raises:
        InputError: When something cannot be read, or is not what is accepted: with file, key and value.
    """

    def __init__(
        self,
        rig: str | os.PathLike[str] = "bench-piezo",
        recipe: str | os.PathLike[str] = "y-branch",
        *,
        calibration: str | os.PathLike[str] | None = None,
    ) -> None:
        self._named = text("rig", rig), text("recipe", recipe), maybe_text("calibration", calibration)
        self._rig = _pigtail.BenchRig(*self._named)

    @staticmethod
    def _of(named: tuple[str, str, str | None], hashes: dict[str, str]) -> BenchRig:
        made = BenchRig(named[0], named[1], calibration=named[2])
        same_files(made.hashes, hashes)
        return made

    def __reduce__(self) -> tuple[Any, ...]:
        return BenchRig._of, (self._named, self.hashes)

    @property
    def name(self) -> str:
        """The rig as it was named."""
        return self._rig.name

    @property
    def recipe(self) -> str:
        """The recipe as it was named."""
        return self._rig.recipe

    @property
    def has_twin(self) -> bool:
        """Whether it has a truth, so that twins can be drawn of it."""
        return self._rig.has_twin

    @property
    def hashes(self) -> dict[str, str]:
        """SHA-256 of all that was read, by name."""
        return dict(self._rig.hashes)

    @property
    def caps(self) -> Caps:
        """What its datasheet says."""
        return caps_of(self._rig.caps())

    @property
    def taught(self) -> tuple[Taught, ...]:
        """The poses that were taught."""
        return tuple(Taught(arm, port, Pose(*pose), *rest) for arm, port, pose, *rest in self._rig.taught())

    @property
    def meters(self) -> tuple[int, ...]:
        """The channel that measures the light of each output."""
        return tuple(self._rig.meters())

    @property
    def search_gap_m(self) -> float:
        """Gap at which light is searched for, metres: there it is 2.5 times as wide as teaching errs by."""
        return self._rig.gaps()[0]

    @property
    def gap_m(self) -> float:
        """Gap at which fibers are attached, metres: the recipe's."""
        return self._rig.gaps()[1]

    def width_um(self, gap_um: float) -> float:
        """Distance from a peak, micrometres, at which the light has fallen to 1/e, at a gap, micrometres: by the recipe's modes."""
        return 1e6 * self._rig.width(1e-6 * _gap("gap_um", gap_um, "um"))

    def pose_at(self, arm: int, port: int, gap_m: float) -> Pose:
        """Pose of an arm's coarse group on the beam of a port at a gap, metres, as it was taught."""
        return Pose(*self._rig.pose_at(whole("arm", arm), whole("port", port), _gap("gap_m", gap_m, "m")))

    def __repr__(self) -> str:
        return f"<pigtail.BenchRig: {self._rig.runs_on()}>"


def bench_rig(rig: Any) -> BenchRig:
    """The rig that is meant: one, the name of one, or the one that is built in."""
    if isinstance(rig, BenchRig):
        return rig
    return BenchRig() if rig is None else BenchRig(text("rig", rig))


class BenchTwin(Bench):
    """The simulated bench that a seed draws, behind the guard that our own control has: it refuses what the datasheet
    forbids and a way past a taught facet. Nothing is carried, the laser is off, and groups are at zero. What is true
    of it, :func:`pigtail.sim.truth` tells.

    Args:
        rig: The rig, its folder or name; ``bench-piezo`` if not given.
        seed: Bench, device, fixture and noise.

    Example:
        >>> from pigtail.bench import Line, Load, Pose
        >>> bench = pigtail.BenchTwin(seed=7)
        >>> fine = bench.caps.group("right.fine")
        >>> lights = bench.until(bench.request(Load(arm=1)), bench.play(fine, Line(Pose.um(x_um=2.0))))
        >>> bench.pose(fine, bench.now_s).pose.xyz_um
    """

    def __init__(self, rig: BenchRig | str | None = None, seed: int = 0) -> None:
        self._twin = _pigtail.BenchTwin(bench_rig(rig)._rig, whole("seed", seed))
        self._caps = caps_of(self._twin.caps())

    @property
    def caps(self) -> Caps:
        """What it is able to do."""
        return self._caps

    @property
    def now_s(self) -> float:
        """Its time, seconds since power-on."""
        return self._twin.now()

    def play(self, group: int, law: Law) -> int:
        """See :meth:`pigtail.Bench.play`."""
        return self._twin.play(index("group", group), law_wire(law))

    def bend(self, ticket: int, law: Law) -> float:
        """See :meth:`pigtail.Bench.bend`."""
        return self._twin.bend(index("ticket", ticket), law_wire(law))

    def request(self, what: Request) -> int:
        """See :meth:`pigtail.Bench.request`."""
        return self._twin.request(request_wire(what))

    def next(self, by_s: float) -> Event:
        """See :meth:`pigtail.Bench.next`."""
        by = real("by_s", by_s)
        if by != by:
            raise InputError("by_s: is nan; accepted is a number", key="by_s", value="nan")
        return event_of(self._twin.next(by))

    def pose(self, group: int, at_s: float) -> Estimate | None:
        """See :meth:`pigtail.Bench.pose`."""
        known = self._twin.pose(index("group", group), finite("at_s", at_s))
        return None if known is None else Estimate(Pose(*known[0]), known[1])

    def reaches(self, group: int, pose: Pose) -> bool:
        """See :meth:`pigtail.Bench.reaches`."""
        return self._twin.reaches(index("group", group), pose_wire("pose", pose))

    def stop(self) -> None:
        """See :meth:`pigtail.Bench.stop`."""
        self._twin.stop()


_TRUTH = ("seed", "machine", "device", "collision", "smallest_gap_um")


def align_bench(bench: Bench, rig: BenchRig | str | None = None, *, progress: Progress = None) -> Alignment:
    """Aligns the fibers of one device on a bench: a twin, or one of your own. It is guarded.

    What is believed (poses that were taught, meters, recipe) is the rig's; the bench says what it is able to do. The
    document is that of :func:`pigtail.align`; what only the truth could say is ``None``.

    Args:
        bench: The bench, with nothing carried and its arms away from the chip.
        rig: What is believed of it: a rig, its folder or name; ``bench-piezo`` if not given.
        progress: How to show progress; see :data:`pigtail.Progress`.

    Raises:
        InputError: For what is not accepted, be it what a method of yours returned: it is named.
        KeyboardInterrupt: On Ctrl-C; the bench is stopped first. So with whatever else your methods raise.
    """
    native = native_bench(bench)
    with shown(progress, "align") as tell:
        said, samples = _pigtail.align_bench(native, bench_rig(rig)._rig, tell)
    document = json.loads(said)
    document.update(dict.fromkeys(_TRUTH))
    words = "\n".join(f"{row['port']}: {row['detail']}" for row in document["fibers"])
    return Alignment(json.dumps(document), words, samples)


@dataclass(frozen=True)
class Peak:
    """Where a group found a peak; it stands there."""

    x_um: float
    """Place of the group, micrometres."""
    y_um: float
    """The same, up."""
    deviation_um: float
    """Standard deviation of where the light's peak is from there, as believed, micrometres."""
    light_v: float
    """Light there beside the dark, volts."""


def find_peak(
    bench: Bench,
    group: int,
    *,
    gap_um: float,
    channel: int = 0,
    dark_v: float | None = None,
    rig: BenchRig | str | None = None,
    progress: Progress = None,
) -> Peak:
    """Brings one group of a bench, where there is light already, to the light's peak on circles, and to rest there.

    It is the peak of all light: where much of it is scattered, a port's own peak is elsewhere. On the twin of
    ``bench-piezo`` that is 2 um at a gap of 114 um, up to 40 nm at 40 um and up to 15 nm at 20 um (five seeds, the other
    fiber at its peak).

    Args:
        bench: A twin, or one of your own; the group must play a :class:`pigtail.bench.Dither`.
        group: The group, by its place in the bench's caps.
        gap_um: The gap between facet and tip, micrometres: how wide the light is there, the recipe's modes say.
        channel: What measures the light.
        dark_v: Its level without the laser, volts; if not given the laser is switched off and on to measure it.
        rig: Whose recipe it is; ``bench-piezo`` if not given.
        progress: How to show progress; see :data:`pigtail.Progress`.

    Raises:
        OutcomeError: Where there is no light, no peak for sure, or none within reach.
        FaultError: When the bench has stopped.
    """
    arguments = (
        bench_rig(rig)._rig,
        index("group", group),
        index("channel", channel),
        1e-6 * _gap("gap_um", gap_um, "um"),
        maybe_number("dark_v", dark_v),
    )
    with shown(progress, "peak") as tell:
        x, y, deviation, light = _pigtail.peak_on(native_bench(bench), *arguments, tell)
    return Peak(1e6 * x, 1e6 * y, 1e6 * deviation, light)
