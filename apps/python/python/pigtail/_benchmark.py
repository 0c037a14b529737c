"""Alignment algorithms on the same devices, judged by a truth that they do not see."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

from . import _pigtail
from ._bench import BenchRig, BenchTwin, align_bench, bench_rig, find_peak
from ._document import Document
from ._errors import FaultError, InputError, OutcomeError, Refused
from ._input import maybe_flag, number, text, whole
from ._pigtail import __version__
from ._progress import Progress, shown
from .bench import Attach, Batch, Bench, Brake, Caps, Estimate, Event, Laser, Law, Light, Line, Load, Pose, Request
from .sim import FiberTruth, truth

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

PORTS = ("input", "output1", "output2")
"""The fibers of a device, in the order in which they are reported."""

HELD_OUT = 2**40
"""The first held-out seed. Those for development are below 2**32, and so is every seed that an environment draws."""

TOLERANCE_XY_UM = 0.1
TOLERANCE_Z_UM = 2.0
PEAK_GAP_UM = 40.0
LIMIT_S = {"peak": 120.0, "device": 900.0}

_RUN_UP_UM = 40.0
_GAPS_UM = (40.0, 15.0, 5.0)
_DARK = 40
_RESAMPLED = 2000


Report: TypeAlias = "bool | Sequence[bool] | Mapping[str, bool]"
"""What an algorithm says: of the peak task whether the group is at the peak; of the device task whether a fiber is aligned and
attached, in the order of :data:`PORTS` or by their names. What nothing is said of is lost."""
Algorithm: TypeAlias = Callable[[Bench, BenchRig], Report]
"""What is entered: it drives a bench as far as it can, and says what came of it."""


class PeakAlgorithm(Protocol):
    """What is entered for the peak task."""

    def peak(self, bench: Bench, rig: BenchRig) -> Report:
        """Brings the right arm's fine group to the peak."""


class DeviceAlgorithm(Protocol):
    """What is entered for the device task."""

    def device(self, bench: Bench, rig: BenchRig) -> Report:
        """Attaches three fibers."""


class Probe:
    """The light at places of a fine group, as a climb asks for it: ``light_v = probe(x_um, y_um)``.

    Attributes:
        bench: The bench, for a climb that wants laws of its own.
        group: The group, by its place in the bench's caps.
        channel: What measures the light.
        dark_v: Its level without the laser, volts.
        noise_v: Standard deviation of a sample in the dark, volts; a bright one has more.
        width_um: Distance from the peak at which the light has fallen to 1/e, by the recipe, micrometres.
        reach_um: Places are from ``-reach_um`` to ``reach_um`` in x and in y, micrometres.
    """

    def __init__(
        self, bench: Bench, group: int, *, channel: int, dark_v: float, noise_v: float, width_um: float
    ) -> None:
        self.bench, self.group, self.channel = bench, group, channel
        self.dark_v, self.noise_v, self.width_um = dark_v, noise_v, width_um
        axes = bench.caps.groups[group].axes
        self.reach_um = 1e6 * min(min(-of.low, of.high) for of in axes[:2] if of is not None)
        self._period_s = 1.0 / bench.caps.channels[channel].rate_hz
        known = bench.pose(group, bench.now_s)
        x, y = (0.0, 0.0) if known is None else known.pose.xyz_um[:2]
        self._at = (self._within(x), self._within(y))

    def _within(self, um: float) -> float:
        return min(max(float(um), -self.reach_um), self.reach_um)

    @property
    def at_um(self) -> tuple[float, float]:
        """Where the group was told to be, x and y, micrometres."""
        return self._at

    def move(self, x_um: float, y_um: float) -> None:
        """Goes there, or as near as it reaches, and comes to rest."""
        x, y = number("x_um", x_um), number("y_um", y_um)
        self._at = (self._within(x), self._within(y))
        self.bench.until(self.bench.play(self.group, Line(Pose.um(*self._at))))

    def __call__(self, x_um: float, y_um: float, samples: int = 1) -> float:
        """Goes there, and the mean of some samples that were taken at rest, less the dark, volts."""
        self.move(x_um, y_um)
        return self.light_v(samples)

    def light_v(self, samples: int = 1) -> float:
        """The light where it stands: the mean of some samples less the dark, volts."""
        rest = self.bench.now_s + self._period_s
        total, taken = 0.0, 0
        while taken < samples:
            light = self.bench.light(self.channel)
            if light.time_s >= rest:
                total, taken = total + light.volts[self.channel], taken + 1
        return total / samples - self.dark_v


