"""A bench as devices of bluesky; needs ``pip install pigtail[bluesky]``.

>>> from bluesky import RunEngine
>>> from bluesky.plans import grid_scan
>>> import pigtail, pigtail.bluesky
>>> devices = pigtail.bluesky.Devices(pigtail.BenchTwin(seed=7))
>>> RE = RunEngine()
>>> RE(pigtail.bluesky.align(devices), print)

:class:`Devices` has a :class:`Stage` for each group of axes (``devices.right_fine``, and ``.x``, ``.y``, ``.z`` of it), a :class:`Meter`,
a :class:`LaserSwitch`, an :class:`Arm` for each arm, and an :class:`Aligner`; :class:`Path` flies a law of motion and
collects the light on the way. Lengths are micrometres, as in :attr:`pigtail.bench.Pose.xyz_um`.

All calls to the bench are made on one thread, that of :class:`Devices`. A bench's time passes while something is under way, and only
then: whoever sets one device at a time and waits gets the same from the same seed. Timestamps are the moment at which the
devices were made and the bench's time since, so that a twin's are not the clock's.
"""

from __future__ import annotations

import threading
from collections.abc import Generator, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

try:
    import bluesky.plan_stubs as bps
    import bluesky.preprocessors as bpp
except ImportError as error:  # pragma: no cover
    raise ImportError("pigtail.bluesky needs bluesky: pip install 'pigtail[bluesky]'") from error

from ._align import Alignment
from ._bench import BenchRig, align_bench, bench_rig
from ._driver import LONGEST_S, Driver, Status, Waiting
from ._errors import Error, FaultError, InputError
from ._input import number, switch, whole
from .bench import (
    DEGREES,
    Attach,
    Bench,
    Brake,
    Caps,
    Dither,
    Estimate,
    Event,
    Laser,
    Law,
    Light,
    Line,
    Load,
    Pose,
    Request,
    Unload,
)

if TYPE_CHECKING:
    from bluesky.protocols import Reading
    from bluesky.utils import MsgGenerator

_Reading: TypeAlias = "dict[str, Reading[Any]]"


class _Device:
    """What all devices have."""

    def __init__(self, name: str, driver: Driver, parent: _Device | None = None) -> None:
        self._name, self._driver, self._parent = name, driver, parent

    @property
    def name(self) -> str:
        """Its name; keys of what it reads begin with it."""
        return self._name

    @property
    def parent(self) -> _Device | None:
        """What it is a part of."""
        return self._parent

    def read_configuration(self) -> _Reading:
        """Nothing."""
        return {}

    def describe_configuration(self) -> dict[str, Any]:
        """Nothing."""
        return {}

    def _source(self, what: str = "") -> str:
        return f"bench://{self._driver.bench.caps.name}/{what or self._name}"

    def _stamp(self, time_s: float) -> float:
        return self._driver.began + time_s

    def _key(self, units: str, what: str = "") -> dict[str, Any]:
        return {"source": self._source(what), "dtype": "number", "shape": [], "units": units}

    def __repr__(self) -> str:
        return f"<pigtail.bluesky.{type(self).__name__}: {self._name}>"


