"""The leaderboard's learner: the policy that ``train_learner.py`` trained on ``pigtail/Peak-v0``, by numpy alone.

It plays steps of the environment for two seconds, goes to the mean of where it was in the second of them, and says that this is the
peak where there is light and it is within reach.
"""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import pigtail
import pigtail.gym as gym
from pigtail.bench import Line, Pose

POLICY = Path(__file__).with_name("learner.npz")
REMEMBERED, SHOWN, CLOCK = 17, 4, 8
"""Steps that the plane is fitted to, that are seen as they are, and of a turn of the clock."""

Floats = NDArray[np.float32]
if TYPE_CHECKING:
    _Wrapper = gymnasium.Wrapper[Floats, Floats, Floats, Floats]
else:
    _Wrapper = gymnasium.Wrapper


class Relative(_Wrapper):
    """What does not depend on how bright the peak is, nor on where: the last places from where it is now, the logarithm of their
    light over that of now, how far it still has to go, how far the peak would be by the slope of a plane through them, and a
    clock to circle by. The reward is how the logarithm of the light grows, less what is missing to the brightest so far."""

    def __init__(self, env: Any) -> None:
        super().__init__(env)
        wide = np.full(3 * SHOWN + 6, 20.0, dtype=np.float32)
        self.observation_space = gymnasium.spaces.Box(-wide, wide, dtype=np.float32)
        task, rig = env.unwrapped.task, env.unwrapped.rig
        self._width_um = rig.width_um(1e6 * task.gap_m(rig))

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Floats, dict[str, Any]]:
        seen, info = self.env.reset(seed=seed, options=options)
        self._dark_v, self._steps = info["dark_v"], 0
        self._past = deque([self._row(seen)] * REMEMBERED, maxlen=REMEMBERED)
        self._best = self._past[-1][2]
        return self._features(seen), info

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        seen, _, terminated, truncated, info = self.env.step(action)
        before, now = self._past[-1][2], self._row(seen)
        self._past.append(now)
        self._steps += 1
        self._best = max(self._best, now[2])
        reward = 5.0 * (now[2] - before) + 2.0 * (now[2] - self._best)
        return self._features(seen), reward, terminated, truncated, info

    def _row(self, seen: Floats) -> tuple[float, float, float]:
        light = max(float(seen[0]) - self._dark_v, 2e-4)
        return float(seen[3]), float(seen[4]), float(np.log(light))

    def _features(self, seen: Floats) -> Floats:
        past = np.array(self._past)
        # A sample is heard of some milliseconds after it was taken, on the way.
        places, levels = 0.5 * (past[1:, :2] + past[:-1, :2]), past[1:, 2]
        about, level = places - places.mean(axis=0), levels - levels.mean()
        slope = np.linalg.solve(about.T @ about + 0.05 * np.eye(2), about.T @ level)
        # The logarithm of a Gaussian is a parabola.
        to_peak = np.clip(0.5 * self._width_um**2 * slope, -10.0, 10.0) / 3.0
        from_now = past[-SHOWN - 1 : -1] - past[-1]
        from_now[:, 2] = np.arcsinh(200.0 * from_now[:, 2]) / 3.0
        clock = 2.0 * np.pi * self._steps / CLOCK
        circle = [np.cos(clock), np.sin(clock)]
        return np.concatenate([from_now.ravel(), seen[1:3] - seen[3:5], to_peak, circle]).astype(np.float32)


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
    """learned by PPO (stable-baselines3) on pigtail/Peak-v0: two seconds of its steps, and the mean of the second of them"""

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
        x, y = np.mean(places[len(places) // 2 :], axis=0)
        bench.until(bench.play(bench.caps.group("right.fine"), Line(Pose.um(float(x), float(y)))))
        light = bench.light(rig.meters[0]).volts[rig.meters[0]] - info["dark_v"]
        return bool(light > 0.005 and max(abs(x), abs(y)) < 9.7)


learner = Learner() if POLICY.exists() else None

if __name__ == "__main__":
    print(pigtail.benchmark({"learner": Learner()}, task="peak"))