Climb: TypeAlias = "Callable[[Probe], tuple[float, float] | None]"
"""Looks for the peak from where a group stands: its place, micrometres, or ``None`` where there is none."""


def _sees(probe: Probe) -> bool:
    """Whether there is light that is no noise."""
    return probe.light_v(4) > 5.0 * probe.noise_v


def raster(probe: Probe, step: float = 0.7) -> bool:
    """Brings the group to the brightest place of a raster of all that it reaches, in steps of so many widths. Whether
    there is light. It goes there only where none is seen from where it stands."""
    if _sees(probe):
        return True
    count = max(2, math.ceil(2.0 * probe.reach_um / (step * probe.width_um)) + 1)
    places = [probe.reach_um * (2.0 * k / (count - 1) - 1.0) for k in range(count)]
    rows = [[(x, y) for x in (places if k % 2 == 0 else places[::-1])] for k, y in enumerate(places)]
    seen = [(probe(x, y), x, y) for row in rows for x, y in row]
    _, x, y = max(seen)
    probe.move(x, y)
    return _sees(probe)


@dataclass
class _Skeleton:
    """Brings a climb to the device and the peak task: what is not the climb, as one writes it in an afternoon."""

    climb: Climb
    search: Callable[[Probe], bool]
    bench: Bench
    rig: BenchRig
    dark_v: float = 0.0
    noise_v: float = 0.0
    at: dict[int, Pose] = field(default_factory=dict)

    def group(self, arm: int, fine: bool) -> int:
        for place, of in enumerate(self.bench.caps.groups):
            if (of.arm, of.fine) == (arm, fine):
                return place
        raise InputError(f"bench: has no such group: arm {arm}, fine {fine}", key="bench")

    def dark(self, channel: int) -> None:
        """Measures the dark, and leaves the laser on."""
        self.bench.until(self.bench.request(Laser(False)))
        volts = [self.bench.light(channel).volts[channel] for _ in range(5 + _DARK)][5:]
        self.dark_v = sum(volts) / _DARK
        self.noise_v = math.sqrt(sum((each - self.dark_v) ** 2 for each in volts) / (_DARK - 1))
        self.bench.until(self.bench.request(Laser(True)))
        for _ in range(5):
            self.bench.light(channel)

    def probe(self, arm: int, port: int, gap_um: float) -> Probe:
        channel = self.rig.meters[port if arm == 1 else 0]
        width_um = self.rig.width_um(gap_um)
        return Probe(
            self.bench,
            self.group(arm, True),
            channel=channel,
            dark_v=self.dark_v,
            noise_v=self.noise_v,
            width_um=width_um,
        )

    def to_gap(self, arm: int, port: int, gap_um: float) -> None:
        """The coarse group along the beam as it was taught, from below: what gives way does so in one direction."""
        group = self.group(arm, False)
        for below in (_RUN_UP_UM, 0.0):
            pose = self.rig.pose_at(arm, port, 1e-6 * (gap_um + below))
            self.bench.until(self.bench.play(group, Line(pose + Pose.um(-below, -below))))

    def to_peak(self, arm: int, port: int, gap_um: float) -> bool:
        probe = self.probe(arm, port, gap_um)
        found = self.climb(probe)
        if found is None:
            return False
        probe.move(*found)
        # A peak that is out of reach looks like one at the edge.
        return max(abs(probe.at_um[0]), abs(probe.at_um[1])) < 0.97 * probe.reach_um and _sees(probe)

    def peak(self) -> bool:
        """The peak task."""
        self.dark(self.rig.meters[0])
        return self.search(self.probe(1, 0, PEAK_GAP_UM)) and self.to_peak(1, 0, PEAK_GAP_UM)

    def device(self) -> dict[str, bool]:
        """The device task."""
        bench, told = self.bench, dict[str, bool]()
        bench.until(bench.request(Load(0)), bench.request(Load(1)))
        self.dark(self.rig.meters[0])
        for arm in (0, 1):
            self.to_gap(arm, 0, _GAPS_UM[0])
        told["input"] = self.input()
        for port in (0, 1):
            name = PORTS[1 + port]
            if not told["input"] or (port == 1 and "output1" not in told):
                told[name] = False
                continue
            if port == 1:
                self.next_fiber()
            told[name] = self.output(port)
        return told

    def input(self) -> bool:
        """The input and the first output to their peaks, nearer and nearer, and the input attached."""
        if not any(self.search(self.probe(arm, 0, _GAPS_UM[0])) for arm in (1, 0)):
            return False
        for gap in _GAPS_UM:
            for arm in (1, 0):
                self.to_gap(arm, 0, gap)
            for arm in (1, 0, 1) if gap == _GAPS_UM[0] else (1, 0):
                if not self.to_peak(arm, 0, gap):
                    return False
        self.bench.until(self.bench.request(Attach(0)))
        return True

    def next_fiber(self) -> None:
        """The right arm away from the chip, and to the second output with another fiber."""
        bench, coarse, fine = self.bench, self.group(1, False), self.group(1, True)
        bench.until(bench.play(coarse, Line(self.rig.pose_at(1, 0, 200e-6))))
        bench.until(bench.request(Load(1, 1)), bench.play(fine, Line(Pose())))
        bench.until(bench.play(coarse, Line(self.rig.pose_at(1, 1, 200e-6))))
        self.to_gap(1, 1, _GAPS_UM[0])

    def output(self, port: int) -> bool:
        """An output to its peak, nearer and nearer, and attached."""
        gaps = _GAPS_UM[-1:] if port == 0 else _GAPS_UM
        if port == 1 and not self.search(self.probe(1, port, gaps[0])):
            return False
        for gap in gaps:
            self.to_gap(1, port, gap)
            if not self.to_peak(1, port, gap):
                return False
        self.bench.until(self.bench.request(Attach(1)))
        return True


