"""Algorithms beside ours: judged by a truth that they do not see, each by its own script."""

from __future__ import annotations

import importlib
import math
import subprocess
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pigtail
from conftest import ROOT
from pigtail.bench import Bench, Line, Load, Pose

BASELINES = ROOT / "apps" / "python" / "baselines"
NEEDS = {
    "nine_point": (), "raster_climb": (), "spgd": (), "nelder_mead": ("scipy",), "cma_es": ("cma",), "bayes": ("skopt",),
    "learner": ("gymnasium",),
}  # fmt: skip


@pytest.fixture(autouse=True)
def scripts(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.syspath_prepend(str(BASELINES))
    yield
    for name in NEEDS:
        sys.modules.pop(name, None)


def row(board: pigtail.Leaderboard, name: str) -> dict[str, Any]:
    found: dict[str, Any] = next(of for of in board["algorithms"] if of["name"] == name)
    return found


@pytest.mark.parametrize("name", NEEDS)
def test_a_baseline_brings_most_fibers_near(name: str) -> None:
    for needed in NEEDS[name]:
        pytest.importorskip(needed)
    entry = getattr(importlib.import_module(name), name)
    # Seeds that none of them was written with.
    board = pigtail.benchmark({name: entry}, task="peak", devices=4, seeds="held-out")
    theirs = row(board, name)
    assert theirs["faults"] == theirs["touched"] == 0 and theirs["offset_xy_um"]["p50"] < 0.3
    assert theirs["about"] and name not in board["algorithms"][-1]["raised"]
    if name != "bayes":
        again = pigtail.benchmark({name: entry}, task="peak", devices=4, seeds="held-out")
        assert again.json() == board.json()


def test_ours_is_what_it_is_elsewhere() -> None:
    board = pigtail.benchmark({}, devices=3, seeds=100)
    ours = row(board, "pigtail")
    seconds = []
    for seed in range(100, 103):
        twin = pigtail.BenchTwin(seed=seed)
        began = twin.now_s
        device = pigtail.align_bench(twin)
        assert device.aligned
        seconds.append((twin.now_s - began) / 3.0)
    assert ours["right"] == 9 and ours["wrong"] == ours["lost"] == 0
    assert ours["seconds_per_fiber"]["mean"] == pytest.approx(np.mean(seconds), abs=1e-6)
    low, high = ours["right_confidence"]
    assert low == pytest.approx(0.7008, abs=1e-3) and high == 1.0


def test_a_climb_becomes_a_device() -> None:
    from raster_climb import raster_climb

    board = pigtail.benchmark({"raster": raster_climb}, devices=2, seeds="held-out")
    theirs = row(board, "raster")
    assert board["seed"] == pigtail.HELD_OUT == 2**40
    assert (theirs["right"], theirs["wrong"], theirs["touched"]) == (6, 0, 0)
    assert board["algorithms"][0]["seconds_per_right_fiber"] <= board["algorithms"][1]["seconds_per_right_fiber"]
    assert "raster" in str(board) and "95 %" in str(board)


class Liar:
    """says that all is well, and does nothing"""

    def peak(self, bench: Bench, rig: pigtail.BenchRig) -> bool:
        return True

    def device(self, bench: Bench, rig: pigtail.BenchRig) -> list[bool]:
        return [True, True, True]


class Silent:
    """says nothing"""

    def device(self, bench: Bench, rig: pigtail.BenchRig) -> dict[str, bool]:
        return {}


class Sleeper:
    """lets time pass until it is up"""

    def device(self, bench: Bench, rig: pigtail.BenchRig) -> dict[str, bool]:
        while True:
            bench.next(math.inf)


class Pusher:
    """goes straight on into the chip"""

    def device(self, bench: Bench, rig: pigtail.BenchRig) -> dict[str, bool]:
        bench.until(bench.request(Load(0)))
        bench.until(bench.play(bench.caps.group("left.coarse"), Line(rig.pose_at(0, 0, 0.0) + Pose.um(z_um=30.0))))
        return {"input": True}


def test_what_is_said_is_held_against_the_truth() -> None:
    entries: dict[str, Any] = {"liar": Liar(), "silent": Silent(), "sleeper": Sleeper(), "pusher": Pusher()}
    board = pigtail.benchmark(entries, devices=2, limit_s=5.0, ours=False)
    counts = {
        of["name"]: [of[key] for key in ("right", "wrong", "touched", "faults", "lost")] for of in board["algorithms"]
    }
    assert counts["liar"] == [0, 6, 0, 0, 0]
    assert counts["silent"] == [0, 0, 0, 0, 6]
    assert counts["sleeper"] == [0, 0, 0, 6, 0]
    # The guard refuses it: it never moves.
    assert counts["pusher"] == [0, 0, 0, 0, 6]
    assert "touch the facet" in next(iter(row(board, "pusher")["raised"]))
    assert all(of["seconds_per_right_fiber"] is None for of in board["algorithms"])
    assert row(pigtail.benchmark({"liar": Liar()}, task="peak", devices=3), "liar")["wrong"] == 3


def test_the_truth_is_withheld() -> None:
    seen: list[Any] = []

    def curious(bench: Bench, rig: pigtail.BenchRig) -> dict[str, bool]:
        with pytest.raises(pigtail.InputError, match="accepted is"):
            pigtail.sim.truth(bench)  # type: ignore[arg-type]
        seen.append([name for name in dir(bench) if "truth" in name or "seed" in name or "twin" in name])
        seen.append(vars(bench))
        return {}

    pigtail.benchmark({"curious": curious}, devices=1, ours=False)
    assert seen == [[], {}]


def test_seeds_of_environments_are_none_that_are_held_out() -> None:
    gym = pytest.importorskip("pigtail.gym")
    many = gym.make_vec("Peak", 64)
    _, info = many.reset()
    assert info["seed"].max() < 2**32 < pigtail.HELD_OUT


def test_wrong_input_is_named() -> None:
    fine = pigtail.with_climb(lambda probe: probe.at_um)
    calls: list[tuple[Any, str]] = [
        (lambda: pigtail.benchmark({"a": fine}, task="sleep"), "task"),
        (lambda: pigtail.benchmark({"a": fine}, devices=0), "devices"),
        (lambda: pigtail.benchmark({"a": fine}, seeds="mine"), "seeds"),
        (lambda: pigtail.benchmark({"a": fine}, seeds=-1), "seeds"),
        (lambda: pigtail.benchmark({"a": fine}, seeds=2**64 - 1, devices=2), "seeds"),
        (lambda: pigtail.benchmark({"a": fine}, limit_s=float("nan")), "limit_s"),
        (lambda: pigtail.benchmark({"a": fine}, limit_s=0.0), "limit_s"),
        (lambda: pigtail.benchmark([fine]), "algorithms"),  # type: ignore[arg-type]
        (lambda: pigtail.benchmark({"a": 3}), "algorithms"),  # type: ignore[dict-item]
        (lambda: pigtail.benchmark({"pigtail": fine}), "algorithms"),
        (lambda: pigtail.benchmark({}, ours=False), "algorithms"),
        (lambda: pigtail.benchmark({"a": fine}, "afpm"), "kind"),
        (lambda: pigtail.benchmark({"a": lambda bench, rig: "well"}, devices=1), "report"),  # type: ignore[dict-item, return-value]
        (lambda: pigtail.benchmark({"a": lambda bench, rig: {"out3": True}}, devices=1), "report"),
        (lambda: pigtail.benchmark({"a": lambda bench, rig: [True] * 4}, devices=1), "report"),
        # A word is no verdict, whatever it says.
        (lambda: pigtail.benchmark({"a": lambda bench, rig: {"input": "no"}}, devices=1), "report"),  # type: ignore[dict-item]
        (lambda: pigtail.with_climb(3), "climb"),  # type: ignore[arg-type]
        (lambda: pigtail.benchmark({"a": pigtail.with_climb(lambda probe: (float("nan"), 0.0))}, task="peak"), "x_um"),
    ]
    for call, key in calls:
        with pytest.raises(pigtail.InputError) as raised:
            call()
        assert raised.value.key == key or key in str(raised.value)

    def broken(probe: pigtail.Probe) -> tuple[float, float]:
        raise ZeroDivisionError("my own mistake")

    with pytest.raises(ZeroDivisionError, match="my own"):
        pigtail.benchmark({"a": pigtail.with_climb(broken)}, task="peak", devices=1)


NO_TORCH = "stable-baselines3 is not installed, or its torch is not: training is not tested here"


def test_a_learner_trains_unmodified() -> None:
    """A few steps of stable-baselines3 as it comes, on each task as it comes."""
    sb3 = pytest.importorskip("stable_baselines3", reason=NO_TORCH)
    from stable_baselines3.common.env_checker import check_env

    gym = pytest.importorskip("pigtail.gym")
    for task in gym.TASKS:
        # A warning would be of spaces that its policies do badly with.
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            check_env(gym.BenchEnv(task))
        model = sb3.PPO("MlpPolicy", f"pigtail/{task}-v0", n_steps=64, batch_size=32, device="cpu", seed=1)
        model.learn(128)
        assert model.num_timesteps == 128
    model = sb3.SAC("MlpPolicy", "pigtail/Peak-v0", learning_starts=32, buffer_size=256, device="cpu", seed=1)
    model.learn(64)
    assert model.num_timesteps == 64


def test_the_script_of_the_learner_trains_what_is_played(tmp_path: Path) -> None:
    """Two updates: a policy and a curve are written, and what is written plays."""
    pytest.importorskip("stable_baselines3", reason=NO_TORCH)
    script = [sys.executable, str(BASELINES / "train_learner.py"), "--steps", "8192", "--into", str(tmp_path)]
    done = subprocess.run(script, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    head, *rows = (tmp_path / "learner.csv").read_text().splitlines()
    assert head == "steps,light_v,beside_um,processor_s,right" and rows
    policy = importlib.import_module("learner").Policy(tmp_path / "learner.npz")
    kept = importlib.import_module("learner").Policy()
    seen = np.zeros(14, dtype=np.float32)
    assert policy(seen).shape == kept(seen).shape == (2,)
    assert not np.array_equal(policy(seen), kept(seen))
