"""The package itself: how fast it is imported, how it is stopped, what it shows."""

import io
import os
import signal
import subprocess
import sys
import threading
import time
import zipfile
from pathlib import Path

import pytest

import pigtail


def test_it_is_imported_within_three_tenths_of_a_second() -> None:
    # Of processor: on a machine that is busy, a clock on the wall tells of the neighbours.
    code = "import time; t = time.process_time(); import pigtail; print(time.process_time() - t)"
    times = [float(subprocess.check_output([sys.executable, "-c", code], text=True)) for _ in range(5)]
    assert min(times) <= 0.3, times


def test_the_wheel_is_small() -> None:
    beside = Path(pigtail.__file__).parent.rglob("*")
    # A wheel is a zip: what is weighed is what a reader downloads.
    wheel = io.BytesIO()
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as packed:
        for path in beside:
            if path.is_file() and "__pycache__" not in path.parts:
                packed.write(path, path.relative_to(Path(pigtail.__file__).parent))
    assert len(packed.namelist()) > 5
    assert len(wheel.getvalue()) < 15e6


def test_other_threads_go_on() -> None:
    counts = [0]
    over = threading.Event()

    def count() -> None:
        while not over.is_set():
            counts[0] += 1
            time.sleep(0.001)

    counter = threading.Thread(target=count)
    counter.start()
    before, began = counts[0], time.perf_counter()
    pigtail.campaign(40, threads=1)
    seconds, counted = time.perf_counter() - began, counts[0] - before
    over.set()
    counter.join()
    # Were the lock held, there would be none.
    assert counted > 5, (counted, seconds)


def test_ctrl_c_stops_the_machine() -> None:
    # What was started in a shell's background begins with Ctrl-C ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    timer = threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        # Minutes, if nobody stops it.
        pigtail.characterize("z", "impulse")
    timer.join()
    signal.signal(signal.SIGINT, before)


def test_progress_is_told() -> None:
    told: list[tuple[int, int, str]] = []
    pigtail.campaign(30, threads=1, progress=lambda done, total, text: told.append((done, total, text)))
    done = [each[0] for each in told if each[2] == "devices"]
    assert done == sorted(done) and len(done) > 2
    assert {each[1] for each in told} == {30}


def test_a_mistake_in_progress_ends_the_work() -> None:
    def mistaken(done: int, total: int, text: str) -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        pigtail.campaign(100, progress=mistaken)


def test_a_bar_is_shown_where_it_is_asked_for(capfd: pytest.CaptureFixture[str]) -> None:
    pigtail.campaign(20, threads=1, progress=True)
    assert "campaign" in capfd.readouterr().err
    pigtail.campaign(2)
    assert capfd.readouterr().err == ""


def test_all_that_is_exported_is_documented() -> None:
    for name in pigtail.__all__:
        thing = getattr(pigtail, name)
        if callable(thing):
            assert thing.__doc__, name
