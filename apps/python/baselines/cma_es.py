"""CMA-ES, the package cma."""

from __future__ import annotations

import math

import cma

import pigtail


def climb(probe: pigtail.Probe) -> tuple[float, float]:
    """CMA-ES (cma): 20 generations of 6 from a deviation of a third of a width; its mean at last"""
    options = {"verbose": -9, "seed": 1, "popsize": 6, "maxiter": 20, "bounds": [-probe.reach_um, probe.reach_um]}
    search = cma.CMAEvolutionStrategy(list(probe.at_um), probe.width_um / 3.0, options)
    while not search.stop():
        places = search.ask()
        search.tell(places, [-math.log(max(probe(x, y, 2), probe.noise_v)) for x, y in places])
    x, y = search.result.xfavorite
    return float(x), float(y)


cma_es = pigtail.with_climb(climb)

if __name__ == "__main__":
    print(pigtail.benchmark({"cma-es": cma_es}, task="peak"))