class Stage(_Device):
    """A group of axes that moves as one: ``set`` it to ``(x, y)`` or ``(x, y, z)`` in micrometres, to a mapping such as
    ``{"x": 1.0}``, or to a :class:`pigtail.bench.Pose`; what is not named stays.

    Attributes:
        group: Its place in the bench's caps.
        axes: Its axes by name; ``.x``, ``.y`` and ``.z`` are the same.
    """

    x: Axis
    y: Axis
    z: Axis

    def __init__(self, name: str, driver: Driver, group: int) -> None:
        super().__init__(name, driver)
        self.group = group
        caps = driver.bench.caps.groups[group]
        self._told = Pose()
        self._under_way: list[Status] = []
        self.axes = {
            degree: Axis(f"{name}_{degree}", driver, self, place)
            for place, (degree, axis) in enumerate(zip(DEGREES, caps.axes))
            if axis is not None and place < 3
        }
        for degree, axis in self.axes.items():
            setattr(self, degree, axis)

    @property
    def hints(self) -> dict[str, Any]:
        """What is worth a picture."""
        return {"fields": [axis.name for axis in self.axes.values()]}

    def _wanted(self, value: Any) -> dict[int, float]:
        key = f"{self._name}.set"
        if isinstance(value, Pose):
            return {place: at for place, at in enumerate(value.numbers) if place < 3 and DEGREES[place] in self.axes}
        if isinstance(value, Mapping):
            named = value
        else:
            try:
                named = dict(zip(DEGREES, value, strict=False))
            except TypeError:
                named = {}
        if not named or not set(named) <= set(self.axes):
            message = (
                f"{key}: is {value!r}; accepted are micrometres of {list(self.axes)}, in order or by name, or a Pose"
            )
            raise InputError(message, key=key, value=repr(value))
        return {DEGREES.index(degree): 1e-6 * number(f"{key}: {degree}", um) for degree, um in named.items()}

    def set(self, value: Any) -> Status:
        """Moves there in a straight line, and comes to rest. What another of its axes was told meanwhile holds."""
        return self._go(self._wanted(value))

    def _go(self, wanted: Mapping[int, float]) -> Status:
        def job() -> Waiting:
            bench = self._driver.bench
            numbers = list(self._told.numbers)
            for place, at in wanted.items():
                numbers[place] = at
            to = Pose(*numbers)
            ticket = bench.play(self.group, Line(to))
            self._told = to
            waiting = Waiting(Status(), bench.now_s + LONGEST_S, ticket=ticket)
            # The line before is replaced, and this one goes where that was to go too: both are done with it.
            before, self._under_way = [of for of in self._under_way if not of.done], [waiting.status]
            for status in before:
                waiting.status.add_callback(lambda of, status=status: status._finish(of.exception()))  # type: ignore[misc]
            self._driver.waiting = [of for of in self._driver.waiting if of.status not in before]
            self._under_way += before
            return waiting

        return self._driver.begin(job)

    def stop(self, success: bool = False) -> None:
        """To rest as fast as it can."""

        def job() -> None:
            # Where nothing is under way there is nothing to stop: the RunEngine asks at the end of every plan.
            if all(of.done for of in self._under_way):
                return
            bench = self._driver.bench
            bench.play(self.group, Brake())
            self._driver.let_go(self._under_way, None if success else Error(f"{self._name} was stopped"))
            known = bench.pose(self.group, bench.now_s)
            self._told = self._told if known is None else known.pose

        self._driver.post(job)

    def _readback(self) -> tuple[float, Estimate | None]:
        bench = self._driver.bench
        return bench.now_s, bench.pose(self.group, bench.now_s)

    def read(self) -> _Reading:
        """Where it is measured to be, and was told to be, micrometres."""
        read: _Reading = {}
        for axis in self.axes.values():
            read.update(axis.read())
        return read

    def describe(self) -> dict[str, Any]:
        """What it reads."""
        described: dict[str, Any] = {}
        for axis in self.axes.values():
            described.update(axis.describe())
        return described


class Axis(_Device):
    """An axis of a stage, micrometres."""

    parent: Stage

    def __init__(self, name: str, driver: Driver, stage: Stage, place: int) -> None:
        super().__init__(name, driver, stage)
        self._stage, self._place = stage, place

    @property
    def hints(self) -> dict[str, Any]:
        """What is worth a picture."""
        return {"fields": [self._name]}

    def set(self, value: float) -> Status:
        """Moves there, micrometres, and comes to rest."""
        return self._stage._go({self._place: 1e-6 * number(f"{self._name}.set", value)})

    def stop(self, success: bool = False) -> None:
        """Its stage, to rest as fast as it can."""
        self._stage.stop(success)

    @property
    def position(self) -> float:
        """Where it is measured to be, micrometres; where it was told to be, where nothing measures it."""
        return float(self.read()[self._name]["value"])

    def locate(self) -> dict[str, float]:
        """Where it was told to be, and is, micrometres."""
        return {"setpoint": 1e6 * self._stage._told.numbers[self._place], "readback": self.position}

    def read(self) -> _Reading:
        """Where it is measured to be, and was told to be, micrometres."""
        now, known = self._driver.do(self._stage._readback)
        told = 1e6 * self._stage._told.numbers[self._place]
        at = told if known is None else 1e6 * known.pose.numbers[self._place]
        stamp = self._stamp(now)
        setpoint: Reading[Any] = {"value": told, "timestamp": stamp}
        return {self._name: {"value": at, "timestamp": stamp}, f"{self._name}_setpoint": setpoint}

    def describe(self) -> dict[str, Any]:
        """What it reads."""
        return {name: self._key("um", name) for name in (self._name, f"{self._name}_setpoint")}


