"""Environments of gymnasium over benches; needs ``pip install pigtail[gym]``.

>>> import gymnasium, pigtail.gym
>>> env = gymnasium.make("pigtail/Peak-v0")
>>> seen, info = env.reset(seed=7)

====================== ==========================================================================================
``pigtail/FirstLight-v0`` both fine groups look for light at a gap of 5 um, at which fibers are attached
``pigtail/Peak-v0``       the right arm's fine group climbs, at a gap of 40 um
``pigtail/Approach-v0``   from 114 um on its coarse group closes the gap along the beam too, to 5 um
====================== ==========================================================================================

**An episode.** Both arms take their fibers, the dark is measured, the laser goes on, the arms stand on the beam as it was
taught, some micrometres (4 um, rms, in x and in y) beside where it is. It ends with the task, with a fault of the bench, or when its
machine time is up.

**An action** is how far each axis goes from where it was told to be, micrometres, ``float32``, shape ``(axes,)``; it is played as a
line, and the step ends with the next sample of the meter, 10 ms later, which may find it still on its way.

**An observation** is what a bench measures, ``float32``, shape ``(2 + 2 * axes,)``: the light (volts, the dark not
taken off), where each axis is told to be and where it is measured to be from its start (micrometres), and the machine
time that is left (seconds).

**The reward** of peak and approach is the light above the dark (volts) times the share of the machine time that the step
took: a return is the mean light over the time. That of first light is 1 when there is light, less the share of the time.

A seed is the twin's; :func:`make_vec` has many environments in Rust, the same to the last bit. Truth is not part of it: see
:func:`pigtail.sim.truth` of ``env.unwrapped.bench``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

try:
    import gymnasium
    from gymnasium import spaces
    from gymnasium.utils import seeding
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space
except ImportError as error:  # pragma: no cover
    raise ImportError("pigtail.gym needs gymnasium: pip install 'pigtail[gym]'") from error

from . import _pigtail
from ._bench import BenchRig, BenchTwin, bench_rig
from ._errors import FaultError, InputError, Refused
from ._input import flag, number, whole
from .bench import DEGREES, Bench, Caps, Laser, Light, Line, Load, Pose

if TYPE_CHECKING:
    from numpy.typing import NDArray

    _Floats = NDArray[np.float32]
    _Env = gymnasium.Env[_Floats, _Floats]
    _Vector = VectorEnv[_Floats, _Floats, NDArray[Any]]
else:
    _Env, _Vector = gymnasium.Env, VectorEnv

_RUN_UP_M = 40e-6
_REMEMBERED = 5


def _wrong(key: str, value: object, accepted: str) -> InputError:
    return InputError(f"{key}: is {value!r}; accepted is {accepted}", key=key, value=repr(value))


@dataclass(frozen=True)
class Axis:
    """An axis of an action.

    Raises:
        InputError: For what is no axis.
    """

    arm: int
    fine: bool
    degree: str
    """``x`` or ``y``; or ``beam``, towards the chip along the beam as it was taught, by its z: never nearer than the gap at
    which fibers are attached."""
    low_um: float
    """Lowest place from where it stands at the start, micrometres."""
    high_um: float
    """Highest."""

    def __post_init__(self) -> None:
        whole("arm", self.arm, 0, 1)
        flag("fine", self.fine)
        if self.degree not in ("x", "y", "beam"):
            raise _wrong("degree", self.degree, "one of 'x', 'y' and 'beam'")
        for key, value, endless in (("low_um", self.low_um, -math.inf), ("high_um", self.high_um, math.inf)):
            if value != endless or self.degree != "beam":
                number(key, value)
        if not self.low_um <= self.high_um:
            raise _wrong("low_um", self.low_um, f"up to `high_um`, {self.high_um!r}")


@dataclass(frozen=True)
class Task:
    """What an environment asks for.

    Raises:
        InputError: For what is no task.
    """

    name: str
    axes: tuple[Axis, ...]
    gap_um: float | None
    """Gap at which it begins, micrometres; ``None``: that at which light is searched for."""
    most_um: float
    """Farthest way of an axis in a step, micrometres."""
    limit_s: float
    """Machine time, seconds."""
    found_v: float | None = None
    """Light above the dark that ends it, volts."""

    def __post_init__(self) -> None:
        if not isinstance(self.axes, tuple) or not self.axes or not all(isinstance(axis, Axis) for axis in self.axes):
            raise _wrong("axes", self.axes, "a tuple of one or more of pigtail.gym.Axis")
        for key, value in (("gap_um", self.gap_um), ("most_um", self.most_um), ("limit_s", self.limit_s), ("found_v", self.found_v)):
            if value is None and key in ("gap_um", "found_v"):
                continue
            if number(key, value) <= 0.0:
                raise _wrong(key, value, "more than zero")

    def gap_m(self, rig: BenchRig) -> float:
        """Gap at the start, metres."""
        return rig.search_gap_m if self.gap_um is None else 1e-6 * self.gap_um

    def range_um(self, axis: Axis, rig: BenchRig) -> tuple[float, float]:
        """Lowest and highest place of an axis from where it stands at the start, micrometres."""
        if axis.degree != "beam":
            return axis.low_um, axis.high_um
        high_um = min(axis.high_um, 1e6 * (self.gap_m(rig) - rig.gap_m))
        if axis.low_um > high_um:
            raise _wrong("low_um", axis.low_um, f"at most {high_um:g}, where the gap is that at which fibers are attached")
        return axis.low_um, high_um


def _degree(axis: Axis) -> int:
    return DEGREES.index("z" if axis.degree == "beam" else axis.degree)


def _fine(arm: int) -> tuple[Axis, ...]:
    return tuple(Axis(arm, True, degree, -10.0, 10.0) for degree in "xy")


FIRST_LIGHT = Task("FirstLight", _fine(0) + _fine(1), gap_um=5.0, most_um=1.0, limit_s=20.0, found_v=0.02)
"""Light of 20 mV (that of the shipped bench is 4 V at most; 2 mV are scattered) within 20 s, of four axes."""
PEAK = Task("Peak", _fine(1), gap_um=40.0, most_um=1.0, limit_s=10.0)
"""Two axes, 10 s. Farther back what is scattered is brighter than what is guided, and the light's peak another."""
APPROACH = Task("Approach", (*_fine(1), Axis(1, False, "beam", -100.0, math.inf)), gap_um=None, most_um=1.0, limit_s=20.0)
"""Three axes, 20 s."""
TASKS = {task.name: task for task in (FIRST_LIGHT, PEAK, APPROACH)}
"""The tasks by name."""


