"""Stochastic parallel gradient descent: both axes are disturbed at once, to either side, and both go where it was brighter."""

from __future__ import annotations

import numpy as np

import pigtail


def climb(probe: pigtail.Probe) -> tuple[float, float]:
    """stochastic parallel gradient descent: 60 disturbances of both axes at once, to either side, that get smaller"""
    rng = np.random.default_rng(0)
    place = np.array(probe.at_um)
    steps = 60
    for k in range(steps):
        size = probe.width_um * 0.35 * (1.0 - 0.8 * k / steps)
        by = size * rng.choice([-1.0, 1.0], 2)
        (x, y), (a, b) = place, by
        ahead, behind = probe(x + a, y + b, 2), probe(x - a, y - b, 2)
        level = max(0.5 * (ahead + behind), probe.noise_v)
        # Relative, so that it is the same at any brightness; of a Gaussian that is -4 (place - peak) by / width^2.
        gradient = (ahead - behind) / level * by / size**2
        way = 0.25 * probe.width_um**2 * (1.0 - 0.7 * k / steps) * gradient
        place = place + np.clip(way, -0.5 * probe.width_um, 0.5 * probe.width_um)
    return float(place[0]), float(place[1])


spgd = pigtail.with_climb(climb)

if __name__ == "__main__":
    print(pigtail.benchmark({"spgd": spgd}, task="peak"))
