"""A bench as devices of bluesky: what a RunEngine does with it, and what its documents say."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import pigtail
from pigtail.bench import Dither, Event, Knot, Light, Line, Load, Pose, Scan

pytest.importorskip("bluesky")
from bluesky import RunEngine  # noqa: E402
from bluesky import plan_stubs as bps  # noqa: E402
from bluesky import plans as bp  # noqa: E402
from bluesky import protocols  # noqa: E402
from event_model import schema_validators  # noqa: E402
from event_model import DocumentNames, unpack_event_page  # noqa: E402

import pigtail.bluesky as pb  # noqa: E402
from test_bench import Slow, Through  # noqa: E402

Documents = list[tuple[str, dict[str, Any]]]


def ran(plan: Any) -> tuple[Any, Documents]:
    """What a plan gave, and its documents, each as event-model's schema has it."""
    documents: Documents = []
    engine = RunEngine(call_returns_result=True)
    result: Any = engine(plan, lambda name, document: documents.append((name, document)))
    for name, document in documents:
        schema_validators[DocumentNames[name]].validate(document)
    return result.plan_result, documents


def events(documents: Documents, stream: str) -> list[dict[str, Any]]:
    """The events of a stream, of pages too."""
    (descriptor,) = [of["uid"] for name, of in documents if name == "descriptor" and of["name"] == stream]
    found: list[dict[str, Any]] = []
    document: Any
    for name, document in documents:
        if name == "event_page":
            found += [of for of in unpack_event_page(document) if of["descriptor"] == descriptor]
        elif name == "event" and document["descriptor"] == descriptor:
            found.append(document)
    return found


def lit(devices: pb.Devices, rig: pigtail.BenchRig, gap_um: float) -> Any:
    """A plan: both arms with their fibers on the beam, the laser on."""
    yield from bps.mv(devices.arms[0], 0, devices.arms[1], 0)
    yield from bps.mv(devices.laser, 1)
    for arm, stage in enumerate((devices.left_coarse, devices.right_coarse)):
        yield from devices.to_pose(stage, rig.pose_at(arm, 0, 1e-6 * gap_um))


def test_devices_keep_to_the_protocols() -> None:
    devices = pb.Devices(pigtail.BenchTwin(seed=7))
    fine = devices.right_fine
    assert isinstance(fine, (protocols.Readable, protocols.Movable)) and isinstance(fine, protocols.Stoppable)
    assert isinstance(fine.x, protocols.Locatable) and isinstance(fine.x, protocols.HasHints)
    assert isinstance(devices.meter, protocols.Readable) and isinstance(devices.meter, protocols.Triggerable)
    path = devices.path(fine, Line(Pose()))
    for flyer in (path, devices.aligner):
        assert isinstance(flyer, protocols.Flyable) and isinstance(flyer, protocols.EventCollectable)
    assert isinstance(fine.set((1.0, 2.0)), protocols.Status)
    with pytest.raises(AttributeError, match="right_fine"):
        devices.nothing  # noqa: B018


def test_a_device_is_aligned_into_a_stream_of_documents() -> None:
    bench = pigtail.BenchTwin(seed=7)
    device, documents = ran(pb.align(pb.Devices(bench), {"sample": "a chip"}))
    plain = pigtail.align_bench(pigtail.BenchTwin(seed=7))
    # The same device, digit for digit, as without bluesky.
    assert device.json() == plain.json()
    assert pigtail.sim.truth(bench).fibers[0] is not None
    start = next(of for name, of in documents if name == "start")
    assert (start["rig"], start["recipe"], start["sample"]) == ("bench-piezo", "y-branch", "a chip")
    (primary,) = events(documents, "primary")
    assert [primary["data"][f"pigtail_align_{port}_outcome"] for port in pb.Aligner.PORTS] == ["aligned"] * 3
    assert all(primary["data"][f"pigtail_align_{port}_outside"] < 1e-3 for port in pb.Aligner.PORTS)
    samples = events(documents, "pigtail_align_samples")
    assert len(samples) == len(plain.samples)
    np.testing.assert_array_equal(
        [of["data"]["pigtail_align_light"] for of in samples], np.nanmax(plain.samples.light_v, axis=1)
    )
    stamps = [of["timestamps"]["pigtail_align_light"] for of in samples]
    np.testing.assert_allclose(np.diff(stamps), np.diff(plain.samples.time_s), atol=1e-5)
    assert documents[-1][0] == "stop" and documents[-1][1]["exit_status"] == "success"


