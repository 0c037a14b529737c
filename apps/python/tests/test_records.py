"""An axis from one's own log: what the program finds, digit for digit, and what a rig makes of it."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

import pigtail
from test_input import JOINT

FORCE_PER_VOLT = JOINT["km"] / JOINT["R"]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four seconds of a joint that is driven by sines."""
    path = tmp_path_factory.mktemp("log") / "log.csv"
    t = np.arange(0.0, 4.0, JOINT["Ts"])
    phase = 2 * np.pi * np.cumsum(np.interp(t, [0.0, 4.0], [0.5, 6.0])) * JOINT["Ts"]
    volts = 3.0 * np.sin(phase) + 1.5 * np.sin(2.7 * phase + 1.0)
    seen = pigtail.simulate_joint(JOINT, voltages=(t, volts), duration_s=4.0, row_period_s=JOINT["Ts"])
    rows = [
        f"{a:.6f},{b:.8f},{c:.5f}" for a, b, c in zip(seen["time_s"], seen["count"] * 2 * np.pi / 2048, seen["u_V"])
    ]
    path.write_text("\n".join(["t_s,q_rad,u_V", *rows]) + "\n")
    return path


def test_it_is_what_the_program_finds(program: str, log: Path, tmp_path: Path) -> None:
    found = pigtail.identify_servo(log, position="q_rad", voltage="u_V", force_per_volt=FORCE_PER_VOLT, gear_ratio=0.2)
    command = [
        program, "identify", "servo", "--data", str(log), "--position", "q_rad", "--voltage", "u_V", "--force-per-volt",
        str(FORCE_PER_VOLT), "--gear-ratio", "0.2", "--json", "--runs", str(tmp_path),
    ]  # fmt: skip
    theirs = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    places = ("report", "fragment")
    assert dict(found) == {key: value for key, value in theirs.items() if key not in places}
    written = Path(theirs["fragment"]).read_text()
    assert found.fragment is not None
    without = [
        [line for line in text.splitlines() if "origin" not in line and "date" not in line]
        for text in (found.fragment, written)
    ]
    assert without[0] == without[1]


def test_it_is_what_the_joint_is(log: Path, tmp_path: Path) -> None:
    found = pigtail.identify_servo(log, position="q_rad", voltage="u_V", force_per_volt=FORCE_PER_VOLT, gear_ratio=0.2)
    inertia = found.values["inertia"]
    assert inertia == pytest.approx(JOINT["Jm"] + JOINT["r"] ** 2 * JOINT["Jl"], rel=0.02)
    n = len(found.arrays["time_s"])
    assert n > 100 and all(column.shape == (n,) for column in found.arrays.values())
    left = found.arrays["measured_force"] - found.arrays["modelled_force"]
    assert np.sqrt(np.mean(left**2)) < 0.05 * np.sqrt(np.mean(found.arrays["measured_force"] ** 2))
    rig = pigtail.Rig(axes=[found.write(tmp_path / "axis.toml")])
    assert [path.name for path in tmp_path.iterdir()] == ["axis.toml"]
    assert pigtail.characterize("fivebar", "step", rig)["axis"]


def test_what_a_log_does_not_tell_has_no_value(tmp_path: Path) -> None:
    path = tmp_path / "still.csv"
    t = np.arange(0.0, 2.0, 1e-3)
    path.write_text("t_s,q_rad,u_V\n" + "\n".join(f"{a:.4f},0.0,{np.sin(a):.4f}" for a in t) + "\n")
    found = pigtail.identify_servo(path, position="q_rad", voltage="u_V", force_per_volt=1.0)
    assert set(found.values.values()) == {None} and found.fragment is None and "not identifiable" in found["verdict"]
    with pytest.raises(pigtail.Error, match="no fragment"):
        found.write(tmp_path / "axis.toml")
    assert not (tmp_path / "axis.toml").exists()


@pytest.mark.parametrize(
    ("columns", "key"),
    [
        ({"position": "nothing"}, "nothing"),
        ({"position": "q_rad:V"}, "q_rad"),
        ({"position": "q_rad", "cutoff_hz": 1e6}, "cutoff_hz"),
    ],
)
def test_what_is_wrong_with_a_file_is_named(log: Path, columns: dict[str, object], key: str) -> None:
    arguments: dict[str, object] = {"voltage": "u_V", "force_per_volt": 1.0, **columns}
    with pytest.raises(pigtail.InputError) as raised:
        pigtail.identify_servo(log, **arguments)  # type: ignore[arg-type]
    assert str(log) in raised.value.file and key in raised.value.key
