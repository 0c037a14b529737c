"""What goes from process to process, as Dask's workers and ``multiprocessing`` ask for."""

import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pigtail
import pigtail.bench


def again(what: Any) -> Any:
    """The same as another process reads it."""
    return pickle.loads(pickle.dumps(what))


def test_an_alignment_is_the_same_again() -> None:
    device = pigtail.align(seed=7)
    copy = again(device)
    assert type(copy) is pigtail.Alignment
    assert copy.json() == device.json() and str(copy) == str(device)
    assert copy.fibers == device.fibers and copy.samples.phases == device.samples.phases
    np.testing.assert_array_equal(copy.samples.light_v, device.samples.light_v)
    assert pigtail.sim.truth(copy) == pigtail.sim.truth(device)


def test_what_was_found_is_believed_elsewhere() -> None:
    tuned = pigtail.tune("z", seed=3, trials=5)
    copy = again(tuned)
    assert copy.calibration is not None and tuned.calibration is not None
    assert copy.calibration.files == tuned.calibration.files
    for name, values in tuned.arrays.items():
        np.testing.assert_array_equal(copy.arrays[name], values)
    rig = pigtail.Rig(fleet="workshop", scenario="noise").believing(tuned.calibration)
    other = again(rig)
    assert (other.fleet, other.scenario, other.hashes) == (rig.fleet, rig.scenario, rig.hashes)
    assert other.hashes != pigtail.Rig(fleet="workshop").hashes
    assert pigtail.align(other, seed=4).json() == pigtail.align(rig, seed=4).json()


def test_another_process_makes_the_same_of_a_rig() -> None:
    rig = pigtail.Rig(fleet="thesis")
    code = "import pickle, sys, pigtail; print(pigtail.align(pickle.load(sys.stdin.buffer), seed=2).json())"
    told = subprocess.run([sys.executable, "-c", code], input=pickle.dumps(rig), stdout=subprocess.PIPE, check=True)
    assert told.stdout.decode().strip() == pigtail.align(rig, seed=2).json().strip()


def test_a_bench_and_its_rig() -> None:
    rig = pigtail.BenchRig()
    assert again(rig).hashes == rig.hashes and again(rig).taught == rig.taught
    with pytest.raises(TypeError):
        pickle.dumps(pigtail.BenchTwin(seed=1))


def test_a_campaign_and_a_tray() -> None:
    campaign = pigtail.campaign(4, threads=1)
    copy = again(campaign)
    assert copy.rows_sha256 == campaign.rows_sha256 and copy.path == campaign.path and str(copy) == str(campaign)


def test_a_file_that_is_another_one_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    folder.mkdir()
    source = Path(__file__).parents[3] / "rigs" / "afpm"
    for name in ("machine.toml", "plant.toml", "calibration.toml"):
        (folder / name).write_text((source / name).read_text())
    kept = pickle.dumps(pigtail.Rig(folder, calibration=source / "calibration.toml"))
    assert pickle.loads(kept).name == str(folder)
    (folder / "machine.toml").write_text((source / "machine.toml").read_text() + "# changed\n")
    with pytest.raises(pigtail.InputError) as told:
        pickle.loads(kept)
    assert told.value.file.endswith("machine.toml") and "another file" in str(told.value)


def test_what_goes_wrong_elsewhere_is_told_here() -> None:
    for error in (
        pigtail.InputError("mine.toml: no", "mine.toml", "key", "3", 7),
        pigtail.FaultError("it stopped", "motor-stall", "motor turns", "left.z", "0", "1", 2.5),
        pigtail.OutcomeError("no light", "no_light"),
        pigtail.bench.TicketOver(5),
        pigtail.Refused("no"),
    ):
        copy = again(error)
        assert type(copy) is type(error) and str(copy) == str(error) and copy.__dict__ == error.__dict__
