"""The leaderboard's learner: the policy that ``train_learner.py`` trained on ``pigtail/Peak-v0``, by numpy alone.

It plays steps of the environment for two seconds, goes to the mean of where it was in the last second of them, and says that this is the
peak where there is light and it is within reach.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import pigtail
import pigtail.gym as gym
from pigtail.bench import Line, Pose

POLICY = Path(__file__).with_name("learner.npz")
REMEMBERED, CLOCK, SAID = 17, 8, 96
"""Steps that the peak is fitted to, of a turn of the clock, and whose mean is said in the end."""

Floats = NDArray[np.float32]
if TYPE_CHECKING:
    _Wrapper = gymnasium.Wrapper[Floats, Floats, Floats, Floats]
else:
    _Wrapper = gymnasium.Wrapper


class Relative(_Wrapper):
    """What does not depend on how bright the peak is, nor on where: where the peak would be from here by the last readings, and how well
    those tell it; where the last turn's mean was; how far it still has to go; the last move; and a clock to circle by. The logarithm
    of a Gaussian whose width is known is a parabola whose place is found by linear regression, if the readings lie around
    something: light at one place tells nothing of where the peak is, so an agent has to move in order to see.

    Args:
        env: An environment of the task Peak.
        reward: What a step is worth; what the environment says if not given. It is for training: a policy never sees it.
    """

    def __init__(self, env: Any, reward: Callable[[Any], float] | None = None) -> None:
        super().__init__(env)
        wide = np.full(14, 20.0, dtype=np.float32)
        self.observation_space = gymnasium.spaces.Box(-wide, wide, dtype=np.float32)
        task, rig = env.unwrapped.task, env.unwrapped.rig
        self._width_um, self._worth = rig.width_um(1e6 * task.gap_m(rig)), reward

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Floats, dict[str, Any]]:
        seen, info = self.env.reset(seed=seed, options=options)
        self._dark_v, self._steps = info["dark_v"], 0
        self._past = deque([self._row(seen)] * (REMEMBERED + 1), maxlen=REMEMBERED + 1)
        return self._features(seen), info

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        seen, reward, terminated, truncated, info = self.env.step(action)
        self._past.append(self._row(seen))
        self._steps += 1
        worth = float(reward) if self._worth is None else self._worth(self.env.unwrapped)
        return self._features(seen), worth, terminated, truncated, info

    def _row(self, seen: Floats) -> tuple[float, float, float]:
        light = max(float(seen[0]) - self._dark_v, 2e-4)
        return float(seen[3]), float(seen[4]), float(np.log(light))

    def _features(self, seen: Floats) -> Floats:
        past = np.array(self._past)
        # A sample is heard of some milliseconds after it was taken, on the way.
        places, levels = 0.5 * (past[1:, :2] + past[:-1, :2]) - past[-1, :2], past[1:, 2]
        # ln(light) + |place|^2 / w^2 = constant + 2 place . peak / w^2
        square = self._width_um**2
        bowl = levels + (places**2).sum(axis=1) / square
        mean = places.mean(axis=0)
        about = 2.0 * (places - mean) / square
        information = about.T @ about
        # So little that only readings at one place are held to it: their peak is where they are.
        ridge = 1e-4 * np.eye(2)
        peak = mean + np.linalg.solve(information + ridge, about.T @ (bowl - bowl.mean()) - information @ mean)
        told = np.log10(np.diag(information) + 1e-5) + 2.0
        turn = past[-CLOCK:, :2].mean(axis=0) - past[-1, :2]
        clock = 2.0 * np.pi * self._steps / CLOCK
        circle = [np.cos(clock), np.sin(clock)]
        moved = past[-1, :2] - past[-2, :2]
        near = 4.0 * (peak - turn)
        of = [np.clip(peak, -10.0, 10.0) / 2.0, np.clip(near, -3.0, 3.0), told, turn, seen[1:3] - seen[3:5], moved, circle]
        return np.concatenate(of).astype(np.float32)


class Policy:
    """A network of two hidden layers, from what :class:`Relative` sees to the action's mean."""

    def __init__(self, path: Path = POLICY) -> None:
        with np.load(path) as of:
            self._of = {name: of[name] for name in of.files}

    def __call__(self, seen: Floats) -> Floats:
        """The action, micrometres an axis."""
        of = self._of
        x = np.tanh(of["w1"] @ seen + of["b1"])
        x = np.tanh(of["w2"] @ x + of["b2"])
        action: Floats = np.clip(of["w3"] @ x + of["b3"], -1.0, 1.0).astype(np.float32)
        return action


class Learner:
    """learned by PPO (stable-baselines3) on pigtail/Peak-v0: two seconds of its steps, and the mean of the last of them"""

    def __init__(self, path: Path = POLICY, steps: int = 200) -> None:
        self._policy, self._steps = Policy(path), steps

    def peak(self, bench: pigtail.Bench, rig: pigtail.BenchRig) -> bool:
        """The peak task: what it sees and does is what the environment has."""
        env = Relative(gym.BenchEnv("Peak", rig, bench=lambda _: bench, begin=gym.dark))
        seen, info = env.reset(seed=0)
        places = []
        for _ in range(self._steps):
            seen, _, over, out_of_time, _ = env.step(self._policy(seen))
            at = bench.pose(bench.caps.group("right.fine"), bench.now_s)
            if over or out_of_time or at is None:
                return False
            places.append(at.pose.xyz_um[:2])
        x, y = np.mean(places[-SAID:], axis=0)
        bench.until(bench.play(bench.caps.group("right.fine"), Line(Pose.um(float(x), float(y)))))
        light = bench.light(rig.meters[0]).volts[rig.meters[0]] - info["dark_v"]
        return bool(light > 0.005 and max(abs(x), abs(y)) < 9.7)


learner = Learner() if POLICY.exists() else None

if __name__ == "__main__":
    print(pigtail.benchmark({"learner": Learner()}, task="peak"))
