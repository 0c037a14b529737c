"""Trains the leaderboard's learner: stable-baselines3's PPO, as it comes, on ``pigtail/Peak-v0``.

    pip install "./apps/python[gym]" stable-baselines3
    python train_learner.py --steps 1000000

The light says how far away the peak is, and not where: an agent has to see how it changed with its own moves, so what it sees is
what :class:`learner.Relative` makes of the last observations, and what it is told is :class:`Beside`. Episodes draw their twins from seeds below 2**32, and the
judge's held-out seeds are all above that.

Now and then the policy is judged as the leaderboard judges it, on seeds of its own (:data:`VALIDATION`): by how many peaks it finds, and by how near where
that is the same. What is kept is the best of them as ``learner.npz``, the weights (``learner.py`` reads them with numpy alone), and ``learner.csv``, the
curve: steps, the mean of the light above the dark over the last episodes (volts), how far beside the peak the mean of their last second was (median,
micrometres, with the moves that training disturbs), seconds of processor, and where it was judged the share of the peaks that it found.
"""

import argparse
import csv
import time
from collections import deque
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from learner import CLOCK, SAID, Learner, Policy, Relative
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env

import pigtail
import pigtail.gym  # noqa: F401  (registers the environments)
import pigtail.sim

HERE = Path(__file__).parent
VALIDATION = range(2**33, 2**33 + 100)
"""Seeds by which the best policy is chosen: no episode's, for those are below 2**32, and none that is held out."""


class Beside:
    """What a step is worth in training: by how much the mean place of the last turn is beside the peak, by the twin's truth, of which the
    policy sees nothing. The light would do if it told: 0.15 um beside the peak costs 0.1 % of it, less than a sample's
    noise, and circling, without which nothing is seen, costs more than that."""

    def __init__(self) -> None:
        self._bench: Any = None
        self.ends: deque[float] = deque(maxlen=6)

    def __call__(self, env: Any) -> float:
        if env.bench is not self._bench:
            self._bench, self._offsets = env.bench, deque[tuple[float, float]](maxlen=SAID)
        fiber = pigtail.sim.truth(env.bench).carried[1]
        assert fiber is not None
        self._offsets.append((fiber.x_um, fiber.y_um))
        beside = float(np.linalg.norm(np.mean(list(self._offsets)[-CLOCK:], axis=0)))
        if env.bench.now_s - env._began_s >= env.limit_s:
            self.ends.append(float(np.linalg.norm(np.mean(self._offsets, axis=0))))
        return -0.2 * float(np.log1p(beside / 0.03))


class Trained(Relative):
    """The environment as it is trained on."""

    def __init__(self, env: Any) -> None:
        self.beside = Beside()
        super().__init__(env, self.beside)


def make(limit_s: float = 3.0, **arguments: Any) -> Any:
    """Episodes of three seconds: the way to the peak is in all of them. The environment's own return is noted before the wrapper makes its own."""
    env = gymnasium.make("pigtail/Peak-v0", limit_s=limit_s, **arguments)
    return Trained(gymnasium.wrappers.RecordEpisodeStatistics(env, 100))


class Curve(BaseCallback):  # type: ignore[misc, unused-ignore]
    """Notes the return of episodes as the environment counts it, volts, and keeps the policy that does best on seeds which it has not seen."""

    def __init__(self, into: Path, every: int) -> None:
        super().__init__()
        self._kept, self._every, self._judged = into / "learner.npz", every, 0
        self._best = (-1.0, 0.0)
        self._file = (into / "learner.csv").open("w", newline="")
        self._rows = csv.writer(self._file)
        self._rows.writerow(["steps", "light_v", "beside_um", "processor_s", "right"])

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        # What is judged is the policy that these steps were made with.
        right = ""
        if self.num_timesteps - self._judged >= self._every:
            self._judged = self.num_timesteps
            right = f"{self.judge():.2f}"
        # The wrapper's reward is its own: the environment's is told by the wrapper within.
        told = [float(np.mean(list(of)[-6:])) for of in self.training_env.get_attr("return_queue") if of]
        beside = [end for of in self.training_env.get_attr("beside") for end in of.ends]
        if told and beside:
            row = [f"{np.mean(told):.5f}", f"{np.median(beside):.4f}", f"{time.process_time():.0f}"]
            self._rows.writerow([self.num_timesteps, *row, right])
            self._file.flush()

    def _on_training_end(self) -> None:
        self.judge()

    def judge(self) -> float:
        """The share of peaks that the policy finds, as the leaderboard counts it; it is kept where it is the best so far."""
        policy = self._kept.with_suffix(".new.npz")
        export(self.model, policy)
        judged = pigtail.benchmark(
            {"learner": Learner(policy)}, task="peak", devices=len(VALIDATION), seeds=VALIDATION[0], ours=False, progress=False
        )
        row = judged["algorithms"][0]
        beside = row["offset_xy_um"]["p50"]
        score = row["right"] / len(VALIDATION), -float("inf") if beside is None else -beside
        if score > self._best:
            self._best = score
            policy.replace(self._kept)
        policy.unlink(missing_ok=True)
        return float(score[0])


def export(model: PPO, path: Path) -> None:
    """The deterministic policy as arrays, and that they say what the model says."""
    weights = {name: of.detach().numpy() for name, of in model.policy.state_dict().items()}
    arrays = {}
    for to, at in (("1", "mlp_extractor.policy_net.0"), ("2", "mlp_extractor.policy_net.2"), ("3", "action_net")):
        arrays["w" + to], arrays["b" + to] = weights[at + ".weight"], weights[at + ".bias"]
    np.savez_compressed(path, **arrays)
    policy, rng = Policy(path), np.random.default_rng(0)
    for _ in range(100):
        seen = rng.normal(size=arrays["w1"].shape[1]).astype(np.float32)
        theirs, _ = model.predict(seen, deterministic=True)
        np.testing.assert_allclose(policy(seen), theirs, atol=2e-5)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--validate", type=int, default=98_304, metavar="STEPS", help="how often a policy is judged")
    parser.add_argument("--into", type=Path, default=HERE, help="folder for learner.npz and learner.csv")
    asked = parser.parse_args()
    # Networks so small gain nothing by threads, which wait for each other on a machine that is busy.
    torch.set_num_threads(1)
    envs = make_vec_env(make, n_envs=16, seed=asked.seed)
    model = PPO(
        "MlpPolicy", envs, seed=asked.seed, device="cpu", n_steps=256, batch_size=512, n_epochs=5, gamma=0.97, gae_lambda=0.95,
        learning_rate=lambda left: 6e-4 * left, policy_kwargs={"net_arch": [64, 64], "log_std_init": -1.0},
    )  # fmt: skip
    model.learn(asked.steps, callback=Curve(asked.into, asked.validate))


if __name__ == "__main__":
    main()