class with_climb:  # noqa: N801  (it is called as a function is)
    """An algorithm for both tasks of a climb of yours: the rest is what one writes in an afternoon, over the same bench.

    Both arms take their fibers and come to 40 um along the beam as it was taught; where no light is seen the fine groups
    look for it; your climb brings each arm to its peak, again at 15 um and at 5 um, and the fiber is attached.

    Args:
        climb: Looks for the peak with a :class:`Probe`, and returns its place in micrometres, or ``None``.
        search: Finds light where none is seen; a raster if not given.
        about: What it does, in a few words.

    Example:
        >>> def mine(probe):
        ...     x, y = probe.at_um
        ...     return max((probe(x + a, y + b), x + a, y + b) for a in (-1, 0, 1) for b in (-1, 0, 1))[1:]
        >>> pigtail.benchmark({"mine": pigtail.with_climb(mine)}, devices=4)
    """

    def __init__(self, climb: Climb, search: Callable[[Probe], bool] = raster, about: str = "") -> None:
        if not callable(climb):
            raise InputError(f"climb: is {climb!r}; accepted is a function of a probe", key="climb", value=repr(climb))
        self.climb, self.search = climb, search
        self.__doc__ = about or climb.__doc__

    def peak(self, bench: Bench, rig: BenchRig) -> bool:
        """The peak task."""
        return _Skeleton(self.climb, self.search, bench, rig).peak()

    def device(self, bench: Bench, rig: BenchRig) -> dict[str, bool]:
        """The device task."""
        return _Skeleton(self.climb, self.search, bench, rig).device()

    def __call__(self, bench: Bench, rig: BenchRig) -> dict[str, bool]:
        return self.device(bench, rig)


class _Ours:
    """pigtail: circles, and the device from first light to attached"""

    def peak(self, bench: Bench, rig: BenchRig) -> bool:
        place = next(k for k, of in enumerate(bench.caps.groups) if of.arm == 1 and of.fine)
        find_peak(bench, place, gap_um=PEAK_GAP_UM, channel=rig.meters[0], rig=rig, progress=False)
        return True

    def device(self, bench: Bench, rig: BenchRig) -> dict[str, bool]:
        device = align_bench(bench, rig, progress=False)
        if device.fault is not None:
            raise FaultError("the bench has stopped", code=device.fault["code"])
        return {fiber.port: fiber.aligned for fiber in device.fibers}


