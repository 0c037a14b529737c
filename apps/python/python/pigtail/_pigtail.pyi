"""Arguments in, JSON and arrays out. What users call is in the modules beside this one."""

from os import PathLike
from typing import Any, Callable, Sequence, final

import numpy as np
from numpy.typing import NDArray

_Path = str | PathLike[str]
_Progress = Callable[[int, int, str], object] | None
_Floats = NDArray[np.float64]
_Tip = tuple[float, float, float]

__version__: str
CHANNELS: tuple[str, ...]
SIDES: tuple[str, ...]

@final
class Belief:
    def __new__(cls, name: str, text: str, weights: list[tuple[str, str]]) -> Belief: ...
    def parts(self) -> tuple[str, str, list[tuple[str, str]]]: ...
    def files(self) -> list[tuple[str, str]]: ...
    def write(self, folder: _Path) -> None: ...

@final
class Rig:
    def __new__(
        cls,
        rig: str,
        recipe: str,
        fleet: str,
        calibration: str | None,
        scenario: str,
        axes: Sequence[_Path],
        runs: _Path,
    ) -> Rig: ...
    def with_belief(self, belief: Belief) -> Rig: ...
    @property
    def name(self) -> str: ...
    @property
    def recipe(self) -> str: ...
    @property
    def fleet(self) -> str: ...
    @property
    def scenario(self) -> str: ...
    @property
    def has_twin(self) -> bool: ...
    @property
    def rate_hz(self) -> float: ...
    @property
    def hashes(self) -> list[tuple[str, str]]: ...
    def sources(self) -> list[tuple[str, str]]: ...
    def truth(self) -> tuple[str, str] | None: ...
    def runs_on(self) -> str: ...
    def belief(self) -> Belief: ...

@final
class Command:
    def __new__(
        cls,
        motors_v: _Floats | None,
        micro_v: _Floats | None,
        laser: bool,
        fiber: Sequence[tuple[str, int] | None],
        references_counts: _Floats | None,
    ) -> Command: ...

@final
class Measurement:
    @property
    def time_s(self) -> float: ...
    @property
    def encoders_counts(self) -> NDArray[np.int64]: ...
    @property
    def light(self) -> tuple[float, _Floats] | None: ...
    @property
    def vision(self) -> tuple[float, list[_Tip | None], _Tip] | None: ...
    @property
    def probes_um(self) -> _Floats | None: ...
    @property
    def stop(self) -> bool: ...

@final
class Twin:
    def __new__(cls, rig: Rig, seed: int, fault: Sequence[str]) -> Twin: ...
    def exchange(self, command: Command) -> Measurement: ...
    def stop(self) -> None: ...
    @property
    def period_s(self) -> float: ...
    def truth(self) -> dict[str, Any]: ...

_Pose = tuple[float, ...]
_Law = tuple[str, Any]
_Event = tuple[str, list[tuple[float, list[float]]], int, str]

@final
class BenchRig:
    def __new__(cls, rig: str, recipe: str, calibration: _Path | None) -> BenchRig: ...
    @property
    def name(self) -> str: ...
    @property
    def recipe(self) -> str: ...
    @property
    def has_twin(self) -> bool: ...
    @property
    def hashes(self) -> list[tuple[str, str]]: ...
    def runs_on(self) -> str: ...
    def caps(self) -> Any: ...
    def taught(self) -> list[tuple[int, int, list[float], float, float, float]]: ...
    def meters(self) -> list[int]: ...
    def gaps(self) -> tuple[float, float]: ...
    def width(self, gap: float) -> float: ...
    def pose_at(self, arm: int, port: int, gap: float) -> list[float]: ...

@final
class BenchTwin:
    def __new__(cls, rig: BenchRig, seed: int) -> BenchTwin: ...
    def caps(self) -> Any: ...
    def now(self) -> float: ...
    def play(self, group: int, law: _Law) -> int: ...
    def bend(self, ticket: int, law: _Law) -> float: ...
    def request(self, what: tuple[str, int, int]) -> int: ...
    def next(self, by: float) -> _Event: ...
    def pose(self, group: int, at: float) -> tuple[list[float], bool] | None: ...
    def reaches(self, group: int, pose: _Pose) -> bool: ...
    def stop(self) -> None: ...
    def truth(self) -> dict[str, Any]: ...

