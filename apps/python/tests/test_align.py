"""A device aligned, with the numbers of the program."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

import pigtail
from conftest import ROOT


@pytest.mark.parametrize(
    ("seed", "procedure", "options"),
    [(0, "fast", []), (7, "fast", ["--scenario", "weak"]), (2**63 + 5, "fast", ["--fleet", "workshop"]), (3, "thesis", [])],
)
def test_the_numbers_are_those_of_the_program(
    program: str, tmp_path: Path, seed: int, procedure: str, options: list[str]
) -> None:
    command = [program, "align", "--seed", str(seed), "--json", "--runs", str(tmp_path), "--procedure", procedure]
    done = subprocess.run([*command, *options], cwd=tmp_path, capture_output=True, text=True, check=False)
    theirs = json.loads(done.stdout)
    named = dict(zip((option[2:] for option in options[::2]), options[1::2], strict=True))
    device = pigtail.align(pigtail.Rig(**named), seed=seed, procedure=procedure)
    # All but where the report is: here there is none.
    assert theirs.pop("report").endswith("report.html")
    ours = dict(device)
    assert ours.pop("report") == ""
    assert list(ours) == list(theirs)
    assert ours == theirs
    text = done.stdout.strip()
    assert device.json() == text[: text.index('"report":"') + 10] + text[text.index('report.html"') + 11 :]


def test_what_is_printed_is_what_the_program_prints(program: str, tmp_path: Path) -> None:
    done = subprocess.run(
        [program, "align", "--runs", str(tmp_path)], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    lines = [line for line in done.stdout.splitlines() if not line.startswith("Report: ")]
    assert str(pigtail.align()).splitlines() == lines


def test_samples_are_those_of_the_program(program: str, tmp_path: Path) -> None:
    subprocess.run(
        [program, "align", "--seed", "4", "--runs", str(tmp_path)], cwd=tmp_path, capture_output=True, check=True
    )
    (csv,) = tmp_path.glob("*/samples.csv")
    theirs = np.genfromtxt(csv, delimiter=",", names=True, dtype=None, encoding="utf-8")
    columns = pigtail.align(seed=4).samples.columns()
    assert tuple(columns) == theirs.dtype.names
    for name, values in columns.items():
        if values.dtype.kind == "U":
            assert (values == theirs[name]).all()
        else:
            np.testing.assert_allclose(values, theirs[name], atol=6e-5, rtol=0)


def test_shapes_and_units() -> None:
    device = pigtail.align(seed=1)
    samples = device.samples
    n = len(samples)
    assert n > 100
    assert samples.time_s.shape == (n,) and (np.diff(samples.time_s) > 0).all()
    assert samples.light_v.shape == (n, len(pigtail.CHANNELS))
    assert samples.endpoint_um.shape == (n, len(pigtail.SIDES), 3)
    assert samples.micro_um.shape == (n, len(pigtail.SIDES), 2)
    assert samples.phase.shape == (n,) and samples.phase.max() < len(samples.phases)
    assert [fiber.port for fiber in device.fibers] == ["input", "output1", "output2"]
    for fiber in device.fibers:
        assert fiber.seconds == pytest.approx(sum(phase.seconds for phase in fiber.phases), abs=1e-3)
        assert fiber.believed is not None
        halves = [fiber.believed.within_um[share][0] for share in (0.5, 0.8, 0.95, 0.99)]
        assert halves == sorted(halves)
    table = samples.to_arrow()
    assert table.num_rows == n
    assert table.column("output1_V").to_numpy() == pytest.approx(
        samples.light_v[:, pigtail.CHANNELS.index("output1")]
    )


def test_the_truth_is_had_through_sim_alone() -> None:
    device = pigtail.align(seed=1)
    truth = pigtail.sim.truth(device)
    told = device["fibers"][0]["offset_um"]
    assert truth.fibers[0] is not None and truth.fibers[0].x_um == told["x"]
    words = [name for fiber in device.fibers for name in vars(fiber)]
    assert not {"offset_um", "coupling_loss_db", "within_tolerance", "truth"} & set(words)
    assert not any("truth" in name for name in pigtail.__all__)
    assert not any("plant.toml" in name for name in pigtail.Rig().files)
    assert "friction" in pigtail.sim.plant(pigtail.Rig())


def test_a_fault_is_a_result() -> None:
    device = pigtail.align(fault="encoder-stuck:left.z@0.5s")
    assert not device.aligned and device.fault is not None
    assert device.fault["axis"] == "left.z"


def test_a_rig_of_ones_own_is_read(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    folder.mkdir()
    for file in ("machine.toml", "calibration.toml"):
        (folder / file).write_text((ROOT / "rigs" / "afpm" / file).read_text())
    rig = pigtail.Rig(folder)
    assert not rig.has_twin
    with pytest.raises(pigtail.InputError, match="has no twin"):
        pigtail.align(rig)
