"""A tray is produced, as the program does it."""

import json
import os
import signal
import subprocess
import threading
import time
from pathlib import Path

import pytest

import pigtail

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def tray(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two devices of the example tray."""
    text = (ROOT / "trays" / "four.toml").read_text()
    head, *devices = text.split("[[devices]]\n")
    last, fibers = devices[-1].split("[[fibers]]\n", 1)
    of_two = head + "".join("[[devices]]\n" + device for device in devices[:2]) + "[[fibers]]\n" + fibers
    path = tmp_path_factory.mktemp("tray") / "two.toml"
    path.write_text(of_two)
    return path


@pytest.fixture(scope="module")
def produced(tray: Path) -> pigtail.Production:
    return pigtail.produce(tray, seed=3)


def test_it_is_what_the_program_says(
    program: str, tmp_path: Path, tray: Path, produced: pigtail.Production
) -> None:
    done = subprocess.run(
        [program, "produce", "--tray", str(tray), "--seed", "3", "--json", "--runs", str(tmp_path)],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode in (0, 1), done.stderr
    *events, last = [json.loads(line) for line in done.stdout.splitlines()]
    assert {key: produced[key] for key in last} == last
    (summary,) = tmp_path.glob("*/summary.json")
    theirs = json.loads(summary.read_text())
    # How fast it was is another number each time.
    assert {k: v for k, v in theirs.items() if k != "times_real_time"} == {
        k: v for k, v in produced.items() if k != "times_real_time"
    }
    assert [event for event in events if event["event"] != "device"] == [
        event for event in produced.events if event["event"] != "device"
    ]


def test_fibers_and_steps_are_told(produced: pigtail.Production) -> None:
    assert [pigtail.port for pigtail in produced.pigtails[:3]] == ["input", "output1", "output2"]
    assert len(produced.pigtails) == produced["fibers"] == 6
    assert any(fiber.cured is not None and fiber.cured.sigma_db > 0.0 for fiber in produced.pigtails)
    steps = produced.steps
    assert {step.side for step in steps} == {"left", "right"}
    assert all(step.start <= step.end for step in steps)
    assert '"produced"' not in str(produced)


def test_many_trays_are_what_the_program_says(program: str, tmp_path: Path, tray: Path) -> None:
    many = pigtail.produce(tray, seed=3, trays=3, threads=2)
    done = subprocess.run(
        [program, "produce", "--tray", str(tray), "--seed", "3", "--trays", "3", "--json", "--runs", str(tmp_path)],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode in (0, 1), done.stderr
    *events, last = [json.loads(line) for line in done.stdout.splitlines()]
    assert {key: many[key] for key in last} == last
    assert [event["seed"] for event in events] == list(many.productions) == [3, 4, 5]
    assert many.json() == pigtail.produce(tray, seed=3, trays=3, threads=1).json()
    low, high = many["exact_95"]["yield"]
    assert low <= many["yield"] <= high
    assert len(many.pigtails) == many["fibers"] == 18 and not many.refused


def test_each_of_many_is_the_one_of_its_seed(tray: Path, produced: pigtail.Production) -> None:
    (one,) = pigtail.produce(tray, seed=3, trays=1).productions.values()
    assert one.pigtails == produced.pigtails and not one.events


def test_many_machines_are_commissioned_first(tray: Path) -> None:
    of = pigtail.Rig(fleet="workshop")
    many = pigtail.produce(tray, of, seed=9100, trays=2, commissioned=True)
    assert many["commissioned"] and many["fleet"] == "workshop"
    assert many["trays"] == len(many.productions) == 2 - len(many.refused) == 2 - many["trays_refused"]


def test_what_recipes_say_can_be_overruled(tray: Path, produced: pigtail.Production) -> None:
    untracked = pigtail.produce(tray, seed=3, track=False)
    assert untracked["shift_um"]["tracked"] is None
    assert produced["shift_um"]["tracked"] is not None


def test_progress_is_told_and_ctrl_c_stops_it(tray: Path) -> None:
    heard: list[tuple[int, int, str]] = []
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    timer = threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT))
    timer.start()
    began = time.monotonic()
    try:
        with pytest.raises(KeyboardInterrupt):
            for _ in range(100):
                pigtail.produce(tray, progress=lambda *told: heard.append(told))
    finally:
        timer.cancel()
        signal.signal(signal.SIGINT, before)
    assert time.monotonic() - began < 30.0
    assert heard and heard[-1][1] == 2


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        ({"tray": "no-such-tray"}, ""),
        ({"tray": 7}, "tray"),
        ({"tray": "four\0"}, ""),
        ({"seed": -1}, "seed"),
        ({"trays": 0}, "trays"),
        ({"trays": 2.5}, "trays"),
        ({"trays": 2, "threads": 0}, "threads"),
        ({"threads": 2}, "threads"),
        ({"trays": 2, "seed": 2**64 - 1}, "seed"),
        ({"trays": 2, "tray": "no-such-tray"}, ""),
        ({"track": "yes"}, "track"),
        ({"precompensate": 1}, "precompensate"),
        ({"commissioned": "no"}, "commissioned"),
        ({"rig": "no-such-rig"}, ""),
    ],
)
def test_what_is_wrong_is_said(arguments: dict[str, object], key: str) -> None:
    with pytest.raises(pigtail.InputError) as raised:
        pigtail.produce(**arguments)  # type: ignore[call-overload]
    assert raised.value.key == key
    assert str(raised.value)


def test_all_mistakes_of_a_tray_are_told_at_once(tmp_path: Path, tray: Path) -> None:
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(tray.read_text().replace('"L1"', '"L9"', 1).replace('"R1"', '"R0"', 1))
    with pytest.raises(pigtail.InputError) as raised:
        pigtail.produce(wrong)
    assert raised.value.key == "tray"
    assert "L9" in str(raised.value) and "R0" in str(raised.value)
