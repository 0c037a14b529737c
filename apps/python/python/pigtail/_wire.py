"""What crosses between a bench here and one in Rust: numbers and tuples, checked where people make them."""

from __future__ import annotations

import operator
from typing import Any

from . import _pigtail
from ._errors import FaultError, InputError, Refused, TicketOver
from ._input import switch
from .bench import (
    Attach,
    AxisCaps,
    Batch,
    Bench,
    Brake,
    Caps,
    ChannelCaps,
    Dither,
    Done,
    Estimate,
    Event,
    Failed,
    GroupCaps,
    Knot,
    Laser,
    Law,
    Lead,
    Light,
    Line,
    Load,
    Pose,
    Request,
    Scan,
    Time,
    Unload,
    Widens,
)


def wrong(what: str, value: Any, accepted: str) -> InputError:
    """That something is not what is accepted."""
    return InputError(f"{what}: is {value!r}; accepted is {accepted}", key=what, value=repr(value))


def real(what: str, value: Any) -> float:
    """A number, be it finite or not: whoever moves by it asks for more."""
    try:
        if isinstance(value, (str, bytes, bool)):
            raise TypeError
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise wrong(what, value, "a number") from None


def finite(what: str, value: Any) -> float:
    """A finite number."""
    number = real(what, value)
    if number - number != 0.0:
        raise wrong(what, value, "a finite number")
    return number


def index(what: str, value: Any) -> int:
    """A whole number of zero or more."""
    try:
        number = operator.index(value)
    except TypeError:
        number = -1
    if isinstance(value, bool) or not 0 <= number < 2**63:
        raise wrong(what, value, "a whole number of zero or more")
    return number


def least(what: str, value: Any) -> float:
    """A finite number of zero or more."""
    number = finite(what, value)
    if number < 0.0:
        raise wrong(what, value, "zero or more")
    return number


def many(what: str, values: Any, accepted: str) -> tuple[Any, ...]:
    """What is in a list."""
    try:
        if isinstance(values, (str, bytes)):
            raise TypeError
        return tuple(values)
    except TypeError:
        raise wrong(what, values, accepted) from None


def pose_wire(what: str, pose: Any) -> tuple[float, ...]:
    """A pose as six numbers. Whether they are finite, who plays it asks."""
    if not isinstance(pose, Pose):
        raise wrong(what, pose, "a pigtail.bench.Pose")
    return tuple(real(what, number) for number in pose.numbers)


def law_wire(law: Any) -> tuple[str, Any]:
    """A law as its name and its numbers."""
    if isinstance(law, Line):
        speed = None if law.speed_m_s is None else real("law.speed_m_s", law.speed_m_s)
        return "line", (pose_wire("law.to", law.to), speed)
    if isinstance(law, Scan):
        knots = []
        for knot in many("law.knots", law.knots, "those of pigtail.bench.Knot"):
            if not isinstance(knot, Knot):
                raise wrong("law.knots", knot, "a pigtail.bench.Knot")
            knots.append((real("law.time_s", knot.time_s), pose_wire("law.at", knot.at)))
        return "scan", knots
    if isinstance(law, Brake):
        return "brake", None
    if isinstance(law, Dither):
        lead = law.lead
        follows = None
        if lead is not None:
            if not isinstance(lead, Lead):
                raise wrong("law.lead", lead, "a pigtail.bench.Lead, or None")
            of = "two rows of three numbers"
            of_rows = [many("law.lead.gain", row, of) for row in many("law.lead.gain", lead.gain, of)]
            rows = tuple(tuple(real("law.lead.gain", gain) for gain in row) for row in of_rows)
            if [len(row) for row in rows] != [3, 3]:
                raise wrong("law.lead.gain", lead.gain, of)
            follows = (index("law.lead.group", lead.group), pose_wire("law.lead.start", lead.start), rows)
        widens = None
        if law.widens is not None:
            if not isinstance(law.widens, Widens):
                raise wrong("law.widens", law.widens, "a pigtail.bench.Widens, or None")
            contact = real("law.widens.contact_m", law.widens.contact_m)
            widens = (contact, real("law.widens.doubles_m", law.widens.doubles_m))
        centre = tuple(real("law.centre_m", at) for at in many("law.centre_m", law.centre_m, "two numbers: x and y"))
        if len(centre) != 2:
            raise wrong("law.centre_m", law.centre_m, "two numbers: x and y")
        return "dither", (
            centre,
            real("law.centre_within_s", law.centre_within_s),
            real("law.radius_m", law.radius_m),
            real("law.radius_within_s", law.radius_within_s),
            real("law.rate_hz", law.rate_hz),
            follows,
            widens,
        )
    raise wrong("law", law, "a Line, Scan, Dither or Brake of pigtail.bench")