def _spaces(task: Task) -> tuple[Any, Any]:
    count = len(task.axes)
    seen = np.full(2 + 2 * count, np.inf, dtype=np.float32)
    most = np.full(count, task.most_um, dtype=np.float32)
    return spaces.Box(-seen, seen, dtype=np.float32), spaces.Box(-most, most, dtype=np.float32)


def _place(caps: Caps, arm: int, fine: bool) -> int:
    for place, group in enumerate(caps.groups):
        if (group.arm, group.fine) == (arm, fine):
            return place
    raise InputError(f"bench: has no such group: arm {arm}, fine {fine}", key="bench", value=caps.name)


def _group(bench: Bench, arm: int, fine: bool) -> int:
    return _place(bench.caps, arm, fine)


class BenchEnv(_Env):
    """One environment, over any bench: it drives it by hand, as you would.

    Args:
        task: The task, or its name.
        rig: What is believed; ``bench-piezo`` if not given.
        bench: What makes the bench of an episode from its seed, such as a class of your own over your hardware; the rig's
            twin if not given.
        limit_s: Machine time of an episode, seconds; the task's if not given.
        begin: What brings a bench to where an episode begins, and returns the dark in volts; :func:`prepare` if not given. A bench
            that carries its fibers already needs no more than the dark: :func:`dark`.

    Attributes:
        bench: The bench of this episode.
    """

    metadata = {"render_modes": []}

    def __init__(
        self,
        task: Task | str = "Peak",
        rig: BenchRig | str | None = None,
        *,
        bench: Callable[[int], Bench] | None = None,
        limit_s: float | None = None,
        begin: Callable[[Bench, BenchRig, float], float] | None = None,
        render_mode: str | None = None,
    ) -> None:
        self.task = _task(task)
        for key, make in (("bench", bench), ("begin", begin)):
            if make is not None and not callable(make):
                raise _wrong(key, make, "a function, or None")
        self.limit_s = _limit(self.task, limit_s)
        self.rig = bench_rig(rig)
        self._make: Callable[[int], Bench] = bench if bench is not None else lambda seed: BenchTwin(self.rig, seed)
        self.observation_space, self.action_space = _spaces(self.task)
        self._begin = prepare if begin is None else begin
        self.render_mode = render_mode
        self.bench: Bench | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[_Floats, dict[str, Any]]:
        """Begins an episode: on the twin of this seed, or of one that is drawn from the last. ``info["seed"]`` says which."""
        super().reset(seed=seed)
        drawn = seed if seed is not None else int(self.np_random.integers(2**32))
        bench = self.bench = self._make(drawn)
        self._channel = self.rig.meters[0]
        self._dark_v = self._begin(bench, self.rig, self.task.gap_m(self.rig))
        self._light_v = bench.light(self._channel).volts[self._channel]
        self._began_s = bench.now_s
        self._told_um = [0.0] * len(self.task.axes)
        self._ranges_um = [self.task.range_um(axis, self.rig) for axis in self.task.axes]
        self._groups = [_group(bench, axis.arm, axis.fine) for axis in self.task.axes]
        self._origin: dict[int, Pose] = {}
        for axis, group in zip(self.task.axes, self._groups):
            at = Pose() if axis.fine else self.rig.pose_at(axis.arm, 0, self.task.gap_m(self.rig))
            self._origin[group] = at
        return self._seen(), {"seed": drawn, "dark_v": self._dark_v}

    def step(self, action: _Floats) -> tuple[_Floats, float, bool, bool, dict[str, Any]]:
        """Lets the axes go, and the meter sample."""
        bench = self.bench
        if bench is None:
            raise gymnasium.error.ResetNeeded("reset comes first")
        by = _array("action", action, self.action_space)
        if by.shape != self.action_space.shape or not np.isfinite(by).all():
            message = f"action: is {action!r}; accepted are {len(self.task.axes)} finite numbers"
            raise InputError(message, key="action", value=repr(action))
        info: dict[str, Any] = {}
        before_s = bench.now_s
        wanted = []
        for (low, high), told, way in zip(self._ranges_um, self._told_um, by):
            moved = told + min(max(float(way), -self.task.most_um), self.task.most_um)
            wanted.append(min(max(moved, low), high))
        for group in sorted(self._origin):
            places = [place for place, of in enumerate(self._groups) if of == group]
            to = self._origin[group]
            along = [place for place in places if self.task.axes[place].degree == "beam"]
            for place in along:
                arm = self.task.axes[place].arm
                to = self.rig.pose_at(arm, 0, self.task.gap_m(self.rig) - 1e-6 * wanted[place])
            numbers = list(to.numbers)
            for place in places:
                if place not in along:
                    numbers[_degree(self.task.axes[place])] += 1e-6 * wanted[place]
            try:
                bench.play(group, Line(Pose(*numbers)))
            except Refused as refused:
                info["refused"] = refused.message
                continue
            for place in places:
                self._told_um[place] = wanted[place]
        stopped = found = False
        try:
            self._light_v = bench.light(self._channel).volts[self._channel]
            least = self.task.found_v
            found = least is not None and self._light_v - self._dark_v >= least
        except FaultError as fault:
            stopped, info["fault"] = True, fault
        took = (bench.now_s - before_s) / self.limit_s
        if self.task.found_v is not None:
            reward = float(found) - took
        else:
            reward = 0.0 if stopped else (self._light_v - self._dark_v) * took
        truncated = bench.now_s - self._began_s >= self.limit_s
        return self._seen(), reward, stopped or found, truncated, info

    def _seen(self) -> _Floats:
        bench = self.bench
        assert bench is not None
        now = bench.now_s
        measured = []
        for axis, group in zip(self.task.axes, self._groups):
            degree = _degree(axis)
            known = bench.pose(group, now)
            at = math.nan if known is None else known.pose.numbers[degree]
            measured.append(1e6 * (at - self._origin[group].numbers[degree]))
        left = self.limit_s - (now - self._began_s)
        return np.array([self._light_v, *self._told_um, *measured, left], dtype=np.float32)

    def close(self) -> None:
        """Stops the bench."""
        if self.bench is not None:
            self.bench.stop()