def test_plans_of_bluesky_scan_it() -> None:
    rig = pigtail.BenchRig()
    devices = pb.Devices(pigtail.BenchTwin(rig, seed=3), rig)
    fine = devices.right_fine

    def plan() -> Any:
        yield from lit(devices, rig, 40.0)
        yield from bp.grid_scan([devices.meter], fine.y, -6, 6, 5, fine.x, -6, 6, 5, snake_axes=True)

    seen = events(ran(plan())[1], "primary")
    assert len(seen) == 25
    for of in seen:
        for axis in ("x", "y"):
            key = f"pigtail_right_fine_{axis}"
            assert abs(of["data"][key] - of["data"][f"{key}_setpoint"]) < 0.05
    (light,) = [key for key in seen[0]["data"] if key.startswith("pigtail_light")]
    volts = np.array([of["data"][light] for of in seen])
    assert volts.max() > 3.0 * np.median(volts)


def test_one_device_at_a_time_is_the_same_every_time() -> None:
    def scanned() -> list[dict[str, Any]]:
        rig = pigtail.BenchRig()
        devices = pb.Devices(pigtail.BenchTwin(rig, seed=3), rig)

        def plan() -> Any:
            for each in devices.arms:
                yield from bps.mv(each, 0)
            yield from bps.mv(devices.laser, 1)
            for arm, stage in enumerate((devices.left_coarse, devices.right_coarse)):
                yield from devices.to_pose(stage, rig.pose_at(arm, 0, 40e-6))
            yield from bp.scan([devices.meter], devices.right_fine.x, -6, 6, 13)

        return [of["data"] for of in events(ran(plan())[1], "primary")]

    assert scanned() == scanned()


@pytest.mark.parametrize(
    ("law", "duration_s", "seconds"),
    [
        (Line(Pose.um(5.0), speed_m_s=10e-6), None, 0.5),
        (Scan((Knot(0.0, Pose()), Knot(0.4, Pose.um(4.0)), Knot(0.8, Pose.um(4.0, 4.0)))), None, 0.8),
        (Dither((0.0, 0.0), 2e-6, 5.0, radius_within_s=0.1), 0.6, 0.6),
    ],
)
def test_a_path_is_flown_and_collected(law: Any, duration_s: float | None, seconds: float) -> None:
    rig = pigtail.BenchRig()
    devices = pb.Devices(pigtail.BenchTwin(rig, seed=3), rig)
    path = devices.path(devices.right_fine, law, duration_s=duration_s)

    def plan() -> Any:
        yield from lit(devices, rig, 40.0)
        yield from bp.fly([path])

    seen = events(ran(plan())[1], "path")
    # 100 Hz, and until it is at rest.
    assert 100.0 * seconds - 2.0 <= len(seen) <= 100.0 * (seconds + 0.15)
    x = np.array([of["data"]["path_x"] for of in seen])
    assert np.isfinite(x).all()
    if duration_s is None:
        assert abs(x[-1] - (5.0 if isinstance(law, Line) else 4.0)) < 0.05
    else:
        assert 1.5 < np.abs(x).max() < 2.5
    with pytest.raises(pigtail.InputError, match="duration_s"):
        devices.path(devices.right_fine, Dither((0.0, 0.0), 1e-6, 5.0))


def test_axes_of_a_stage_move_side_by_side() -> None:
    devices = pb.Devices(pigtail.BenchTwin(seed=1))
    fine = devices.left_fine
    ran(bps.mv(fine.x, 2.0, fine.y, -3.0))
    assert abs(fine.x.position - 2.0) < 0.05 and abs(fine.y.position + 3.0) < 0.05
    assert fine.x.locate()["setpoint"] == pytest.approx(2.0)
    ran(bps.mv(fine, {"x": -1.0}))
    assert abs(fine.x.position + 1.0) < 0.05 and abs(fine.y.position + 3.0) < 0.05


def test_fibers_are_taken_and_given_back() -> None:
    bench = pigtail.BenchTwin(seed=1)
    devices = pb.Devices(bench)
    ran(bps.mv(devices.arms[1], 1))
    assert devices.arms[1].read()["pigtail_right"]["value"] == 1 and pigtail.sim.truth(bench).carried[1] is not None
    ran(bps.mv(devices.arms[1], -1))
    assert devices.arms[1].read()["pigtail_right"]["value"] == -1 and pigtail.sim.truth(bench).carried[1] is None