@dataclass
class _Account:
    """What the judge knows of a bench in an algorithm's hands."""

    readings: int = 0
    stopped: bool = False


def _lent(twin: BenchTwin, limit_s: float) -> tuple[Bench, _Account]:
    """A bench that hands all on to a twin and hides it, counts light, and stops when the machine time is up."""
    account, end = _Account(), twin.now_s + limit_s

    class Lent(Bench):
        """A bench of the benchmark: :func:`pigtail.sim.truth` tells nothing of it."""

        @property
        def caps(self) -> Caps:
            return twin.caps

        @property
        def now_s(self) -> float:
            return twin.now_s

        def play(self, group: int, law: Law) -> int:
            return twin.play(group, law)

        def bend(self, ticket: int, law: Law) -> float:
            return twin.bend(ticket, law)

        def request(self, what: Request) -> int:
            return twin.request(what)

        def next(self, by_s: float) -> Event:
            try:
                if twin.now_s >= end:
                    account.stopped = True
                    twin.stop()
                    message = f"its machine time of {limit_s:g} s is up"
                    raise FaultError(
                        message, code="time-up", rule="machine time", limit=f"{limit_s:g} s", time_s=twin.now_s
                    )
                event = twin.next(by_s)
            except FaultError:
                account.stopped = True
                raise
            account.readings += len(event.lights) if isinstance(event, Batch) else isinstance(event, Light)
            return event

        def pose(self, group: int, at_s: float) -> Estimate | None:
            return twin.pose(group, at_s)

        def reaches(self, group: int, pose: Pose) -> bool:
            return twin.reaches(group, pose)

        def stop(self) -> None:
            twin.stop()

    return Lent(), account


@dataclass
class _Judged:
    """What came of a device."""

    seed: int
    verdicts: list[str]
    seconds: float
    readings: int
    across_um: list[float]
    along_um: list[float]
    raised: str = ""


def _said(report: Any, fibers: int) -> list[bool | None]:
    """What was said of each fiber; ``None``: nothing."""
    names = PORTS[:fibers]
    if isinstance(report, bool) or type(report).__name__ == "bool_":
        said: list[bool | None] = [bool(report)]
    elif isinstance(report, Mapping):
        unknown = [key for key in report if key not in names]
        if unknown:
            message = f"report: names {unknown[0]!r}; accepted is one of {list(names)}"
            raise InputError(message, key="report", value=repr(unknown[0]))
        return [None if name not in report else maybe_flag("report", report[name]) for name in names]
    elif isinstance(report, Sequence) and not isinstance(report, str):
        said = [maybe_flag("report", each) for each in report]
    else:
        message = f"report: is {report!r}; accepted is whether each fiber is aligned, in order or by name"
        raise InputError(message, key="report", value=repr(report))
    if len(said) > fibers:
        raise InputError(f"report: is of {len(said)} fibers; there are {fibers}", key="report", value=repr(report))
    return [*said, *[None] * (fibers - len(said))]


def _verdict(said: bool | None, within: bool, touched: bool, fault: bool) -> str:
    if said and not within:
        return "wrong"
    if touched:
        return "touched"
    if said:
        return "right"
    return "fault" if fault else "lost"


def _prepare_peak(twin: BenchTwin, rig: BenchRig) -> None:
    """Both arms with their fibers at the gap; the left one at its peak, as whoever knows the truth can do."""
    twin.until(twin.request(Load(0)), twin.request(Load(1)), twin.request(Laser(True)))
    for below in (_RUN_UP_UM, 0.0):
        tickets = []
        for arm in (0, 1):
            place = next(k for k, of in enumerate(twin.caps.groups) if of.arm == arm and not of.fine)
            pose = rig.pose_at(arm, 0, 1e-6 * (PEAK_GAP_UM + below))
            tickets.append(twin.play(place, Line(pose + Pose.um(-below, -below))))
        twin.until(*tickets)
    left = next(k for k, of in enumerate(twin.caps.groups) if of.arm == 0 and of.fine)
    reach = [of for of in twin.caps.groups[left].axes[:2] if of is not None]
    to = [0.0, 0.0]
    for _ in range(3):
        off = truth(twin).carried[0]
        assert off is not None
        to = [min(max(was - 1e-6 * by, of.low), of.high) for was, by, of in zip(to, (off.x_um, off.y_um), reach)]
        twin.until(twin.play(left, Line(Pose(*to))))


