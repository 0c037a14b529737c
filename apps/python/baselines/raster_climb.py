"""Raster and climb: a grid around where it stands, to its brightest point, then lines in x and in y that get shorter."""

from __future__ import annotations

import numpy as np

import pigtail


def climb(probe: pigtail.Probe) -> tuple[float, float]:
    """a grid of 7 by 7, and from its brightest point parabolas through lines in x and in y"""
    x, y = probe.at_um
    grid = probe.width_um * np.linspace(-0.9, 0.9, 7)
    _, x, y = max((probe(x + a, y + b), x + a, y + b) for b in grid for a in grid)
    for half in (0.5, 0.35, 0.35):
        for along in (0, 1):
            offsets = half * probe.width_um * np.linspace(-1.0, 1.0, 7)
            seen = np.array([probe(x + (along == 0) * by, y + (along == 1) * by, 2) for by in offsets])
            # The light is about Gaussian, and its logarithm a parabola.
            bend, slope, _ = np.polyfit(offsets, np.log(np.maximum(seen, probe.noise_v)), 2)
            by = (
                float(np.clip(-slope / (2.0 * bend), offsets[0], offsets[-1]))
                if bend < 0.0
                else float(offsets[seen.argmax()])
            )
            x, y = x + (along == 0) * by, y + (along == 1) * by
    return x, y


raster_climb = pigtail.with_climb(climb)

if __name__ == "__main__":
    print(pigtail.benchmark({"raster-climb": raster_climb}, task="peak"))
