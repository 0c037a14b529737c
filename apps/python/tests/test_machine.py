"""A twin cycle by cycle, experiments, and what the store says."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

import pigtail


def test_a_motor_under_voltage_turns_and_time_goes_on() -> None:
    twin = pigtail.Twin(seed=7)
    push = pigtail.Command(motors_v=[[0.0, 0.0, 2.0], [0.0, 0.0, 0.0]])
    seen = [twin.exchange(push) for _ in range(250)]
    times = np.array([each.time_s for each in seen])
    np.testing.assert_allclose(np.diff(times), twin.period_s, rtol=1e-9)
    counts = seen[-1].encoders_counts
    assert counts.shape == (2, 3) and counts.dtype == np.int64
    assert counts[0, 2] > 100 and (counts[1] == 0).all()
    light = [each.light for each in seen if each.light is not None]
    assert light and light[0].volts.shape == (len(pigtail.CHANNELS),)
    frames = [each.vision for each in seen if each.vision is not None]
    assert frames and frames[0].fiber == (None, None)
    probes = seen[-1].probes_um
    assert probes is not None and probes.shape == (2, 3)
    truth = pigtail.sim.truth(twin)
    assert truth.fibers == (None, None, None) and not truth.collision


def test_the_same_commands_give_the_same_measurements() -> None:
    def run(seed: int) -> list[tuple[int, ...]]:
        twin = pigtail.Twin(seed=seed)
        out = []
        for k in range(200):
            volts = np.zeros((2, 3))
            volts[1, 2] = 3.0 * np.sin(0.05 * k)
            out.append(tuple(twin.exchange(pigtail.Command(motors_v=volts)).encoders_counts.ravel().tolist()))
        return out

    assert run(5) == run(5)
    assert run(5) != run(6)


def test_a_command_that_the_machine_refuses_is_a_fault_from_then_on() -> None:
    twin = pigtail.Twin(seed=1)
    with pytest.raises(pigtail.FaultError) as raised:
        twin.exchange(pigtail.Command(fiber=["attach", None]))
    assert raised.value.code == "holder-fiber" and raised.value.axis and raised.value.limit
    with pytest.raises(pigtail.FaultError) as again:
        twin.exchange(pigtail.Command())
    assert str(again.value) == str(raised.value)


def _theirs(program: str, folder: Path, *arguments: str) -> dict[str, object]:
    done = subprocess.run(
        [program, *arguments, "--json", "--runs", str(folder)], cwd=folder, capture_output=True, text=True, check=False
    )
    document = json.loads(done.stdout)
    assert isinstance(document, dict)
    return document


# Where files are, and what became of what was found: here nothing is written.
PLACES = ("report", "calibration", "found")


@pytest.mark.parametrize(
    ("arguments", "call"),
    [
        (["tune", "z", "--seed", "2"], lambda: pigtail.tune("z", seed=2)),
        (["characterize", "fivebar", "step"], lambda: pigtail.characterize("fivebar", "step")),
        (["characterize", "z", "sine"], lambda: pigtail.characterize("z", "sine")),
        (["characterize", "z", "frequency"], lambda: pigtail.characterize("z", "frequency")),
        (["identify", "windup", "fivebar"], lambda: pigtail.identify("fivebar")),
        (["commission", "--steps", "axes,dark"], lambda: pigtail.commission(steps=["axes", "dark"])),
    ],
)
def test_experiments_find_what_the_program_finds(program: str, tmp_path: Path, arguments, call) -> None:  # type: ignore[no-untyped-def]
    theirs = _theirs(program, tmp_path, *arguments)
    ours = dict(call())
    for place in PLACES:
        theirs.pop(place, None)
        ours.pop(place, None)
    assert ours == theirs


def test_what_was_found_is_believed_where_it_is_taken() -> None:
    rig = pigtail.Rig()
    tuned = pigtail.tune("z", rig, seed=9)
    assert tuned.calibration is not None
    taken = rig.believing(tuned.calibration)
    assert f"kp = \"{tuned['gains']['kp']} V/count\"" in str(taken.calibration)
    assert taken.hashes != rig.hashes
    assert pigtail.align(taken, seed=9).json() != pigtail.align(rig, seed=9).json()


def test_a_calibration_is_written_where_it_is_asked_for(tmp_path: Path) -> None:
    tuned = pigtail.tune("z")
    assert tuned.calibration is not None
    tuned.calibration.write(tmp_path / "found")
    rig = pigtail.Rig(calibration=tmp_path / "found" / "calibration.toml")
    assert str(rig.calibration) == str(tuned.calibration)


def test_the_store_says_what_the_program_says(program: str, tmp_path: Path) -> None:
    subprocess.run([program, "align", "--seed", "3", "--runs", str(tmp_path)], capture_output=True, check=True)
    theirs = json.loads(
        subprocess.run(
            [program, "runs", "list", "--json", "--runs", str(tmp_path)], capture_output=True, text=True, check=True
        ).stdout
    )
    runs = pigtail.Runs(tmp_path)
    assert runs.list() == theirs["runs"] and len(runs) == 1
    name = runs.list()[0]["run"]
    assert [fiber["outcome"] for fiber in runs[name]["fibers"]] == ["aligned"] * 3
    with pytest.raises(pigtail.InputError, match="no run nobody"):
        runs.show("nobody")