class Meter(_Device):
    """The light: ``trigger`` waits for the next sample, volts."""

    def __init__(self, name: str, driver: Driver) -> None:
        super().__init__(name, driver)
        self._channels = [f"{name}_{of.name}" for of in driver.bench.caps.channels]
        self._light: Light | None = None

    @property
    def hints(self) -> dict[str, Any]:
        """What is worth a picture."""
        return {"fields": self._channels}

    def trigger(self) -> Status:
        """Waits for a sample that was taken after now."""

        def job() -> Waiting:
            now = self._driver.bench.now_s
            # A sample is a mean of what was before its time.
            fastest = max(of.rate_hz for of in self._driver.bench.caps.channels)
            return Waiting(Status(), now + LONGEST_S, after_s=now + 1.0 / fastest, into=self._hear)

        return self._driver.begin(job)

    def _hear(self, light: Light) -> None:
        self._light = light

    def read(self) -> _Reading:
        """The sample, volts."""
        light = self._light
        if light is None:
            raise Error(f"{self._name}: has no sample yet; accepted is to trigger it first")
        stamp = self._stamp(light.time_s)
        return {name: {"value": volts, "timestamp": stamp} for name, volts in zip(self._channels, light.volts)}

    def describe(self) -> dict[str, Any]:
        """What it reads."""
        return {name: self._key("V", name) for name in self._channels}


class _Asked(_Device):
    """What is set by a request."""

    _value: Any = 0
    _since_s = 0.0
    _dtype = "integer"

    def _ask(self, what: Request, value: Any) -> Status:
        def job() -> Waiting:
            bench = self._driver.bench
            waiting = Waiting(Status(), bench.now_s + LONGEST_S, ticket=bench.request(what))
            waiting.status.add_callback(over)
            return waiting

        def over(of: Status) -> None:
            if of.success:
                self._value, self._since_s = value, self._driver.bench.now_s

        return self._driver.begin(job)

    def read(self) -> _Reading:
        """What it was set to."""
        return {self._name: {"value": self._value, "timestamp": self._stamp(self._since_s)}}

    def describe(self) -> dict[str, Any]:
        """What it reads."""
        return {self._name: {"source": self._source(), "dtype": self._dtype, "shape": []}}


class LaserSwitch(_Asked):
    """The laser: 1 or 0."""

    def set(self, value: bool) -> Status:
        """On or off."""
        on = switch(self._name, value)
        return self._ask(Laser(on), int(on))


class Arm(_Asked):
    """An arm: ``set`` it to a port, from zero, and it takes the fiber for that; to -1, and it gives it back.

    Attributes:
        attach: ``trigger`` it, and the fiber is fixed to the chip where it stands, and let go of.
    """

    _value = -1

    def __init__(self, name: str, driver: Driver, arm: int) -> None:
        super().__init__(name, driver)
        self.arm = arm
        self.attach = _Attached(f"{name}_attached", driver, arm)

    def set(self, value: int) -> Status:
        """Takes the fiber for a port, or gives it back."""
        if value == -1:
            return self._ask(Unload(self.arm), -1)
        port = whole(f"{self._name}.set", value)
        return self._ask(Load(self.arm, port), port)


class _Attached(_Asked):
    """How many fibers were attached."""

    def __init__(self, name: str, driver: Driver, arm: int) -> None:
        super().__init__(name, driver)
        self._arm = arm

    def trigger(self) -> Status:
        """Attaches the fiber that the arm carries."""
        return self._ask(Attach(self._arm), self._value + 1)


