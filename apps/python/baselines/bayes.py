"""Bayesian optimisation with a Gaussian process: scikit-optimize's."""

from __future__ import annotations

import math
import warnings

import numpy as np
from skopt import Optimizer
from skopt.learning import GaussianProcessRegressor
from skopt.learning.gaussian_process.kernels import RBF, ConstantKernel

import pigtail


def climb(probe: pigtail.Probe) -> tuple[float, float]:
    """a Gaussian process and expected improvement (scikit-optimize): 8 places at random, 16 chosen; the mean's best at last"""
    x0, y0 = probe.at_um
    far = 1.2 * probe.width_um
    limits = [(max(at - far, -probe.reach_um), min(at + far, probe.reach_um)) for at in (x0, y0)]
    # The logarithm of the light is smooth over about a width; what is scattered makes it flat outside.
    kernel = ConstantKernel(4.0, (0.1, 100.0)) * RBF([0.5, 0.5], (0.1, 3.0))
    model = GaussianProcessRegressor(kernel, alpha=1e-5, normalize_y=True, n_restarts_optimizer=0)
    search = Optimizer(limits, model, n_initial_points=8, acq_func="EI", acq_optimizer="sampling", random_state=1,
                       acq_optimizer_kwargs={"n_points": 2000})  # fmt: skip

    def dimness(x: float, y: float) -> float:
        return -math.log(max(probe(x, y, 2), probe.noise_v))

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        search.tell([x0, y0], dimness(x0, y0))
        for _ in range(24):
            x, y = search.ask()
            search.tell([x, y], dimness(x, y))
        grid = np.stack(np.meshgrid(*[np.linspace(low, high, 201) for low, high in limits]), axis=-1).reshape(-1, 2)
        mean = search.models[-1].predict(search.space.transform(grid.tolist()))
    x, y = grid[int(np.argmin(mean))]
    return float(x), float(y)


bayes = pigtail.with_climb(climb)

if __name__ == "__main__":
    print(pigtail.benchmark({"bayes": bayes}, task="peak", devices=5))