def prepare(bench: Bench, rig: BenchRig, gap_m: float) -> float:
    """Both arms take their fibers and stand on the beam at a gap, metres, as it was taught; the laser is on. Returns the
    dark, volts. So an episode begins; by hand it is the same."""
    tickets = [bench.request(Load(0)), bench.request(Load(1)), bench.request(Laser(False))]
    level = _dark(bench.until(*tickets), rig)
    bench.until(bench.request(Laser(True)))
    for below_m, times in ((_RUN_UP_M, 2.0), (0.0, 1.0)):
        tickets = []
        for arm in range(2):
            at = rig.pose_at(arm, 0, times * gap_m)
            tickets.append(bench.play(_group(bench, arm, False), Line(at + Pose(y_m=-below_m))))
        bench.until(*tickets)
    return level


def dark(bench: Bench, rig: BenchRig, gap_m: float = 0.0) -> float:
    """The dark alone, volts, of a bench that is where an episode begins; the laser is on afterwards."""
    bench.until(bench.request(Laser(False)))
    lights = [bench.light(rig.meters[0]) for _ in range(_REMEMBERED + 20)]
    bench.until(bench.request(Laser(True)))
    for _ in range(_REMEMBERED):
        bench.light(rig.meters[0])
    return _dark(lights, rig)