class Path(_Device):
    """Flies a law of motion of a stage, and collects the light on the way, each sample with where the stage was then.

    Args:
        stage: What moves.
        law: How: a ``Line``, ``Scan`` or ``Dither`` of :mod:`pigtail.bench`.
        meter: What measures the light; the keys are its own.
        duration_s: How long, seconds of the bench's time; needed of a ``Dither`` that has a radius, which goes on for ever.
    """

    def __init__(
        self, stage: Stage, law: Law, meter: Meter, *, duration_s: float | None = None, name: str = "path"
    ) -> None:
        super().__init__(name, stage._driver)
        if isinstance(law, Dither) and law.radius_m != 0.0 and duration_s is None:
            raise InputError("duration_s: is missing; accepted is how long the circle goes on", key="duration_s")
        self.stage, self.law, self._meter = stage, law, meter
        self._duration_s = None if duration_s is None else number("duration_s", duration_s)
        self._rows: list[tuple[Light, Estimate | None]] = []
        self._flown: Status | None = None
        self._played: Status | None = None

    def kickoff(self) -> Status:
        """Begins to move and to collect."""

        def hear(light: Light) -> None:
            self._rows.append((light, self._driver.bench.pose(self.stage.group, light.time_s)))

        def job() -> Waiting:
            bench = self._driver.bench
            self._rows = []
            now = bench.now_s
            longest = now + LONGEST_S + (self._duration_s or 0.0)
            ticket = bench.play(self.stage.group, self.law)
            self._driver.hears.append(hear)
            waiting = Waiting(Status(), longest, ticket=ticket)
            if self._duration_s is not None:
                waiting.ticket, waiting.until_s = None, now + self._duration_s
            waiting.status.add_callback(over)
            self._played = waiting.status
            return waiting

        def over(_: Status) -> None:
            self._driver.hears.remove(hear)
            bench = self._driver.bench
            if self._duration_s is not None:
                bench.play(self.stage.group, Brake())
            known = bench.pose(self.stage.group, bench.now_s)
            if known is not None:
                self.stage._told = self.law.to if isinstance(self.law, Line) else known.pose

        if self._flown is not None and not self._flown.done:
            raise Error(f"{self._name}: is under way")
        self._flown = self._driver.begin(job)
        began = Status()
        # What cannot begin has ended already.
        self._driver.post(lambda: None).add_callback(
            lambda _: began._finish(self._flown.exception() if self._flown is not None and self._flown.done else None)
        )
        return began

    def complete(self) -> Status:
        """Done at the end of the path."""
        if self._flown is None:
            raise Error(f"{self._name}: was not kicked off")
        return self._flown

    def stop(self, success: bool = False) -> None:
        """To rest as fast as it can."""
        flown = self._flown

        def job() -> None:
            if flown is None or flown.done:
                return
            self._driver.bench.play(self.stage.group, Brake())
            if self._played is not None:
                self._driver.let_go([self._played], None if success else Error(f"{self._name} was stopped"))

        self._driver.post(job)

    def describe_collect(self) -> dict[str, Any]:
        """What it collects, in a stream of its name."""
        axes = {f"{self._name}_{degree}": self._key("um", f"{self.stage.name}_{degree}") for degree in self.stage.axes}
        return {self._name: {**self._meter.describe(), **axes}}

    def collect(self) -> Iterator[dict[str, Any]]:
        """The samples, in order."""
        for light, known in self._rows:
            data = dict(zip(self._meter._channels, light.volts))
            for degree in self.stage.axes:
                place = DEGREES.index(degree)
                data[f"{self._name}_{degree}"] = float("nan") if known is None else 1e6 * known.pose.numbers[place]
            stamp = self._stamp(light.time_s)
            yield {"time": stamp, "data": data, "timestamps": dict.fromkeys(data, stamp)}


class _Interrupted(Bench):
    """A bench that stops when it is asked to."""

    def __init__(self, bench: Bench, asked: threading.Event) -> None:
        self._bench, self._asked = bench, asked

    @property
    def caps(self) -> Caps:
        return self._bench.caps

    @property
    def now_s(self) -> float:
        return self._bench.now_s

    def play(self, group: int, law: Law) -> int:
        return self._bench.play(group, law)

    def bend(self, ticket: int, law: Law) -> float:
        return self._bench.bend(ticket, law)

    def request(self, what: Request) -> int:
        return self._bench.request(what)

    def next(self, by_s: float) -> Event:
        if self._asked.is_set():
            self._bench.stop()
            raise FaultError("it was asked to stop", code="stop-request", rule="stop", time_s=self._bench.now_s)
        return self._bench.next(by_s)

    def pose(self, group: int, at_s: float) -> Estimate | None:
        return self._bench.pose(group, at_s)

    def reaches(self, group: int, pose: Pose) -> bool:
        return self._bench.reaches(group, pose)

    def stop(self) -> None:
        self._bench.stop()


@dataclass
class _Result:
    """What came of an alignment."""

    device: Alignment | None = None
    began_s: float = 0.0
    ended_s: float = 0.0
    asked: threading.Event = field(default_factory=threading.Event)


