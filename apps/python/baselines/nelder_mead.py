"""Nelder and Mead's simplex, scipy's."""

from __future__ import annotations

from scipy.optimize import minimize

import pigtail


def climb(probe: pigtail.Probe) -> tuple[float, float]:
    """Nelder and Mead's simplex (scipy), from a triangle of half a width, 60 places at most"""
    x, y = probe.at_um
    half = 0.5 * probe.width_um
    result = minimize(
        lambda at: -probe(at[0], at[1], 4),
        (x, y),
        method="Nelder-Mead",
        options={
            "initial_simplex": [(x, y), (x + half, y), (x, y + half)],
            "maxfev": 60, "xatol": 0.01 * probe.width_um, "fatol": probe.noise_v,
        },
    )  # fmt: skip
    return float(result.x[0]), float(result.x[1])


nelder_mead = pigtail.with_climb(climb)

if __name__ == "__main__":
    print(pigtail.benchmark({"nelder-mead": nelder_mead}, task="peak"))
