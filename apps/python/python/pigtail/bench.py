"""Benches: groups of axes, their poses and the light, in metres and seconds.

Search, peak and approach are written over a :class:`Bench`. It plays laws of motion (:class:`Line`, :class:`Scan`,
:class:`Dither`, :class:`Brake`) by itself and says what happens as events (:class:`Light`, :class:`Done`, ...).
:class:`pigtail.BenchTwin` is one to drive; subclass :class:`Bench` to have :func:`pigtail.align_bench` and
:func:`pigtail.find_peak` run on hardware or a simulator of your own.

**Frames.** Each arm has a frame of its own, right-handed: x across, y up, z towards the chip. The right arm's is the
chip's, turned by half a turn about y. A tip stands at the sum of the poses of its arm's groups.

**Time** is the bench's own, in seconds. It passes in :meth:`Bench.next` only.

Numbers are metres and radians here and not micrometres, so that nothing is rounded on the way: :meth:`Pose.um` and
:attr:`Pose.xyz_um` convert.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import TypeAlias

from ._errors import Refused, TicketOver
from ._input import duration, whole

DEGREES = ("x", "y", "z", "rx", "ry", "rz")
"""Degrees of freedom of a pose, in the order of all that is indexed by them."""


@dataclass(frozen=True)
class Pose:
    """Where a group of axes stands, from where it is zero."""

    x_m: float = 0.0
    """Across, metres."""
    y_m: float = 0.0
    """Up, metres."""
    z_m: float = 0.0
    """Towards the chip, metres."""
    rx_rad: float = 0.0
    """About x, radians, small."""
    ry_rad: float = 0.0
    """About y, radians, small."""
    rz_rad: float = 0.0
    """About z, radians, small."""

    @classmethod
    def um(cls, x_um: float = 0.0, y_um: float = 0.0, z_um: float = 0.0) -> Pose:
        """A pose in micrometres."""
        return cls(1e-6 * x_um, 1e-6 * y_um, 1e-6 * z_um)

    @property
    def xyz_um(self) -> tuple[float, float, float]:
        """Its displacement in micrometres."""
        return (1e6 * self.x_m, 1e6 * self.y_m, 1e6 * self.z_m)

    @property
    def numbers(self) -> tuple[float, float, float, float, float, float]:
        """Its numbers in the order of :data:`DEGREES`, metres and radians."""
        return (self.x_m, self.y_m, self.z_m, self.rx_rad, self.ry_rad, self.rz_rad)

    def __add__(self, by: Pose) -> Pose:
        return Pose(*(a + b for a, b in zip(self.numbers, by.numbers)))

    def __sub__(self, by: Pose) -> Pose:
        return Pose(*(a - b for a, b in zip(self.numbers, by.numbers)))

    def changed(self, **numbers: float) -> Pose:
        """The same with some of its numbers changed: ``pose.changed(z_m=0.0)``."""
        return replace(self, **numbers)


@dataclass(frozen=True)
class Line:
    """A straight line to a pose, and to rest there; then its ticket is done."""

    to: Pose
    """Where."""
    speed_m_s: float | None = None
    """At most so fast along the line, metres a second; ``None``: as fast as the group can."""


@dataclass(frozen=True)
class Knot:
    """A point of a scan."""

    time_s: float
    """When, seconds from the scan's start; increasing."""
    at: Pose
    """Where."""


@dataclass(frozen=True)
class Scan:
    """Straight from knot to knot in time; its ticket is done at rest at the last."""

    knots: tuple[Knot, ...]
    """One at least."""


@dataclass(frozen=True)
class Lead:
    """The middle of a dither follows what another group is measured to travel."""

    group: int
    """The group that leads."""
    start: Pose
    """From where its travel counts."""
    gain: tuple[tuple[float, float, float], tuple[float, float, float]]
    """How far the middle goes in x and in y (rows) for each metre of travel in x, y, z (columns)."""


@dataclass(frozen=True)
class Widens:
    """A radius that grows as a beam's does with the gap that the group which leads leaves."""

    contact_m: float
    """Its z at which the fiber would touch, metres."""
    doubles_m: float
    """Gap at which the radius is larger by the root of two, metres."""


@dataclass(frozen=True)
class Dither:
    """A circle in x and y around a middle; it goes on until it is replaced. Middle and radius go over to their new values
    as half a cosine does. With a radius of zero it is a way to rest: its ticket is done there."""

    centre_m: tuple[float, float]
    """Its middle, x and y, metres."""
    radius_m: float
    """Its radius, metres."""
    rate_hz: float
    """Turns a second; its angle goes on from where it is."""
    centre_within_s: float = 0.0
    """Within how long its middle gets there, seconds."""
    radius_within_s: float = 0.0
    """Within how long its radius does, seconds."""
    lead: Lead | None = None
    """What its middle follows."""
    widens: Widens | None = None
    """How its radius grows; needs ``lead``."""