class Aligner(_Device):
    """Our alignment of a device on the bench (:func:`pigtail.align_bench`), as a flyer that is read at its end: what control says of
    each fiber, and every light sample. The bench carries nothing, and its arms are away from the chip."""

    PORTS = ("input", "output1", "output2")

    def __init__(self, name: str, driver: Driver, rig: BenchRig) -> None:
        super().__init__(name, driver)
        self.rig = rig
        self._result = _Result()
        self._status: Status | None = None

    @property
    def device(self) -> Alignment | None:
        """What came of it; ``None`` before."""
        return self._result.device

    @property
    def hints(self) -> dict[str, Any]:
        """What is worth a picture."""
        return {"fields": [f"{self._name}_{port}_outcome" for port in self.PORTS]}

    def kickoff(self) -> Status:
        """Begins to align."""
        if self._driver.busy:
            raise Error(f"the bench is busy: {self._driver.busy}")
        result = self._result = _Result()
        self._driver.busy = "it aligns"

        def job() -> None:
            bench = self._driver.bench
            try:
                result.began_s = bench.now_s
                result.device = align_bench(_Interrupted(bench, result.asked), self.rig, progress=False)
                result.ended_s = bench.now_s
            finally:
                self._driver.busy = ""

        self._status = self._driver.post(job)
        began = Status()
        began._finish()
        return began

    def complete(self) -> Status:
        """Done when the device is."""
        if self._status is None:
            raise Error(f"{self._name}: was not kicked off")
        return self._status

    def stop(self, success: bool = False) -> None:
        """Stops the bench: that is the result, a fault by the rule ``stop-request``."""
        self._result.asked.set()

    def _samples(self) -> str:
        return f"{self._name}_samples"

    def describe_collect(self) -> dict[str, Any]:
        """The light samples, in a stream of its own."""
        keys = {f"{self._name}_phase": {"source": self._source("phase"), "dtype": "string", "shape": []}}
        for name, units in self._columns():
            keys[f"{self._name}_{name}"] = self._key(units, name)
        return {self._samples(): keys}

    def _columns(self) -> list[tuple[str, str]]:
        names = [f"{side}_{axis}" for side in ("left", "right") for axis in ("x", "y", "z", "fine_x", "fine_y")]
        return [("light", "V"), *((name, "um") for name in names)]

    def collect(self) -> Iterator[dict[str, Any]]:
        """The light samples, in order."""
        device = self._result.device
        if device is None:
            return
        seen = device.samples
        phases = [*(f"{of.port} {of.name}" for of in seen.phases), ""]
        for k, at in enumerate(seen.time_s):
            light = seen.light_v[k]
            data: dict[str, Any] = {
                f"{self._name}_phase": phases[seen.phase[k]],
                f"{self._name}_light": float(light.max()),
            }
            for side, name in enumerate(("left", "right")):
                for place, axis in enumerate("xyz"):
                    data[f"{self._name}_{name}_{axis}"] = float(seen.endpoint_um[k, side, place])
                for place, axis in enumerate("xy"):
                    data[f"{self._name}_{name}_fine_{axis}"] = float(seen.micro_um[k, side, place])
            stamp = self._stamp(float(at))
            yield {"time": stamp, "data": data, "timestamps": dict.fromkeys(data, stamp)}

    def read(self) -> _Reading:
        """What control says of each fiber; probabilities that one is out of tolerance are ``nan`` where it cannot say."""
        result = self._result
        if result.device is None:
            raise Error(f"{self._name}: has aligned nothing yet")
        values: dict[str, Any] = {}
        fibers = {fiber.port: fiber for fiber in result.device.fibers}
        for port in self.PORTS:
            fiber = fibers.get(port)
            values[f"{self._name}_{port}_outcome"] = "no_report" if fiber is None else fiber.outcome
            values[f"{self._name}_{port}_seconds"] = 0.0 if fiber is None else fiber.seconds
            believed = None if fiber is None else fiber.believed
            values[f"{self._name}_{port}_outside"] = float("nan") if believed is None else believed.outside
        fault = result.device.fault
        values[f"{self._name}_fault"] = "" if fault is None else str(fault["code"])
        stamp = self._stamp(result.ended_s)
        return {key: {"value": value, "timestamp": stamp} for key, value in values.items()}

    def describe(self) -> dict[str, Any]:
        """What it reads."""
        described: dict[str, Any] = {}
        for port in self.PORTS:
            key = f"{self._name}_{port}"
            described[f"{key}_outcome"] = {"source": self._source(f"{port}/outcome"), "dtype": "string", "shape": []}
            described[f"{key}_seconds"] = self._key("s", f"{port}/seconds")
            described[f"{key}_outside"] = self._key("", f"{port}/outside")
        described[f"{self._name}_fault"] = {"source": self._source("fault"), "dtype": "string", "shape": []}
        return described


