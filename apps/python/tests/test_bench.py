"""Benches both ways: ours driven from Python, and our alignment on benches that Python implements."""

import json
import math
import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pigtail
from pigtail.bench import (
    AxisCaps,
    Batch,
    Brake,
    Caps,
    ChannelCaps,
    Dither,
    Done,
    Estimate,
    Event,
    GroupCaps,
    Knot,
    Laser,
    Law,
    Light,
    Line,
    Load,
    Pose,
    Request,
    Scan,
    TicketOver,
    Time,
)


def test_a_twin_is_driven_step_by_step() -> None:
    twin = pigtail.BenchTwin(seed=7)
    assert [group.name for group in twin.caps.groups] == ["left.coarse", "left.fine", "right.coarse", "right.fine"]
    fine = twin.caps.group("right.fine")
    to = Pose.um(2.0, -1.0)
    lights = twin.until(twin.play(fine, Line(to)), twin.request(Load(1)))
    # A fiber takes a second, and the meter speaks at 100 Hz.
    assert 95 <= len(lights) <= 105 and (np.diff([light.time_s for light in lights]) > 0).all()
    known = twin.pose(fine, twin.now_s)
    assert known is not None and known.measured
    np.testing.assert_allclose(known.pose.numbers, to.numbers, atol=20e-9)
    assert twin.pose(fine, twin.now_s - 30.0) is None
    assert twin.reaches(fine, Pose.um(9.0)) and not twin.reaches(fine, Pose.um(11.0))
    turn = twin.play(fine, Dither(centre_m=(2e-6, 0.0), radius_m=1e-6, rate_hz=5.0, radius_within_s=0.1))
    twin.next(twin.now_s + 0.3)
    twin.bend(turn, Dither(centre_m=(0.0, 0.0), radius_m=0.0, rate_hz=5.0, centre_within_s=0.1, radius_within_s=0.1))
    twin.until(turn)
    twin.until(twin.play(fine, Scan((Knot(0.0, Pose()), Knot(0.2, Pose.um(5.0))))))
    twin.play(fine, Line(Pose()))
    twin.until(twin.play(fine, Brake()))
    truth = pigtail.sim.truth(twin)
    assert truth.fibers == (None, None, None) and not truth.collision
    assert truth.carried[0] is None and truth.carried[1] is not None
    assert not any("truth" in name for name in dir(twin) if not name.startswith("_"))


def test_what_the_guard_forbids_is_refused_and_nothing_moves() -> None:
    rig = pigtail.BenchRig()
    twin = pigtail.BenchTwin(rig, seed=1)
    coarse = twin.caps.group("left.coarse")
    taught = next(of for of in rig.taught if of.arm == 0)
    with pytest.raises(pigtail.Refused, match="touch the facet"):
        twin.play(coarse, Line(taught.pose + Pose.um(z_um=5.0)))
    with pytest.raises(pigtail.Refused, match="out.* of its range"):
        twin.play(coarse, Line(Pose(x_m=1.0)))
    with pytest.raises(pigtail.Refused, match="not a number"):
        twin.play(coarse, Line(Pose(x_m=math.nan)))
    with pytest.raises(pigtail.Refused, match="there is no group 9"):
        twin.play(9, Brake())
    with pytest.raises(pigtail.Refused, match="ticket 77"):
        twin.bend(77, Brake())
    with pytest.raises(pigtail.Refused, match="arm"):
        twin.request(Load(arm=5))
    assert twin.pose(coarse, twin.now_s) is not None
    for call, key in [
        (lambda: twin.play(coarse, "fast"), "law"),  # type: ignore[arg-type]
        (lambda: twin.play(-1, Brake()), "group"),
        (lambda: twin.play(coarse, Line("there")), "law.to"),  # type: ignore[arg-type]
        (lambda: twin.request("light"), "request"),  # type: ignore[arg-type]
        (lambda: twin.next(math.nan), "by_s"),
        (lambda: pigtail.BenchTwin("afpm"), "kind"),
        (lambda: pigtail.BenchTwin(seed=-1), "seed"),
        (lambda: pigtail.align_bench(3), "bench"),  # type: ignore[arg-type]
        (lambda: rig.pose_at(7, 0, 1e-6), "port"),
        (lambda: pigtail.find_peak(twin, 9, gap_um=10.0), "group"),
    ]:
        made: Callable[[], object] = call
        with pytest.raises(pigtail.InputError) as raised:
            made()
        assert raised.value.key == key or key in str(raised.value)