def _dark(lights: list[Light], rig: BenchRig) -> float:
    """The mean of light without the laser, volts, but for what the meter remembers."""
    channel = rig.meters[0]
    volts = [light.volts[channel] for light in lights[_REMEMBERED:]]
    volts = [each for each in volts if not math.isnan(each)]
    total = 0.0
    for each in volts:
        total += each
    return total / len(volts)


def _task(task: Task | str) -> Task:
    if isinstance(task, Task):
        return task
    if not isinstance(task, str) or task not in TASKS:
        raise InputError(f"task: is {task!r}; accepted is one of {list(TASKS)}", key="task", value=repr(task))
    return TASKS[task]


def _array(name: str, value: Any, space: Any) -> _Floats:
    try:
        # What is too large to be held is infinite, and refused as that.
        with np.errstate(over="ignore"):
            return np.asarray(value, dtype=np.float32)
    except (TypeError, ValueError):
        message = f"{name}: is no array of shape {space.shape}"
        raise InputError(message, key=name, value=repr(value)) from None


def _limit(task: Task, limit_s: float | None) -> float:
    if limit_s is None:
        return task.limit_s
    seconds = number("limit_s", limit_s)
    if seconds <= 0.0:
        message = f"limit_s: is {limit_s!r}; accepted are more than 0 s"
        raise InputError(message, key="limit_s", value=repr(limit_s))
    return seconds


