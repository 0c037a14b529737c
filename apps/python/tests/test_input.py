"""Bad input: an exception that names it, never a panic."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pigtail
from conftest import ROOT
from pigtail.bench import Dither, Knot, Laser, Law, Lead, Line, Pose, Scan, Widens


def _servo(**changed: Any) -> object:
    return pigtail.identify_servo("nowhere.csv", **{"position": "q", "voltage": "u", "force_per_volt": 1.0, **changed})


def _play(law: Any) -> object:
    return pigtail.BenchTwin().play(1, law)


def _circle(**changed: Any) -> Law:
    return Dither(**{"centre_m": (0.0, 0.0), "radius_m": 1e-6, "rate_hz": 5.0, **changed})


CALLS: list[tuple[Callable[[], object], str, str]] = [
    (lambda: pigtail.align(seed=-1), "seed", "-1"),
    (lambda: pigtail.align(seed=2**64), "seed", str(2**64)),
    (lambda: pigtail.align(seed=1.5), "seed", "1.5"),  # type: ignore[arg-type]
    (lambda: pigtail.align(seed=True), "seed", "True"),
    (lambda: pigtail.align(3), "rig", "3"),  # type: ignore[arg-type]
    (lambda: pigtail.align(procedure="quick"), "procedure", "quick"),
    (lambda: pigtail.align(fault="no-such@1s"), "fault", "no-such@1s"),
    (lambda: pigtail.align(faults="no-such"), "faults", "no-such"),
    (lambda: pigtail.Rig(scenario="bad"), "scenario", "bad"),
    (lambda: pigtail.tune("left.q"), "axis", "left.q"),
    (lambda: pigtail.tune("z", trials=3), "trials", "3"),
    (lambda: pigtail.tune("z", step=10**9), "step", str(10**9)),
    (lambda: pigtail.tune("z", search="guess"), "search", "guess"),
    (lambda: pigtail.identify("z", model="guess"), "model", "guess"),
    (lambda: pigtail.characterize("z", "taste"), "what", "taste"),
    (lambda: pigtail.characterize("z", "sine", frequency_hz=float("nan")), "frequency_hz", "nan"),
    (lambda: pigtail.characterize("z", "sine", frequency_hz=1e6), "frequency_hz", "1000000"),
    (lambda: pigtail.commission(steps="taste"), "steps", "taste"),
    (lambda: pigtail.commission(devices=0), "devices", "0"),
    (lambda: pigtail.Command(motors_v=[1.0, 2.0, 3.0]), "motors_v", "[3]"),
    (lambda: pigtail.Command(motors_v="a lot"), "motors_v", "'a lot'"),
    (lambda: pigtail.Command(micro_v=np.full((2, 2), np.nan)), "micro_v", "NaN"),
    (lambda: pigtail.Command(micro_v=np.full((2, 2), np.inf)), "micro_v", "inf"),
    (lambda: pigtail.Command(fiber=["drop", None]), "fiber", "drop"),
    (lambda: pigtail.Command(fiber=[None]), "fiber", "[None]"),
    (lambda: pigtail.Command(fiber=3), "fiber", "3"),  # type: ignore[arg-type]
    (lambda: pigtail.Command(fiber=[("load", "0"), None]), "fiber", "'0'"),  # type: ignore[list-item]
    (lambda: pigtail.Command(fiber=[("load",), None]), "fiber", "[('load',), None]"),  # type: ignore[list-item]
    (lambda: _play(Scan(1.0)), "law.knots", "1.0"),  # type: ignore[arg-type]
    (lambda: _play(Scan((Pose(),))), "law.knots", repr(Pose())),  # type: ignore[arg-type]
    (lambda: _play(Scan((Knot("1 s", Pose()),))), "law.time_s", "'1 s'"),  # type: ignore[arg-type]
    (lambda: _play(Line(Pose(True))), "law.to", "True"),
    (lambda: _play(_circle(centre_m=0.0)), "law.centre_m", "0.0"),
    (lambda: _play(_circle(lead=3)), "law.lead", "3"),
    (lambda: _play(_circle(lead=Lead(0, Pose(), 1.0))), "law.lead.gain", "1.0"),  # type: ignore[arg-type]
    (lambda: _play(_circle(lead=Lead(0, Pose(), ((0.0,) * 3,) * 2), widens=Widens("1 um", 1.0))), "law.widens.contact_m", "'1 um'"),  # type: ignore[arg-type]
    (lambda: pigtail.BenchTwin().light(1), "channel", "1"),
    (lambda: pigtail.BenchTwin().light(0, float("nan")), "longest_s", "nan"),
    (lambda: pigtail.BenchTwin().until(-1), "tickets", "-1"),
    (lambda: pigtail.BenchTwin().until(1, longest_s="1 s"), "longest_s", "'1 s'"),  # type: ignore[arg-type]
    (lambda: pigtail.BenchRig().width_um(-1.0), "gap_um", "-1.0"),
    (lambda: pigtail.BenchRig().pose_at(0, 0, 10**400), "gap_m", str(10**400)),
    (lambda: pigtail.Command(laser="off"), "laser", "'off'"),  # type: ignore[arg-type]
    (lambda: pigtail.BenchTwin().request(Laser("off")), "request.on", "'off'"),  # type: ignore[arg-type]
    (lambda: pigtail.Rig().believing(3), "calibration", "3"),  # type: ignore[arg-type]
    (lambda: pigtail.find_peak(pigtail.BenchTwin(), 1, gap_um=-1.0), "gap_um", "-1.0"),
    (lambda: pigtail.Twin(seed=0).exchange(1.0), "command", "1.0"),  # type: ignore[arg-type]
    (lambda: pigtail.campaign(0), "devices", "0"),
    (lambda: pigtail.campaign(1, threads=0), "threads", "0"),
    (lambda: pigtail.campaign(1, shards=2), "shards", "2"),
    (lambda: pigtail.campaign(2, seed=2**64 - 1), "seed", str(2**64 - 1)),
    (lambda: pigtail.campaign(2, commissioned="no"), "commissioned", "'no'"),  # type: ignore[arg-type]
    (lambda: pigtail.campaign(2, client=5), "client", "5"),  # type: ignore[arg-type]
    (lambda: pigtail.align(progress=5), "progress", "5"),  # type: ignore[arg-type]
    (lambda: pigtail.run_shard("nowhere", 3, 2), "index", "3"),
    (lambda: _servo(force_per_volt=0.0), "force_per_volt", "0"),
    (lambda: _servo(force_per_volt=float("nan")), "force_per_volt", "nan"),
    (lambda: _servo(friction="sticky"), "friction", "sticky"),
    (lambda: _servo(method="guess"), "method", "guess"),
    (lambda: _servo(cutoff_hz=-1.0), "cutoff_hz", "-1"),
    (lambda: _servo(counts_per_turn=1), "counts_per_turn", "1"),
    (lambda: _servo(position=" "), "position", '" "'),
]


@pytest.mark.parametrize(("call", "key", "value"), CALLS, ids=[f"{k}-{v}" for _, k, v in CALLS])
def test_an_argument_is_named(call: Callable[[], object], key: str, value: str) -> None:
    with pytest.raises(pigtail.InputError) as raised:
        call()
    assert (raised.value.key, raised.value.value) == (key, value)
    assert raised.value.file == ""
    assert str(raised.value).startswith(f"{key}: ")
    assert isinstance(raised.value, ValueError) and isinstance(raised.value, pigtail.Error)


def test_a_file_is_named(tmp_path: Path) -> None:
    for file in ("machine.toml", "plant.toml", "calibration.toml"):
        text = (ROOT / "rigs" / "afpm" / file).read_text()
        if file == "machine.toml":
            rate = next(line for line in text.splitlines() if line.startswith("rate ="))
            text = text.replace(rate, 'rate = "2500 V"', 1)
        (tmp_path / file).write_text(text)
    with pytest.raises(pigtail.InputError) as raised:
        pigtail.Rig(tmp_path)
    error = raised.value
    assert error.file == str(tmp_path / "machine.toml")
    assert error.key.endswith("rate") and error.value == "2500 V"
    assert error.line is not None and "rate" in Path(error.file).read_text().splitlines()[error.line - 1]


@pytest.mark.parametrize(
    "call",
    [
        lambda path: pigtail.Rig(path),
        lambda path: pigtail.Rig(recipe=path),
        lambda path: pigtail.Rig(fleet=path),
        lambda path: pigtail.Rig(axes=[path]),
        lambda path: pigtail.Runs(path),
        lambda path: pigtail.simulate_joint(path, "z", step=100.0),
        lambda path: pigtail.merge(path, runs=path),
        lambda path: pigtail.run_shard(path, 1, 2),
        lambda path: pigtail.campaign(resume=path),
        lambda path: pigtail.identify_servo(path, position="q", voltage="u", force_per_volt=1.0),
    ],
)
def test_a_missing_file_is_named(tmp_path: Path, call: Callable[[str], object]) -> None:
    path = str(tmp_path / "missing.toml")
    with pytest.raises(pigtail.InputError) as raised:
        call(path)
    assert path in raised.value.file
    assert not (tmp_path / "missing.toml").exists()


JOINT = {
    "Jm": 1e-6, "Jl": 1e-5, "r": 0.2, "P": 1e-4, "km": 0.02, "kb": 0.02, "R": 5.0, "ks": 10.0,
    "bm": 1e-6, "bl": 1e-5, "fsm": 1e-3, "fcm": 8e-4, "fsl": 2e-3, "fcl": 1.5e-3,
    "Nenc": 2048, "Ts": 4e-4, "Vmax": 24.0, "Vint": 5.0, "kp": 0.05, "ki": 0.5, "kd": 1e-4,
}  # fmt: skip


def test_a_joint_moves_and_refuses_nonsense() -> None:
    seen = pigtail.simulate_joint(JOINT, step=200)
    n = len(seen["time_s"])
    assert all(column.shape == (n,) for column in seen.values())
    assert seen["count"][-1] > 100
    held = pigtail.simulate_joint(JOINT, voltages=(np.array([0.0, 0.01]), np.array([3.0, 0.0])))
    assert held["q_m_rad"].max() > 0.0
    for key, arguments in {
        "input": {},
        "voltages": {"voltages": ([0.0, 0.0], [1.0, 1.0])},
        "impulse": {"impulse": (1.0, 2.0)},
        "triangle": {"triangle": (100.0, -1.0)},
        "max_step_s": {"step": 1.0, "max_step_s": float("inf")},
    }.items():
        with pytest.raises(pigtail.InputError) as raised:
            pigtail.simulate_joint(JOINT, **arguments)  # type: ignore[arg-type]
        assert raised.value.key == key
    with pytest.raises(pigtail.InputError, match=r"params\.Jm: is -1"):
        pigtail.simulate_joint({**JOINT, "Jm": -1.0}, step=1.0)
    with pytest.raises(pigtail.InputError, match="params: unknown field `Jx`"):
        pigtail.simulate_joint({**JOINT, "Jx": 1.0}, step=1.0)


@pytest.mark.parametrize(
    "values",
    [np.zeros(6), np.zeros((3, 2)), np.zeros((2, 3), dtype=complex), [["a"] * 3] * 2, "a", [[1.0, 2.0]]],
)
@pytest.mark.parametrize("of", ["motors_v", "micro_v", "references_counts"])
def test_an_array_that_is_no_command_is_refused(of: str, values: Any) -> None:
    with pytest.raises(pigtail.InputError) as raised:
        pigtail.Twin(seed=0).exchange(pigtail.Command(**{of: values}))
    assert raised.value.key == of


def test_the_truth_is_told_of_rigs_alone() -> None:
    with pytest.raises(pigtail.InputError, match="accepted is a Rig"):
        pigtail.sim.plant("afpm")  # type: ignore[arg-type]