class Through(pigtail.Bench):
    """Passes every call on to a twin."""

    def __init__(self, seed: int) -> None:
        self.twin = pigtail.BenchTwin(seed=seed)
        self.calls = 0

    @property
    def caps(self) -> Caps:
        return self.twin.caps

    @property
    def now_s(self) -> float:
        return self.twin.now_s

    def play(self, group: int, law: Law) -> int:
        return self.twin.play(group, law)

    def bend(self, ticket: int, law: Law) -> float:
        return self.twin.bend(ticket, law)

    def request(self, what: Request) -> int:
        return self.twin.request(what)

    def next(self, by_s: float) -> Event:
        self.calls += 1
        return self.twin.next(by_s)

    def pose(self, group: int, at_s: float) -> Estimate | None:
        return self.twin.pose(group, at_s)

    def reaches(self, group: int, pose: Pose) -> bool:
        return self.twin.reaches(group, pose)

    def stop(self) -> None:
        self.twin.stop()


@pytest.mark.parametrize("seed", [7, 2**40 + 11])
def test_a_bench_in_python_is_aligned_as_the_program_aligns_its_twin(program: str, tmp_path: Path, seed: int) -> None:
    command = [program, "align", "--rig", "bench-piezo", "--seed", str(seed), "--json", "--runs", str(tmp_path)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    theirs = json.loads(done.stdout)
    own = Through(seed)
    device = pigtail.align_bench(own)
    twin = pigtail.BenchTwin(seed=seed)
    ours = pigtail.align_bench(twin)
    assert own.calls > 1000 and device.json() == ours.json()
    np.testing.assert_array_equal(device.samples.light_v, ours.samples.light_v)
    for ours_row, theirs_row in zip(device["fibers"], theirs["fibers"], strict=True):
        for key, value in theirs_row.items():
            # What only the truth says, a bench does not.
            known = key not in ("offset_um", "coupling_loss_db", "within_tolerance")
            assert ours_row[key] == (value if known else None), key
    assert device["seconds_per_fiber"] == theirs["seconds_per_fiber"] and device["collision"] is None
    with pytest.raises(pigtail.InputError, match="nobody knows"):
        pigtail.sim.truth(device)
    # The twin stands where the program's stood: asked through `sim`, its truth is the same to the last digit.
    truth = pigtail.sim.truth(own.twin)
    for fiber, row in zip(truth.fibers, theirs["fibers"], strict=True):
        assert fiber is not None and round(fiber.x_um, 6) == pytest.approx(row["offset_um"]["x"], abs=1.1e-6)


class Gauss(pigtail.Bench):
    """A beam of Gaussian shape between two arms, each with one piezo group that gets where it is told at once."""

    def __init__(self, peak_um: tuple[float, float], width_um: float, seed: int) -> None:
        axes = tuple(AxisCaps(-1e-5, 1e-5, 1e-9, 5e-9, 1e-3) if place < 2 else None for place in range(6))
        groups = tuple(
            GroupCaps(f"{arm}.piezo", place, True, axes, 0.01, 20.0, (0.0, 1e-4)) for place, arm in enumerate("ab")
        )
        self._caps = Caps("gauss", ("a", "b"), groups, (ChannelCaps("diode", 1000.0, 1e-4, 10.0),))
        self._peak, self._width = np.array(peak_um), width_um
        self._rng = np.random.default_rng(seed)
        self._now, self._step, self._tickets, self._laser = 0.0, 0, 0, True
        self._done: list[int] = []
        self._laws: list[tuple[float, int, Dither, np.ndarray[Any, Any], float, float] | None] = [None, None]
        self._past: list[np.ndarray[Any, Any]] = [np.zeros((2, 2))]
        self.stopped = False

    @property
    def caps(self) -> Caps:
        return self._caps

    @property
    def now_s(self) -> float:
        return self._now

    def _ticket(self) -> int:
        self._tickets += 1
        return self._tickets

    def _circle(self, group: int) -> tuple[np.ndarray[Any, Any], float, float]:
        """Middle, radius and angle now, metres."""
        law = self._laws[group]
        if law is None:
            return self._past[-1][group], 0.0, 0.0
        since, _, dither, middle, radius, angle = law
        after = self.now_s - since

        def share(within: float) -> float:
            return 1.0 if after >= within else 0.5 - 0.5 * math.cos(math.pi * after / within)

        centre = middle + (np.array(dither.centre_m) - middle) * share(dither.centre_within_s)
        wide = radius + (dither.radius_m - radius) * share(dither.radius_within_s)
        return centre, wide, angle + 2 * math.pi * dither.rate_hz * after

    def play(self, group: int, law: Law) -> int:
        if not isinstance(law, Dither):
            raise pigtail.Refused("circles only")
        ticket = self._ticket()
        self._laws[group] = (self.now_s, ticket, law, *self._circle(group))
        return ticket

    def bend(self, ticket: int, law: Law) -> float:
        for group, played in enumerate(self._laws):
            if played is not None and played[1] == ticket and isinstance(law, Dither):
                self._laws[group] = (self.now_s, ticket, law, *self._circle(group))
                return self.now_s
        raise TicketOver(ticket)

    def request(self, what: Request) -> int:
        if not isinstance(what, Laser):
            raise pigtail.Refused("nobody is here to do that")
        self._laser = what.on
        self._done.append(self._ticket())
        return self._done[-1]

    def next(self, by_s: float) -> Event:
        if self._done:
            return Done(self._done.pop(0))
        if by_s < (self._step + 1) * 1e-3 - 1e-9:
            self._now = max(self._now, by_s)
            return Time()
        self._step += 1
        self._now = self._step * 1e-3
        at = np.zeros((2, 2))
        for group in range(2):
            centre, radius, angle = self._circle(group)
            at[group] = centre + radius * np.array([math.cos(angle), math.sin(angle)])
            law = self._laws[group]
            if law is not None and law[2].radius_m == 0.0:
                within = max(law[2].radius_within_s, law[2].centre_within_s)
                if self.now_s - law[0] > within + 0.01:
                    self._done.append(law[1])
                    self._laws[group] = None
        self._past.append(at)
        off = np.linalg.norm(1e6 * at[1] - self._peak)
        signal = 2.0 * math.exp(-2.0 * (off / self._width) ** 2) if self._laser else 0.0
        return Light(self.now_s, (0.01 + signal + 1e-3 * self._rng.normal(),))

    def pose(self, group: int, at_s: float) -> Estimate | None:
        if not 0.0 <= at_s <= self.now_s:
            return None
        step, share = divmod(at_s * 1e3, 1.0)
        before = self._past[min(int(step), self._step)][group]
        after = self._past[min(int(step) + 1, self._step)][group]
        return Estimate(Pose(*(before + (after - before) * share)))

    def stop(self) -> None:
        self.stopped = True


@pytest.mark.parametrize("peak", [(1.0, -0.7), (-2.0, 1.5), (0.0, 0.0)])
def test_a_peak_is_found_on_a_simulator_in_numpy(peak: tuple[float, float]) -> None:
    bench = Gauss(peak, 3.6, 5)
    found = pigtail.find_peak(bench, 1, gap_um=10.0)
    assert math.hypot(found.x_um - peak[0], found.y_um - peak[1]) < 0.1
    assert found.light_v == pytest.approx(2.0, rel=0.02)
    standing = bench.pose(1, bench.now_s)
    assert standing is not None and math.hypot(*np.subtract(standing.pose.xyz_um[:2], peak)) < 0.1


def test_where_there_is_no_light_that_is_the_outcome() -> None:
    with pytest.raises(pigtail.OutcomeError) as raised:
        pigtail.find_peak(Gauss((40.0, 0.0), 3.6, 1), 1, gap_um=10.0)
    assert raised.value.outcome


class Mistaken(Through):
    """A bench that makes one mistake, after a while."""

    def __init__(self, method: str, what: Any) -> None:
        super().__init__(3)
        self._method, self._what, self.stopped = method, what, 0

    def _slip(self, method: str) -> bool:
        return method == self._method and self.twin.now_s > 2.0

    def next(self, by_s: float) -> Event:
        event = super().next(by_s)
        if self._slip("next"):
            made: Event = self._what(event) if callable(self._what) else self._what
            return made
        return event

    def pose(self, group: int, at_s: float) -> Estimate | None:
        if self._slip("pose"):
            return self._what  # type: ignore[no-any-return]
        return super().pose(group, at_s)

    def play(self, group: int, law: Law) -> int:
        if self._slip("play"):
            return self._what  # type: ignore[no-any-return]
        return super().play(group, law)

    def stop(self) -> None:
        self.stopped += 1
        super().stop()


@pytest.mark.parametrize(
    ("method", "what", "key"),
    [
        ("next", None, "Mistaken.next"),
        ("next", "light", "Mistaken.next"),
        ("next", Light(3.0, (1.0, 2.0)), "Mistaken.next: volts"),
        ("next", Light(3.0, ("bright",)), "Mistaken.next: volts"),  # type: ignore[arg-type]
        ("next", Light(3.0, None), "Mistaken.next: volts"),  # type: ignore[arg-type]
        ("next", Light(3.0, 1.0), "Mistaken.next: volts"),  # type: ignore[arg-type]
        ("next", Batch(None), "Mistaken.next: lights"),  # type: ignore[arg-type]
        ("next", Light(math.nan, (1.0,)), "Mistaken.next: time_s"),
        ("next", Done(-4), "Mistaken.next: ticket"),
        ("pose", (0.0, 0.0, 0.0), "Mistaken.pose"),
        ("pose", Estimate(Pose(x_m=math.nan)), "Mistaken.pose"),
        ("play", None, "Mistaken.play"),
        ("play", 1.5, "Mistaken.play"),
    ],
)
def test_what_a_bench_says_wrongly_is_named(method: str, what: Any, key: str) -> None:
    bench = Mistaken(method, what)
    with pytest.raises(pigtail.InputError) as raised:
        pigtail.align_bench(bench)
    assert raised.value.key == key and str(raised.value).startswith(key)
    assert bench.stopped >= 1


@pytest.mark.parametrize(
    ("part", "changed", "key"),
    [
        ("caps", {"groups": None}, "caps.groups"),
        ("caps", {"groups": (None,)}, "caps.groups"),
        ("caps", {"arms": 2}, "caps.arms"),
        ("caps", {"channels": (None,)}, "caps.channels"),
        ("caps", {"bond_s": -1.0}, "caps.bond_s"),
        ("channel", {"full_scale_v": 0.0}, "caps.channels['power']"),
        ("group", {"settling_s": -1.0}, ".settling_s"),
        ("group", {"bandwidth_hz": -3.0}, ".bandwidth_hz"),
        ("group", {"lag_s": 0.01}, ".lag_s"),
        ("group", {"axes": None}, ".axes"),
        ("group", {"axes": (3,) * 6}, ".axes[0]"),
        ("group", {"axes": (AxisCaps(-1e-5, 1e-5, -1.0, 0.0, 1e-3),) * 6}, ".resolution"),
    ],
)
def test_caps_that_are_none_are_named(part: str, changed: dict[str, Any], key: str) -> None:
    class Odd(Through):
        @property
        def caps(self) -> Caps:
            of = self.twin.caps
            if part == "group":
                return replace(of, groups=tuple(replace(group, **changed) for group in of.groups))
            if part == "channel":
                return replace(of, channels=tuple(replace(channel, **changed) for channel in of.channels))
            return replace(of, **changed)

    with pytest.raises(pigtail.InputError) as raised:
        pigtail.align_bench(Odd(1))
    assert raised.value.key.startswith("Odd.caps.") and key in raised.value.key


@pytest.mark.parametrize(
    ("what", "code"),
    [
        (Done(999_999), "event-order"),
        (Light(0.001, (0.1,)), "event-order"),
        (Light(1e6, (0.1,)), "event-order"),
        (Light(3.0, (math.inf,)), "sensor-silence"),
        (Time(), "event-order"),
        # A clock that stands still with it would never be found silent.
        (Batch(()), "event-order"),
    ],
)
def test_events_out_of_order_stop_the_bench(what: Event, code: str) -> None:
    bench = Mistaken("next", what)
    device = pigtail.align_bench(bench)
    assert device.fault is not None and device.fault["code"] == code and not device.aligned
    assert bench.stopped >= 1


def test_an_exception_comes_out_as_it_is() -> None:
    def explode(_: Event) -> Event:
        raise ZeroDivisionError("the stage is on fire")

    bench = Mistaken("next", explode)
    with pytest.raises(ZeroDivisionError, match="on fire"):
        pigtail.align_bench(bench)
    assert bench.stopped == 1

    def fault(_: Event) -> Event:
        raise pigtail.FaultError("it has stopped", code="stop-request", axis="left.x", value="a button", limit="none")

    device = pigtail.align_bench(Mistaken("next", fault))
    assert device.fault is not None and (device.fault["code"], device.fault["axis"]) == ("stop-request", "left.x")


class Slow(Mistaken):
    """A bench of hardware's pace: a device takes minutes on it."""

    def next(self, by_s: float) -> Event:
        time.sleep(0.005)
        return super().next(by_s)


def test_ctrl_c_stops_a_bench_in_python() -> None:
    own = Slow("never", None)
    timer = threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT))
    # What a shell starts in the background ignores Ctrl-C, and so would the test.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        pigtail.align_bench(own)
    timer.join()
    signal.signal(signal.SIGINT, before)
    assert own.stopped == 1 and own.now_s < 30.0