@final
class Environments:
    def __new__(
        cls,
        rig: BenchRig,
        count: int,
        gap: float,
        axes: Sequence[tuple[int, int, float, float]],
        most: float,
        limit: float,
        found: float | None,
    ) -> Environments: ...
    def reset(self, seeds: Sequence[int]) -> NDArray[np.float32]: ...
    def step(
        self, actions: NDArray[np.float32], seeds: Sequence[int]
    ) -> tuple[NDArray[np.float32], _Floats, NDArray[np.bool_], NDArray[np.bool_]]: ...

def wilson(hits: int, trials: int) -> tuple[float, float] | list[float]: ...
def identify_servo(
    data: _Path,
    position: str,
    voltage: str,
    force_per_volt: float,
    time: str | None,
    reference: str | None,
    rate: float | None,
    validate: _Path | None,
    friction: str,
    injected: str | None,
    method: str | None,
    cutoff: float | None,
    gear_ratio: float | None,
    lead: float | None,
    counts_per_turn: int | None,
    voltage_limit: float | None,
    date: str,
    progress: _Progress,
) -> tuple[str, str, dict[str, _Floats], str | None]: ...
def align_bench(bench: object, rig: BenchRig, progress: _Progress) -> tuple[str, dict[str, Any]]: ...
def peak_on(
    bench: object,
    rig: BenchRig,
    group: int,
    meter: int,
    gap: float,
    dark: float | None,
    progress: _Progress,
) -> tuple[float, float, float, float]: ...

@final
class Spec:
    def __new__(
        cls,
        rig: Rig,
        procedure: str,
        seed: int,
        devices: int,
        machines: int | None,
        commissioned: bool,
        faults: str | None,
    ) -> Spec: ...
    def folder(self, runs: _Path) -> str: ...
    def run(self, runs: _Path, threads: int, progress: _Progress) -> tuple[str, str]: ...

def align(
    rig: Rig,
    procedure: str,
    seed: int,
    device: int,
    faults: str | None,
    fault: Sequence[str],
    progress: _Progress,
) -> tuple[str, str, dict[str, Any]]: ...
def tune(
    rig: Rig,
    axis_name: str,
    seed: int,
    search: str,
    trials: int | None,
    step: int | None,
    progress: _Progress,
) -> tuple[str, dict[str, _Floats], Belief | None]: ...
def identify(
    rig: Rig, axis_name: str, seed: int, model: str, progress: _Progress
) -> tuple[str, dict[str, _Floats], Belief | None]: ...
def characterize(
    rig: Rig,
    axis_name: str,
    what: str,
    seed: int,
    size: int | None,
    frequency_hz: float | None,
    steps: int,
    progress: _Progress,
) -> tuple[str, dict[str, _Floats], Belief | None]: ...
def commission(
    rig: Rig, seed: int, steps: Sequence[str], devices: int, progress: _Progress
) -> tuple[str, Belief | None]: ...
def produce(
    rig: Rig,
    tray: str,
    seed: int,
    commission_in: _Path | None,
    track: bool | None,
    precompensate: bool | None,
    progress: _Progress,
) -> tuple[str, list[str]]: ...
def produce_trays(
    rig: Rig,
    tray: str,
    seed: int,
    asked: int,
    threads: int,
    commission_in: _Path | None,
    track: bool | None,
    precompensate: bool | None,
    progress: _Progress,
) -> tuple[str, list[str]]: ...
def simulate_joint(
    params: _Path | tuple[str],
    axis_name: str,
    voltages: tuple[Sequence[float], Sequence[float]] | None,
    impulse: Sequence[float] | None,
    step: float | None,
    triangle: Sequence[float] | None,
    duration_s: float | None,
    row_period_s: float | None,
    max_step_s: float,
    progress: _Progress,
) -> dict[str, _Floats]: ...
def campaign_resume(folder: _Path, threads: int, progress: _Progress) -> tuple[str, str]: ...
def campaign_shard(
    folder: _Path, index: int, of: int, threads: int, progress: _Progress
) -> tuple[str | None, int]: ...
def campaign_merge(folder: _Path, runs: _Path, progress: _Progress) -> tuple[str, str]: ...
def runs_list(runs: _Path) -> str: ...
def runs_show(runs: _Path, run: str) -> str: ...