class BenchVectorEnv(_Vector):
    """Many environments over twins, in Rust: one call steps all, on all cores, without Python's lock. Each is
    :class:`BenchEnv` to the last bit. What has ended begins anew with the next step (``AutoresetMode.NEXT_STEP``).

    Args:
        num_envs: How many.
        task: The task, or its name.
        rig: The rig; ``bench-piezo`` if not given.
        limit_s: Machine time of an episode, seconds; the task's if not given.
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        num_envs: int = 1,
        task: Task | str = "Peak",
        rig: BenchRig | str | None = None,
        *,
        limit_s: float | None = None,
        render_mode: str | None = None,
    ) -> None:
        self.task, self.rig = _task(task), bench_rig(rig)
        self.num_envs = whole("num_envs", num_envs, 1, 2**20)
        self.render_mode = render_mode
        limit = _limit(self.task, limit_s)
        caps = self.rig.caps
        axes = []
        for axis in self.task.axes:
            group = _place(caps, axis.arm, axis.fine)
            axes.append((group, _degree(axis), *self.task.range_um(axis, self.rig)))
        gap, found = self.task.gap_m(self.rig), self.task.found_v
        self._all = _pigtail.Environments(self.rig._rig, self.num_envs, gap, axes, self.task.most_um, limit, found)
        self.single_observation_space, self.single_action_space = _spaces(self.task)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._draws: list[np.random.Generator] = []
        self._over = np.zeros(self.num_envs, dtype=bool)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[_Floats, dict[str, Any]]:
        """Begins all: environment ``i`` with ``seed + i``, or with its own of a list."""
        seeds: list[int | None]
        if seed is None:
            seeds = [None] * self.num_envs
        elif isinstance(seed, (list, tuple)):
            seeds = [None if of is None else whole("seed", of) for of in seed]
        else:
            first = whole("seed", seed, 0, 2**64 - self.num_envs)
            seeds = [first + k for k in range(self.num_envs)]
        if len(seeds) != self.num_envs:
            message = f"seed: has {len(seeds)} of them; accepted are {self.num_envs}"
            raise InputError(message, key="seed", value=str(len(seeds)))
        fresh = not self._draws
        drawn = []
        for k, of in enumerate(seeds):
            if fresh:
                self._draws.append(seeding.np_random(of)[0])
            elif of is not None:
                self._draws[k] = seeding.np_random(of)[0]
            drawn.append(self._draw(k) if of is None else of)
        self._over[:] = False
        return self._all.reset(drawn), {"seed": np.array(drawn, dtype=np.uint64)}

    def _draw(self, k: int) -> int:
        return int(self._draws[k].integers(2**32))

    def step(
        self, actions: _Floats
    ) -> tuple[_Floats, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """A step of all; of shape ``(num_envs, axes)`` in micrometres."""
        over = self._over
        seeds = [0] * self.num_envs
        for k in np.flatnonzero(over):
            seeds[k] = self._draw(int(k))
        by = _array("actions", actions, self.action_space)
        if by.shape != self.action_space.shape:
            message = f"actions: has the shape {by.shape}; accepted is {self.action_space.shape}"
            raise InputError(message, key="actions", value=repr(by.shape))
        seen, reward, terminated, truncated = self._all.step(by, seeds)
        self._over = terminated | truncated
        info: dict[str, Any] = {"seed": np.array(seeds, dtype=np.uint64), "_seed": over.copy()} if over.any() else {}
        return seen, reward, terminated, truncated, info


def make_vec(task: Task | str = "Peak", num_envs: int = 1, **arguments: Any) -> BenchVectorEnv:
    """Many environments in Rust; see :class:`BenchVectorEnv`. ``gymnasium.make_vec("pigtail/Peak-v0", num_envs=64,
    vectorization_mode="vector_entry_point")`` makes the same."""
    return BenchVectorEnv(num_envs, task, **arguments)


for _each in TASKS.values():
    _kwargs = {"task": _each.name}
    gymnasium.register(
        f"pigtail/{_each.name}-v0",
        entry_point="pigtail.gym:BenchEnv",
        vector_entry_point="pigtail.gym:BenchVectorEnv",
        kwargs=_kwargs,
    )

__all__ = ["APPROACH", "FIRST_LIGHT", "PEAK", "TASKS", "Axis", "BenchEnv", "BenchVectorEnv", "Task", "dark", "make_vec", "prepare"]
