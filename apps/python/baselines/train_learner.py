"""Trains the leaderboard's learner: stable-baselines3's PPO, as it comes, on ``pigtail/Peak-v0``.

    pip install "./apps/python[gym]" stable-baselines3
    python train_learner.py --steps 1000000

The light says how far away the peak is, and not where: an agent has to see how it changed with its own moves, so what it sees is
what :class:`learner.Relative` makes of the last observations. Episodes draw their twins from seeds below 2**32, and the
judge's held-out seeds are all above that.

What is kept is ``learner.npz``, the weights (``learner.py`` reads them with numpy alone), and ``learner.csv``, the curve: steps, the mean of
the light above the dark over the last hundred episodes (volts), and seconds of processor.
"""

import argparse
import csv
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from learner import Policy, Relative
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env

import pigtail.gym  # noqa: F401  (registers the environments)

HERE = Path(__file__).parent


def make(**arguments: Any) -> Any:
    """The environment, its own return noted before the wrapper makes its own."""
    return Relative(gymnasium.wrappers.RecordEpisodeStatistics(gymnasium.make("pigtail/Peak-v0", **arguments), 100))


class Curve(BaseCallback):  # type: ignore[misc, unused-ignore]
    """Notes the return of episodes as the environment counts it: volts."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._file = path.open("w", newline="")
        self._rows = csv.writer(self._file)
        self._rows.writerow(["steps", "light_v", "processor_s"])

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        # The wrapper's reward is its own: the environment's is told by the wrapper within.
        told = [float(np.mean(list(of)[-6:])) for of in self.training_env.get_attr("return_queue") if of]
        if told:
            self._rows.writerow([self.num_timesteps, f"{np.mean(told):.5f}", f"{time.process_time():.0f}"])
            self._file.flush()


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
    parser.add_argument("--into", type=Path, default=HERE, help="folder for learner.npz and learner.csv")
    asked = parser.parse_args()
    # Networks so small gain nothing by threads, which wait for each other on a machine that is busy.
    torch.set_num_threads(1)
    envs = make_vec_env(make, n_envs=16, seed=asked.seed)
    model = PPO(
        "MlpPolicy", envs, seed=asked.seed, device="cpu", n_steps=256, batch_size=512, n_epochs=5, gamma=0.95, gae_lambda=0.9,
        learning_rate=lambda left: 6e-4 * left, policy_kwargs={"net_arch": [64, 64], "log_std_init": -0.7},
    )  # fmt: skip
    model.learn(asked.steps, callback=Curve(asked.into / "learner.csv"))
    export(model, asked.into / "learner.npz")


if __name__ == "__main__":
    main()