class Devices:
    """The devices of a bench.

    Args:
        bench: A twin, or one of your own. From now on it is called on one thread of ours alone.
        rig: What is believed of it; ``bench-piezo`` if not given.
        name: What names of devices begin with.

    Attributes:
        stages: Stages by the names of their groups; ``devices.right_fine`` is that of ``right.fine``.
        meter: The light.
        laser: The laser.
        arms: The arms.
        aligner: Our alignment.
    """

    def __init__(self, bench: Bench, rig: BenchRig | str | None = None, *, name: str = "pigtail") -> None:
        if not isinstance(bench, Bench):
            raise InputError(f"bench: is {bench!r}; accepted is a pigtail.Bench", key="bench", value=repr(bench))
        believed = bench_rig(rig)
        driver = self._driver = Driver(bench)
        self.name = name
        self.stages: dict[str, Stage] = {}
        for place, group in enumerate(bench.caps.groups):
            plain = group.name.replace(".", "_")
            self.stages[group.name] = Stage(f"{name}_{plain}", driver, place)
            setattr(self, plain, self.stages[group.name])
        self.meter = Meter(f"{name}_light", driver)
        self.laser = LaserSwitch(f"{name}_laser", driver)
        self.arms = tuple(Arm(f"{name}_{arm}", driver, place) for place, arm in enumerate(bench.caps.arms))
        self.aligner = Aligner(f"{name}_align", driver, believed)

    def __getattr__(self, name: str) -> Stage:
        raise AttributeError(
            f"{name}; stages are {[each.replace('.', '_') for each in self.__dict__.get('stages', {})]}"
        )

    def path(self, stage: Stage, law: Law, *, duration_s: float | None = None, name: str = "path") -> Path:
        """A path of a stage, with the light on the way."""
        return Path(stage, law, self.meter, duration_s=duration_s, name=name)

    def to_pose(self, stage: Stage, pose: Pose) -> MsgGenerator[None]:
        """A plan that brings a stage to a pose, such as one of :meth:`pigtail.BenchRig.pose_at`."""
        yield from bps.mv(stage, pose)


def align(devices: Devices, md: Mapping[str, Any] | None = None) -> Generator[Any, Any, Alignment | None]:
    """A plan for the RunEngine: aligns a device, and leaves a run of two streams: ``primary``, one event with what control says of
    each fiber, and ``..._align_samples``, every light sample and where the tips were. The start document has rig,
    recipe and what they were read from. Gives the :class:`pigtail.Alignment`; where it is aborted the bench is stopped."""
    aligner = devices.aligner
    about = {
        "plan_name": "pigtail.align",
        "detectors": [aligner.name],
        "hints": {"dimensions": [(["time"], "primary")]},
        "rig": aligner.rig.name,
        "recipe": aligner.rig.recipe,
        "sources": [{"file": file, "sha256": digest} for file, digest in aligner.rig.hashes.items()],
        **(md or {}),
    }

    def flown() -> Generator[Any, Any, None]:
        yield from bps.kickoff(aligner, wait=True)
        yield from bps.complete(aligner, wait=True)

    def stopped(_: Exception) -> Generator[Any, Any, None]:
        aligner.stop()
        yield from bps.null()

    @bpp.run_decorator(md=about)  # type: ignore[untyped-decorator]
    def run() -> Generator[Any, Any, None]:
        yield from bpp.contingency_wrapper(flown(), except_plan=stopped)  # type: ignore[no-untyped-call]
        yield from bps.collect(aligner)
        yield from bps.create(name="primary")
        yield from bps.read(aligner)
        yield from bps.save()

    yield from run()
    return aligner.device


__all__ = ["Aligner", "Arm", "Axis", "Devices", "LaserSwitch", "Meter", "Path", "Stage", "Status", "align"]