def law_of(wire: tuple[str, Any]) -> Law:
    """The law of a name and its numbers."""
    name, of = wire
    if name == "line":
        to, speed = of
        return Line(Pose(*to), speed)
    if name == "scan":
        return Scan(tuple(Knot(time, Pose(*at)) for time, at in of))
    if name == "brake":
        return Brake()
    centre, centre_within, radius, radius_within, rate, lead, widens = of
    return Dither(
        centre_m=tuple(centre),
        radius_m=radius,
        rate_hz=rate,
        centre_within_s=centre_within,
        radius_within_s=radius_within,
        lead=None if lead is None else Lead(lead[0], Pose(*lead[1]), tuple(tuple(row) for row in lead[2])),  # type: ignore[arg-type]
        widens=None if widens is None else Widens(*widens),
    )


def request_wire(what: Any) -> tuple[str, int, int]:
    """A request as its name, its arm and its port."""
    if isinstance(what, Laser):
        return "laser", int(switch("request.on", what.on)), 0
    if isinstance(what, Load):
        return "load", index("request.arm", what.arm), index("request.port", what.port)
    if isinstance(what, Attach):
        return "attach", index("request.arm", what.arm), 0
    if isinstance(what, Unload):
        return "unload", index("request.arm", what.arm), 0
    raise wrong("request", what, "a Laser, Load, Attach or Unload of pigtail.bench")


def request_of(wire: tuple[str, int, int]) -> Request:
    """The request of a name, an arm and a port."""
    name, arm, port = wire
    if name == "laser":
        return Laser(arm != 0)
    if name == "load":
        return Load(arm, port)
    return Attach(arm) if name == "attach" else Unload(arm)


def event_of(wire: tuple[str, list[tuple[float, list[float]]], int, str]) -> Event:
    """The event of a name and what it says."""
    name, lights, ticket, why = wire
    if name == "light":
        ((time, volts),) = lights
        return Light(time, tuple(volts))
    if name == "done":
        return Done(ticket)
    if name == "time":
        return Time()
    if name == "failed":
        return Failed(ticket, why)
    return Batch(tuple(Light(time, tuple(volts)) for time, volts in lights))


def caps_of(wire: Any) -> Caps:
    """Caps from Rust."""
    name, arms, groups, channels, bond, cycle = wire

    def axis(of: Any) -> AxisCaps | None:
        if of is None:
            return None
        low, high, resolution, repeatability, backlash, speed = of
        return AxisCaps(low, high, resolution, repeatability, speed, backlash)

    made = []
    for group, arm, fine, axes, settling, bandwidth, lag, bends in groups:
        made.append(GroupCaps(group, arm, fine, tuple(axis(of) for of in axes), settling, bandwidth, lag, bends))
    return Caps(name, tuple(arms), tuple(made), tuple(ChannelCaps(*of) for of in channels), bond, cycle)


_Why = tuple[str, int | None] | None


def _why(refused: Refused) -> _Why:
    return refused.message, refused.ticket if isinstance(refused, TicketOver) else None