@dataclass(frozen=True)
class Brake:
    """To rest as fast as the group can; then its ticket is done."""


Law: TypeAlias = "Line | Scan | Dither | Brake"
"""How a group moves."""


@dataclass(frozen=True)
class Laser:
    """The laser on or off."""

    on: bool


@dataclass(frozen=True)
class Load:
    """An arm takes the fiber for a port of its side, counted from zero."""

    arm: int
    port: int = 0


@dataclass(frozen=True)
class Attach:
    """The fiber of an arm is fixed to the chip where it stands, and let go of once the bond has set."""

    arm: int


@dataclass(frozen=True)
class Unload:
    """The fiber of an arm goes back."""

    arm: int


Request: TypeAlias = "Laser | Load | Attach | Unload"
"""What is asked of a bench beside motion."""


@dataclass(frozen=True)
class Light:
    """Light was measured."""

    time_s: float
    """When, seconds of the bench's time; each later than the one before."""
    volts: tuple[float, ...]
    """By channel, volts; ``nan`` where a meter has no sample at this moment."""


@dataclass(frozen=True)
class Batch:
    """Light was measured some times while a controller played by itself, in order."""

    lights: tuple[Light, ...]


@dataclass(frozen=True)
class Done:
    """A ticket is done."""

    ticket: int


@dataclass(frozen=True)
class Failed:
    """A ticket has failed."""

    ticket: int
    why: str
    """In words."""


@dataclass(frozen=True)
class Time:
    """Nothing happened until the time that was asked for."""


Event: TypeAlias = "Light | Batch | Done | Failed | Time"
"""What happened."""


@dataclass(frozen=True)
class Estimate:
    """A pose, and what says so."""

    pose: Pose
    measured: bool = True
    """Whether sensors say it, or only what the group was told."""


@dataclass(frozen=True)
class AxisCaps:
    """What an axis is able to do; metres, or radians for axes that turn."""

    low: float
    """Lowest place."""
    high: float
    """Highest place."""
    resolution: float
    """Least step."""
    repeatability: float
    """Standard deviation of where it comes to stand, from one side."""
    speed: float
    """Highest speed, a second."""
    backlash: float = 0.0
    """How far it falls short when it turns back."""


@dataclass(frozen=True)
class GroupCaps:
    """What a group of axes, which moves as one, is able to do."""

    name: str
    """Such as ``left.fine``."""
    arm: int
    """The arm that it is of: its place in :attr:`Caps.arms`."""
    fine: bool
    """Whether it goes exactly and not far (piezos), or far and about where it is told."""
    axes: tuple[AxisCaps | None, ...]
    """Six, in the order of :data:`DEGREES`; ``None`` where it does not move."""
    settling_s: float
    """By when it has come to rest once it is where it was told to be, seconds."""
    bandwidth_hz: float
    """Fastest :class:`Dither` that it follows; zero for a group that plays lines only."""
    lag_s: tuple[float, float]
    """By how much a sample of light is later than the pose that it is of, as :meth:`Bench.pose` has it, seconds; and the
    standard deviation of that."""
    bends: bool = True
    """Whether what it plays may be replaced by :meth:`Bench.bend`."""


@dataclass(frozen=True)
class ChannelCaps:
    """What measures light."""

    name: str
    rate_hz: float
    """Samples a second."""
    resolution_v: float
    """Least step of a sample, volts."""
    full_scale_v: float
    """Largest sample, volts."""


@dataclass(frozen=True)
class Caps:
    """What a bench is able to do, as its datasheet says. Groups and channels are named by their places here."""

    name: str
    arms: tuple[str, ...]
    """Each carries a fiber: the input's first."""
    groups: tuple[GroupCaps, ...]
    channels: tuple[ChannelCaps, ...]
    bond_s: float = 1.0
    """How long a fiber has to be held until it is fixed, seconds."""
    cycle_s: float = 0.0
    """Its time passes in steps of so many seconds: :meth:`Bench.next` ends up to half of one before or after the time that was
    asked for. Zero: it passes as it is asked to."""

    def group(self, name: str) -> int:
        """The place of a group by its name.

        Raises:
            KeyError: Where there is none.
        """
        for place, group in enumerate(self.groups):
            if group.name == name:
                return place
        raise KeyError(f"{name}; there are {[group.name for group in self.groups]}")


