"""Campaigns: the same rows for any number of shards and workers, whoever is killed on the way."""

import json
import os
import signal
import subprocess
import threading
import time
from pathlib import Path

import pytest

import pigtail

DEVICES = 24


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> pigtail.Campaign:
    return pigtail.campaign(DEVICES, runs=tmp_path_factory.mktemp("runs"))


def test_rows_are_those_of_the_program(program: str, tmp_path: Path, whole: pigtail.Campaign) -> None:
    done = subprocess.run(
        [program, "campaign", "--devices", str(DEVICES), "--json", "--runs", str(tmp_path)],
        cwd=tmp_path, capture_output=True, text=True, check=True,
    )  # fmt: skip
    theirs = json.loads(done.stdout)
    assert theirs["rows_sha256"] == whole.rows_sha256
    places = ("rows", "report", "wall_seconds")
    assert {k: v for k, v in theirs.items() if k not in places} == {
        k: v for k, v in whole.items() if k not in places
    }


def test_rows_can_be_read(whole: pigtail.Campaign) -> None:
    table = whole.to_arrow()
    assert table.num_rows == 3 * DEVICES
    assert table.column("seed").to_pylist()[::3] == list(range(DEVICES))
    assert os.path.exists(whole.path)


def test_nothing_is_kept_where_nothing_was_asked_for() -> None:
    result = pigtail.campaign(2)
    path = result.path
    assert os.path.exists(path)
    del result
    assert not os.path.exists(path)


def test_shards_of_program_and_package_are_the_same_bytes(
    program: str, tmp_path: Path, whole: pigtail.Campaign
) -> None:
    folder = pigtail.campaign_folder(DEVICES, runs=tmp_path)
    first, done = pigtail.run_shard(folder, 1, 3)
    assert first is not None and done == DEVICES // 3
    assert pigtail.run_shard(folder, 1, 3) == (first, 0)
    for shard in ("3/3", "2/3", "1/3"):
        subprocess.run(
            [program, "campaign", "--devices", str(DEVICES), "--shard", shard, "--runs", str(tmp_path)],
            cwd=tmp_path, capture_output=True, check=True,
        )  # fmt: skip
    assert len(list(Path(folder).glob("*.parquet"))) == 3
    merged = pigtail.merge(folder, runs=tmp_path)
    assert merged.rows_sha256 == whole.rows_sha256
    done_by = subprocess.run(
        [program, "campaign", "--merge", folder, "--json", "--runs", str(tmp_path)],
        cwd=tmp_path, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert json.loads(done_by.stdout)["rows_sha256"] == whole.rows_sha256


def test_shards_need_no_files_of_the_rig(tmp_path: Path) -> None:
    rig = pigtail.Rig()
    tuned = pigtail.tune("z", rig, seed=9)
    assert tuned.calibration is not None
    taken = rig.believing(tuned.calibration)
    one = pigtail.campaign(4, taken, seed=9)
    folder = pigtail.campaign_folder(4, taken, seed=9, runs=tmp_path)
    for index in (1, 2):
        pigtail.run_shard(folder, index, 2)
    assert pigtail.merge(folder, runs=tmp_path).rows_sha256 == one.rows_sha256
    assert folder != pigtail.campaign_folder(4, rig, seed=9, runs=tmp_path)


def test_a_missing_shard_is_named(tmp_path: Path) -> None:
    folder = pigtail.campaign_folder(4, runs=tmp_path)
    pigtail.run_shard(folder, 1, 2)
    with pytest.raises(pigtail.InputError, match="begins with device 2 of 4"):
        pigtail.merge(folder, runs=tmp_path)


def test_one_that_was_stopped_goes_on_to_the_same_rows(tmp_path: Path, whole: pigtail.Campaign) -> None:
    def enough(done: int, total: int, text: str) -> None:
        if done >= 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pigtail.campaign(DEVICES, runs=tmp_path, threads=1, progress=enough)
    (folder,) = tmp_path.glob("*-campaign-0")
    assert (folder / "campaign.json").exists()
    assert pigtail.campaign(resume=folder).rows_sha256 == whole.rows_sha256


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_killed_worker_loses_nothing(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    devices = 160
    one = pigtail.campaign(devices)
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        victim, *_ = client.nthreads()
        pid = client.run(os.getpid, workers=[victim])[victim]
        killed = []

        def kill() -> None:
            # In the midst of it: some shards are done, and not all.
            (folder,) = _wait_for(tmp_path)
            while len(list(folder.glob("*.parquet"))) < 3:
                time.sleep(0.005)
            os.kill(pid, signal.SIGKILL)
            killed.append(len(list(folder.glob("*.parquet"))))

        killer = threading.Thread(target=kill)
        killer.start()
        result = pigtail.campaign(devices, client=client, shards=40, runs=tmp_path)
        killer.join()
    assert 3 <= killed[0] < 40
    assert result.rows_sha256 == one.rows_sha256


def _wait_for(runs: Path) -> list[Path]:
    while not (found := list(runs.glob("campaign-0-*"))):
        time.sleep(0.005)
    return found