class Checked:
    """A bench of a person's own, as Rust calls it: what it returns is checked, and named where it is wrong."""

    def __init__(self, bench: Bench) -> None:
        if not isinstance(bench, Bench):
            raise wrong("bench", bench, "a pigtail.Bench")
        self._bench = bench
        self._name = type(bench).__name__
        self._channels = 0

    def _key(self, method: str) -> str:
        return f"{self._name}.{method}"

    def caps(self) -> Any:
        key, caps = self._key("caps"), self._bench.caps
        if not isinstance(caps, Caps):
            raise wrong(key, caps, "a pigtail.bench.Caps")
        arms = [str(arm) for arm in many(f"{key}.arms", caps.arms, "names")]
        groups = []
        for group in many(f"{key}.groups", caps.groups, "those of pigtail.bench.GroupCaps"):
            if not isinstance(group, GroupCaps):
                raise wrong(f"{key}.groups", group, "a pigtail.bench.GroupCaps")
            name = f"{key}.groups[{group.name!r}]"
            six = "six of pigtail.bench.AxisCaps, None where it does not move"
            of_group = many(f"{name}.axes", group.axes, six)
            if len(of_group) != 6:
                raise wrong(f"{name}.axes", group.axes, six)
            if not 0 <= index(f"{name}.arm", group.arm) < len(arms):
                raise wrong(f"{name}.arm", group.arm, f"below {len(arms)}")
            axes: list[tuple[float, ...] | None] = []
            for place, axis in enumerate(of_group):
                if axis is None:
                    axes.append(None)
                    continue
                if not isinstance(axis, AxisCaps):
                    raise wrong(f"{name}.axes[{place}]", axis, "a pigtail.bench.AxisCaps, or None")
                numbers = (axis.low, axis.high, axis.resolution, axis.repeatability, axis.backlash, axis.speed)
                checked = tuple(finite(f"{name}.axes[{place}]", number) for number in numbers)
                if not (axis.low <= axis.high and axis.speed > 0.0):
                    raise wrong(f"{name}.axes[{place}]", axis, "low up to high, and a speed above zero")
                for what in ("resolution", "repeatability", "backlash"):
                    least(f"{name}.axes[{place}].{what}", getattr(axis, what))
                axes.append(checked)
            two = "two numbers: the lag and its deviation"
            lag = tuple(finite(f"{name}.lag_s", each) for each in many(f"{name}.lag_s", group.lag_s, two))
            if len(lag) != 2:
                raise wrong(f"{name}.lag_s", group.lag_s, two)
            least(f"{name}.lag_s[1]", lag[1])
            settling = least(f"{name}.settling_s", group.settling_s)
            bandwidth = least(f"{name}.bandwidth_hz", group.bandwidth_hz)
            groups.append(
                (str(group.name), group.arm, bool(group.fine), axes, settling, bandwidth, lag, bool(group.bends))
            )
        channels = []
        for of in many(f"{key}.channels", caps.channels, "those of pigtail.bench.ChannelCaps"):
            if not isinstance(of, ChannelCaps):
                raise wrong(f"{key}.channels", of, "a pigtail.bench.ChannelCaps")
            name = f"{key}.channels[{of.name!r}]"
            numbers3 = tuple(finite(name, number) for number in (of.rate_hz, of.resolution_v, of.full_scale_v))
            if min(numbers3) <= 0.0:
                raise wrong(name, of, "a rate, a resolution and a full scale above zero")
            channels.append((str(of.name), *numbers3))
        if not channels:
            raise wrong(f"{key}.channels", caps.channels, "one or more")
        self._channels = len(channels)
        cycle = least(f"{key}.cycle_s", caps.cycle_s)
        return str(caps.name), arms, groups, channels, least(f"{key}.bond_s", caps.bond_s), cycle

    def now(self) -> float:
        return finite(self._key("now_s"), self._bench.now_s)

    def play(self, group: int, law: tuple[str, Any]) -> tuple[int | None, _Why]:
        try:
            return index(self._key("play"), self._bench.play(group, law_of(law))), None
        except Refused as refused:
            return None, _why(refused)

    def bend(self, ticket: int, law: tuple[str, Any]) -> tuple[float | None, _Why]:
        try:
            return finite(self._key("bend"), self._bench.bend(ticket, law_of(law))), None
        except Refused as refused:
            return None, _why(refused)

    def request(self, what: tuple[str, int, int]) -> tuple[int | None, _Why]:
        try:
            return index(self._key("request"), self._bench.request(request_of(what))), None
        except Refused as refused:
            return None, _why(refused)

    def _light(self, light: Any) -> tuple[float, list[float]]:
        key = self._key("next")
        if not isinstance(light, Light):
            raise wrong(key, light, "a Light")
        accepted = f"as many as there are channels, {self._channels}"
        volts = [real(f"{key}: volts", each) for each in many(f"{key}: volts", light.volts, accepted)]
        if len(volts) != self._channels:
            raise wrong(f"{key}: volts", light.volts, accepted)
        return finite(f"{key}: time_s", light.time_s), volts

    def next(self, by_s: float) -> tuple[Any, Any]:
        key = self._key("next")
        try:
            event = self._bench.next(by_s)
        except FaultError as fault:
            told = (fault.code, fault.rule or fault.message, fault.axis, fault.value, fault.limit)
            return None, (*(str(each) for each in told), real(f"{key}: FaultError.time_s", fault.time_s))
        if isinstance(event, Light):
            return ("light", [self._light(event)], 0, ""), None
        if isinstance(event, Done):
            return ("done", [], index(f"{key}: ticket", event.ticket), ""), None
        if isinstance(event, Time):
            return ("time", [], 0, ""), None
        if isinstance(event, Failed):
            return ("failed", [], index(f"{key}: ticket", event.ticket), str(event.why)), None
        if isinstance(event, Batch):
            return ("batch", [self._light(light) for light in many(f"{key}: lights", event.lights, "lights")], 0, ""), None
        raise wrong(key, event, "a Light, Batch, Done, Failed or Time of pigtail.bench")

    def pose(self, group: int, at_s: float) -> tuple[list[float], bool] | None:
        key, known = self._key("pose"), self._bench.pose(group, at_s)
        if known is None:
            return None
        if not isinstance(known, Estimate) or not isinstance(known.pose, Pose):
            raise wrong(key, known, "a pigtail.bench.Estimate, or None")
        return [finite(key, number) for number in known.pose.numbers], bool(known.measured)

    def reaches(self, group: int, pose: list[float]) -> bool:
        return bool(self._bench.reaches(group, Pose(*pose)))

    def stop(self) -> None:
        self._bench.stop()


def native_bench(bench: Any) -> _pigtail.BenchTwin | Checked:
    """What Rust is given: the twin itself, or what asks a bench of a person's own."""
    from ._bench import BenchTwin

    if type(bench) is BenchTwin:
        return bench._twin
    return Checked(bench)