def _judge(entry: Algorithm, task: str, rig: BenchRig, seed: int, limit_s: float) -> _Judged:
    twin = BenchTwin(rig, seed)
    if task == "peak":
        _prepare_peak(twin, rig)
    fibers = 1 if task == "peak" else len(PORTS)
    began = twin.now_s
    bench, account = _lent(twin, limit_s)
    report: Any = {}
    raised = ""
    try:
        report = entry(bench, rig)
    except (FaultError, Refused, OutcomeError, TimeoutError) as ended:
        raised = f"{type(ended).__name__}: {ended}"
        report = {}
    said = _said(report, fibers)
    seconds, readings = twin.now_s - began, account.readings
    if task == "peak":
        # Where it comes to rest, and not where it happens to pass.
        right = next(k for k, of in enumerate(twin.caps.groups) if of.arm == 1 and of.fine)
        if not account.stopped:
            try:
                twin.play(right, Brake())
                twin.next(twin.now_s + 0.2)
            except (FaultError, Refused):
                pass
    told = truth(twin)
    places: tuple[FiberTruth | None, ...] = (told.carried[1],) if task == "peak" else told.fibers
    verdicts, across, along = [], [], []
    for claim, place in zip(said, places, strict=True):
        within = False
        if place is not None:
            off = max(abs(place.x_um), abs(place.y_um))
            within = off <= TOLERANCE_XY_UM
            if task == "device" or claim:
                across.append(off)
            if task == "device" and place.gap_um is not None:
                beyond = abs(place.gap_um - 1e6 * rig.gap_m)
                along.append(beyond)
                within = within and beyond <= TOLERANCE_Z_UM
        verdicts.append(_verdict(claim, within, told.collision, account.stopped))
    return _Judged(seed, verdicts, seconds, readings, across, along, raised)


def _percentiles(values: Iterable[float]) -> dict[str, float | None]:
    ordered = sorted(values)
    names = {"p50": 0.5, "p90": 0.9, "p99": 0.99, "p999": 0.999, "max": 1.0}
    if not ordered:
        return dict.fromkeys(["mean", *names])

    def at(share: float) -> float:
        # The nearest rank; a share such as 0.999 is a little off in binary.
        rank = min(max(math.ceil(share * len(ordered) - 1e-9), 1), len(ordered))
        return round(ordered[rank - 1], 6)

    mean = round(sum(ordered) / len(ordered), 6)
    return {"mean": mean, **{name: at(share) for name, share in names.items()}}


def _resampled(all_: Sequence[_Judged]) -> list[float | None]:
    """The interval of 95 % of the seconds a right fiber, by drawing devices anew (seeded)."""
    import numpy as np

    seconds = np.array([of.seconds for of in all_])
    right = np.array([of.verdicts.count("right") for of in all_])
    rows: NDArray[np.int64] = np.random.default_rng(0).integers(len(all_), size=(_RESAMPLED, len(all_)))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = seconds[rows].sum(axis=1) / right[rows].sum(axis=1)
    low, high = np.quantile(ratios, [0.025, 0.975], method="inverted_cdf")
    return [round(float(each), 4) if math.isfinite(each) else None for each in (low, high)]


def _row(name: str, about: str, all_: Sequence[_Judged]) -> dict[str, Any]:
    verdicts = [verdict for of in all_ for verdict in of.verdicts]
    right, wrong = verdicts.count("right"), verdicts.count("wrong")
    replay: dict[str, list[int]] = {}
    raised: dict[str, int] = {}
    for of in all_:
        for verdict in dict.fromkeys(of.verdicts):
            if verdict != "right" and len(replay.setdefault(verdict, [])) < 20:
                replay[verdict].append(of.seed)
        if of.raised:
            raised[of.raised] = raised.get(of.raised, 0) + 1
    common = sorted(raised.items(), key=lambda item: (-item[1], item[0]))[:5]
    return {
        "name": name,
        "about": about,
        "right": right,
        "right_confidence": list(_pigtail.wilson(right, len(verdicts))),
        "wrong": wrong,
        "wrong_confidence": list(_pigtail.wilson(wrong, len(verdicts))),
        "touched": verdicts.count("touched"),
        "faults": verdicts.count("fault"),
        "lost": verdicts.count("lost"),
        "raised": dict(common),
        "seconds_per_right_fiber": round(sum(of.seconds for of in all_) / right, 4) if right else None,
        "seconds_per_right_fiber_confidence": _resampled(all_),
        "seconds_per_fiber": _percentiles(of.seconds / len(of.verdicts) for of in all_),
        "readings_per_right_fiber": round(sum(of.readings for of in all_) / right, 1) if right else None,
        "offset_xy_um": _percentiles(each for of in all_ for each in of.across_um),
        "offset_z_um": _percentiles(each for of in all_ for each in of.along_um),
        "replay": replay,
    }