class Bench(ABC):
    """A bench: real, or simulated. Subclass it, and :func:`pigtail.align_bench` and :func:`pigtail.find_peak` run on it.

    All is called on the thread that called ours. What you raise comes out as it is, and :meth:`stop` is called first;
    but for :class:`pigtail.Refused`, which says that nothing has moved, and for a :class:`pigtail.FaultError` of
    :meth:`next`, which says that the bench has stopped and is safe: these are what may happen on a bench, and control
    answers them. A guard stands before it: it stops a bench whose events come late, out of order or unasked.
    """

    @property
    @abstractmethod
    def caps(self) -> Caps:
        """What it is able to do; asked for once."""

    @property
    @abstractmethod
    def now_s(self) -> float:
        """Its time, seconds. Never goes back."""

    @abstractmethod
    def play(self, group: int, law: Law) -> int:
        """Begins to play a law and returns at once, with a ticket: a number that was not given before. Groups move side by
        side; what the group has played before ends, and is never :class:`Done`.

        Raises:
            Refused: When the group cannot, and nothing has moved.
        """

    def bend(self, ticket: int, law: Law) -> float:
        """Replaces what is not yet played of a ticket's law, which keeps its ticket. Returns from when on, seconds.

        Raises:
            TicketOver: When it is not being played any more, or never was.
            Refused: When it cannot, and the law goes on as it was. A bench without this says so in
                :attr:`GroupCaps.bends`.
        """
        raise Refused(f"ticket {ticket} cannot be bent")

    @abstractmethod
    def request(self, what: Request) -> int:
        """Asks for something that is busy for a while, then done or failed. Returns a ticket.

        Raises:
            Refused: When that cannot be, and nothing has changed.
        """

    @abstractmethod
    def next(self, by_s: float) -> Event:
        """Lets time pass until something happens, or until a time (which may be ``inf``). Events come in the order of
        their times.

        Raises:
            FaultError: When the bench has stopped. It is then safe.
        """

    @abstractmethod
    def pose(self, group: int, at_s: float) -> Estimate | None:
        """Where a group stood at a time of the last half second; ``None`` where that is not known."""

    def reaches(self, group: int, pose: Pose) -> bool:
        """Whether a group gets to a pose: by the ranges of its axes, unless you know better."""
        for axis, at in zip(self.caps.groups[group].axes, pose.numbers):
            low, high = (0.0, 0.0) if axis is None else (axis.low, axis.high)
            if not low <= at <= high:
                return False
        return True

    @abstractmethod
    def stop(self) -> None:
        """Stops at once and holds. Never fails."""

    def until(self, *tickets: int, longest_s: float = 120.0) -> list[Light]:
        """Lets time pass until tickets are done. Returns the light that was measured meanwhile.

        Raises:
            Refused: When one of them fails.
            TimeoutError: When they are not done within so many seconds of the bench's time.
        """
        left, lights = {whole("tickets", ticket) for ticket in tickets}, list[Light]()
        end = self.now_s + duration("longest_s", longest_s)
        while left:
            event = self.next(end)
            if isinstance(event, Done):
                left.discard(event.ticket)
            elif isinstance(event, Light):
                lights.append(event)
            elif isinstance(event, Batch):
                lights.extend(event.lights)
            elif isinstance(event, Failed) and event.ticket in left:
                raise Refused(event.why)
            elif isinstance(event, Time):
                raise TimeoutError(f"{sorted(left)} not done within {longest_s} s")
        return lights

    def light(self, channel: int = 0, longest_s: float = 10.0) -> Light:
        """The next sample of a channel.

        Raises:
            TimeoutError: When there is none within so many seconds of the bench's time.
        """
        channel = whole("channel", channel, 0, len(self.caps.channels) - 1)
        end = self.now_s + duration("longest_s", longest_s)
        while True:
            event = self.next(end)
            if isinstance(event, Time):
                raise TimeoutError(f"no light within {longest_s} s")
            lights = event.lights if isinstance(event, Batch) else (event,)
            for light in lights:
                if isinstance(light, Light) and not math.isnan(light.volts[channel]):
                    return light


__all__ = [
    "DEGREES",
    "Attach",
    "AxisCaps",
    "Batch",
    "Bench",
    "Brake",
    "Caps",
    "ChannelCaps",
    "Dither",
    "Done",
    "Estimate",
    "Event",
    "Failed",
    "GroupCaps",
    "Knot",
    "Laser",
    "Law",
    "Lead",
    "Light",
    "Line",
    "Load",
    "Pose",
    "Refused",
    "Request",
    "Scan",
    "TicketOver",
    "Time",
    "Unload",
    "Widens",
]
