"""The nine-point climb: to the brightest of nine places around, with steps that halve where that is the middle."""

from __future__ import annotations

import pigtail


def climb(probe: pigtail.Probe) -> tuple[float, float]:
    """nine points around, to the brightest; the step halves where that is the middle"""
    x, y = probe.at_um
    step = 0.5 * probe.width_um
    best = probe(x, y, 4)
    while step > 0.02 * probe.width_um:
        around = [(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1) if (a, b) != (0, 0)]
        seen = [(probe(x + a * step, y + b * step, 4), x + a * step, y + b * step) for a, b in around]
        brightest = max(seen)
        if brightest[0] > best:
            best, x, y = brightest
        else:
            step *= 0.5
    return x, y


nine_point = pigtail.with_climb(climb)

if __name__ == "__main__":
    print(pigtail.benchmark({"nine-point": nine_point}, task="peak"))