class Leaderboard(Document):
    """What algorithms came to on the same devices; ``print`` shows the table, best first. As a mapping it has the keys of
    ``pigtail benchmark --json``, and intervals of what depends on chance."""

    def __str__(self) -> str:
        head = (
            "algorithm",
            "right",
            "95 %",
            "wrong",
            "touched",
            "fault",
            "lost",
            "s a right",
            "95 %",
            "readings",
            "p50 um",
            "p99 um",
        )
        lines = [head]

        def shown_as(value: float | None, digits: int) -> str:
            return "-" if value is None else f"{value:.{digits}f}"

        for row in self["algorithms"]:
            low, high = row["right_confidence"]
            fast, slow = row["seconds_per_right_fiber_confidence"]
            lines.append(
                (
                    row["name"],
                    str(row["right"]),
                    f"{100.0 * low:.0f} to {100.0 * high:.0f} %",
                    str(row["wrong"]),
                    str(row["touched"]),
                    str(row["faults"]),
                    str(row["lost"]),
                    shown_as(row["seconds_per_right_fiber"], 2),
                    f"{shown_as(fast, 2)} to {shown_as(slow, 2)}",
                    shown_as(row["readings_per_right_fiber"], 0),
                    shown_as(row["offset_xy_um"]["p50"], 3),
                    shown_as(row["offset_xy_um"]["p99"], 3),
                )
            )
        wide = [max(len(line[k]) for line in lines) for k in range(len(head))]
        table = [
            "  ".join(of.ljust(w) if k == 0 else of.rjust(w) for k, (of, w) in enumerate(zip(line, wide)))
            for line in lines
        ]
        table.insert(1, "-" * len(table[0]))
        along = "" if self["tolerance_z_um"] is None else f" and {self['tolerance_z_um']:g} um in z"
        foot = (
            f"Task {self['task']}, {self['devices']} devices from seed {self['seed']} ({self['seeds']}), {self['fibers']} fibers an "
            f"algorithm, rig {self['rig']}.\nA fiber is right within {self['tolerance_xy_um']:g} um in x and y{along} of the truth. "
            "Seconds and readings are all that\nwas spent, over the right fibers."
        )
        return "\n".join([*table, "", foot])