@pytest.mark.parametrize(
    ("plan", "error", "says"),
    [
        (lambda of: bps.mv(of.right_fine, (50.0, 0.0)), pigtail.Refused, "range"),
        (lambda of: bps.mv(of.right_fine, {"q": 1.0}), pigtail.InputError, "right_fine.set"),
        (lambda of: bps.mv(of.right_fine.x, float("nan")), pigtail.InputError, "right_fine_x.set"),
        (lambda of: bps.mv(of.arms[0], 1.5), pigtail.InputError, "pigtail_left.set"),
        (lambda of: bps.trigger(of.arms[0].attach, wait=True), pigtail.Refused, "fiber|carries|nothing"),
        (lambda of: bps.read(of.meter), pigtail.Error, "trigger"),
        (lambda of: bps.complete(of.aligner, wait=True), pigtail.Error, "kicked off"),
    ],
)
def test_what_is_not_accepted_is_raised_by_the_plan(
    plan: Callable[[pb.Devices], Any], error: type[Exception], says: str
) -> None:
    devices = pb.Devices(pigtail.BenchTwin(seed=1))
    with pytest.raises(Exception) as raised:
        ran(plan(devices))
    # A status that failed is the RunEngine's exception; ours is its cause.
    causes = [raised.value, raised.value.__cause__, *raised.value.args]
    assert any(isinstance(of, error) for of in causes), causes
    assert re.search(says, " ".join(str(of) for of in causes))
    # And nothing is stuck.
    ran(bps.mv(devices.left_fine.x, 1.0))


def test_a_bench_of_ones_own_is_called_on_one_thread() -> None:
    class Watched(Through):
        threads: set[int]

        def next(self, by_s: float) -> Event:
            self.threads.add(threading.get_ident())
            return super().next(by_s)

    own = Watched(7)
    own.threads = set()
    device, _ = ran(pb.align(pb.Devices(own)))
    assert device.aligned and len(own.threads) == 1 and threading.get_ident() not in own.threads
    assert device.json() == pigtail.align_bench(pigtail.BenchTwin(seed=7)).json()


def test_an_alignment_is_stopped() -> None:
    own = Slow("never", None)
    devices = pb.Devices(own)
    status = devices.aligner.kickoff()
    assert status.done
    with pytest.raises(pigtail.Error, match="busy"):
        devices.right_fine.read()
    devices.aligner.stop()
    devices.aligner.complete().wait(20.0)
    assert devices.aligner.device is not None and devices.aligner.device.fault is not None
    assert devices.aligner.device.fault["code"] == "stop-request" and own.stopped >= 1 and own.now_s < 30.0


def test_a_move_is_stopped() -> None:
    own = Slow("never", None)
    devices = pb.Devices(own)
    coarse = devices.right_coarse
    status = coarse.set((-1500.0, 0.0))
    coarse.stop()
    assert isinstance(status.exception(10.0), pigtail.Error)
    assert coarse.x.position > -1000.0


def test_light_is_of_after_the_trigger() -> None:
    bench = pigtail.BenchTwin(seed=1)
    bench.until(bench.request(Load(0)))
    devices = pb.Devices(bench)
    before = bench.now_s
    devices.meter.trigger().wait(10.0)
    light = devices.meter._light
    assert isinstance(light, Light) and light.time_s > before


def test_whoever_aborts_the_run_engine_stops_the_bench() -> None:
    from bluesky.utils import RunEngineInterrupted

    own = Slow("never", None)
    devices = pb.Devices(own)
    documents: Documents = []
    engine: Any = RunEngine()

    def pause() -> None:
        # An engine that has not begun cannot be paused, and when it begins is for the machine to say.
        while engine.state != "running":
            time.sleep(0.01)
        time.sleep(0.3)
        engine.request_pause(defer=False)

    timer = threading.Thread(target=pause, daemon=True)
    timer.start()
    with pytest.raises(RunEngineInterrupted):
        engine(pb.align(devices), lambda name, document: documents.append((name, document)))
    timer.join()
    engine.abort()
    devices.aligner.complete().wait(20.0)
    assert devices.aligner.device is not None and devices.aligner.device.fault is not None
    assert own.stopped >= 1 and own.now_s < 60.0
    assert documents[-1][0] == "stop" and documents[-1][1]["exit_status"] == "abort"


def test_a_path_is_stopped_and_nothing_else() -> None:
    own = Slow("never", None)
    devices = pb.Devices(own)
    path = devices.path(devices.right_fine, Dither((0.0, 0.0), 2e-6, 5.0, radius_within_s=0.1), duration_s=100.0)
    path.kickoff().wait(10.0)
    other = devices.left_coarse.set((-300.0, 0.0))
    path.stop()
    assert isinstance(path.complete().exception(10.0), pigtail.Error)
    other.wait(30.0)
    assert own.now_s < 50.0 and abs(devices.left_coarse.x.position + 300.0) < 5.0
    assert len(list(path.collect())) < 5000