def benchmark(
    algorithms: Mapping[str, Algorithm | PeakAlgorithm | DeviceAlgorithm],
    rig: BenchRig | str | None = None,
    *,
    task: str = "device",
    devices: int = 20,
    seeds: str | int = "development",
    limit_s: float | None = None,
    ours: bool = True,
    progress: Progress = None,
) -> Leaderboard:
    """Lets algorithms work on the same devices, beside ours, and judges them by a truth that they do not see.

    ``task="device"``: a bench with nothing carried, its arms at home; three fibers are to be brought to their ports and
    attached. ``task="peak"``: both arms carry their fibers at a gap of 40 um and the left one is at its peak; the right
    arm's fine group is to be brought to the peak. An algorithm is called with a :class:`pigtail.Bench` and the
    :class:`pigtail.BenchRig` that is believed, and returns what it says of its fibers. :class:`pigtail.with_climb` makes one
    of a climb alone; what has methods ``peak`` and ``device`` is asked by the task.

    Every fiber is counted once. *Right*: said to be aligned, and within 0.1 um in x and y (and 2 um in z of the gap that is
    wanted). *Wrong*: said to be, and is not. *Touched*: of a device on which anything touched the chip. *Fault*: the bench
    stopped, or its machine time was up. *Lost*: all others. Order of merit is the machine time a right fiber; intervals
    hold 95 %, Wilson's of shares, and of times by drawing devices anew.

    Args:
        algorithms: What is compared, by name.
        rig: The rig, its folder or name; ``bench-piezo`` if not given.
        task: ``device`` or ``peak``.
        devices: How many devices, each on a bench of its own.
        seeds: ``"development"`` (0, 1, ...), ``"held-out"`` (from 2**40: tune on none of them), or the first seed. Environments draw
            theirs below 2**32. Whoever judges others draws one that nobody knew.
        limit_s: Machine time of a device, seconds; 120 and 900 if not given.
        ours: Whether ours is compared too, as ``pigtail``: through the same bench.
        progress: How to show progress; see :data:`pigtail.Progress`.

    Returns:
        The leaderboard. ``replay`` of a row has seeds of what was not right.

    Raises:
        InputError: For what is not accepted, and for a report that is none. What an algorithm raises comes out as it is,
            but for ``FaultError``, ``Refused``, ``OutcomeError`` and ``TimeoutError``: these are what may happen on a bench, and the
            device's fibers are lost.
    """
    known = bench_rig(rig)
    if text("task", task) not in LIMIT_S:
        raise InputError(f"task: is {task!r}; accepted is one of {list(LIMIT_S)}", key="task", value=repr(task))
    count = whole("devices", devices, 1)
    if isinstance(seeds, str):
        named = {"development": 0, "held-out": HELD_OUT}
        if seeds not in named:
            message = f"seeds: is {seeds!r}; accepted is one of {list(named)}, or the first seed"
            raise InputError(message, key="seeds", value=repr(seeds))
        first, named_so = named[seeds], seeds
    else:
        first, named_so = whole("seeds", seeds, 0, 2**64 - count), "chosen"
    limit = LIMIT_S[task] if limit_s is None else number("limit_s", limit_s)
    if limit <= 0.0:
        raise InputError(f"limit_s: is {limit_s!r}; accepted is above zero", key="limit_s", value=repr(limit_s))
    if not isinstance(algorithms, Mapping):
        message = f"algorithms: is {algorithms!r}; accepted are functions by their names"
        raise InputError(message, key="algorithms", value=repr(algorithms))
    entries: dict[str, Any] = {str(name): entry for name, entry in algorithms.items()}
    if ours:
        if "pigtail" in entries:
            raise InputError(
                "algorithms: has `pigtail`, which is ours; accepted is another name", key="algorithms", value="pigtail"
            )
        entries["pigtail"] = _Ours()
    called: dict[str, Algorithm] = {}
    for name, entry in entries.items():
        called[name] = getattr(entry, task, entry)
        if not callable(called[name]):
            message = f"algorithms: {name!r} is {entry!r}; accepted is a function of a bench and a rig"
            raise InputError(message, key="algorithms", value=repr(entry))
    if not called:
        raise InputError("algorithms: there are none; accepted is one at least", key="algorithms", value="{}")
    rows = []
    with shown(progress, "benchmark") as tell:
        for at, (name, entry) in enumerate(called.items()):
            judged = []
            for k in range(count):
                judged.append(_judge(entry, task, known, first + k, limit))
                if tell is not None:
                    tell(at * count + k + 1, len(called) * count, name)
            about = (entries[name].__doc__ or "").strip().split("\n")[0]
            rows.append(_row(name, about, judged))
    rows.sort(key=lambda row: (row["seconds_per_right_fiber"] is None, row["seconds_per_right_fiber"]))
    document = {
        "rig": known.name,
        "recipe": known.recipe,
        "task": task,
        "seed": first,
        "seeds": named_so,
        "devices": count,
        "fibers": count * (1 if task == "peak" else len(PORTS)),
        "tolerance_xy_um": TOLERANCE_XY_UM,
        "tolerance_z_um": TOLERANCE_Z_UM if task == "device" else None,
        "confidence_level": 0.95,
        "algorithms": rows,
        "version": __version__,
    }
    return Leaderboard(json.dumps(document))


__all__ = [
    "HELD_OUT",
    "PORTS",
    "Algorithm",
    "Climb",
    "Leaderboard",
    "Probe",
    "Report",
    "benchmark",
    "raster",
    "with_climb",
]
