"""The truth about twins, for those who judge. Control never asks here, and neither should an algorithm of yours."""

from __future__ import annotations

from dataclasses import dataclass

from ._align import Alignment
from ._bench import BenchTwin
from ._errors import InputError
from ._rig import Rig
from ._twin import Twin


@dataclass(frozen=True)
class FiberTruth:
    """Where a fiber really is."""

    port: str
    """The port."""
    x_um: float
    """From the lateral peak of the coupling at its gap, across the chip, micrometres."""
    y_um: float
    """The same up from the chip, micrometres."""
    z_um: float | None
    """Gap beyond the wanted one, micrometres; ``None`` of a twin, which knows of no wish."""
    gap_um: float | None
    """Gap between facet and tip, micrometres; ``None`` of an alignment."""
    coupling_loss_db: float
    """Loss at this interface, decibels."""
    within_tolerance: bool | None
    """Whether it is where it should be; ``None`` of a twin."""


@dataclass(frozen=True)
class Truth:
    """What is true of a device on its machine."""

    fibers: tuple[FiberTruth | None, ...]
    """The fibers, input first; ``None`` where one is not attached."""
    smallest_gap_um: float | None
    """The least distance between the chip and anything so far, micrometres; ``None`` where nothing came near."""
    collision: bool
    """Whether anything ever touched the chip."""
    carried: tuple[FiberTruth | None, ...] = (None, None)
    """Of a bench's twin: the fibers that its arms carry, left and right; their ports are ``left`` and ``right``."""


_PORTS = ("input", "output1", "output2")


def _fiber(port: str, told: tuple[float, float, float, float] | None) -> FiberTruth | None:
    import math

    if told is None:
        return None
    x, y, gap, coupling = told
    loss = -10.0 * math.log10(coupling) if coupling > 0.0 else math.inf
    return FiberTruth(port, x, y, None, gap, loss, None)


def truth(of: Alignment | Twin | BenchTwin) -> Truth:
    """What is true of a device that was aligned, or of a twin as it is now."""
    if isinstance(of, Alignment):
        if of["collision"] is None:
            message = "of: was aligned on a bench, and nobody knows its truth; accepted is its twin, where it has one"
            raise InputError(message, key="of", value=repr(of))
        return Truth(
            tuple(
                None
                if row["offset_um"] is None
                else FiberTruth(
                    port=row["port"],
                    x_um=row["offset_um"]["x"],
                    y_um=row["offset_um"]["y"],
                    z_um=row["offset_um"]["z"],
                    gap_um=None,
                    coupling_loss_db=row["coupling_loss_db"],
                    within_tolerance=row["within_tolerance"],
                )
                for row in of["fibers"]
            ),
            of["smallest_gap_um"],
            of["collision"],
        )
    if isinstance(of, (Twin, BenchTwin)):
        import math

        told = of._twin.truth()
        fibers = tuple(_fiber(port, fiber) for port, fiber in zip(_PORTS, told["fibers"], strict=True))
        gap = told["smallest_gap_um"]
        carried = tuple(_fiber(*each) for each in zip(("left", "right"), told.get("carried", (None, None)), strict=True))
        return Truth(fibers, gap if math.isfinite(gap) else None, gap <= 0.0, carried)
    raise InputError(f"of: is {of!r}; accepted is an Alignment, a Twin or a BenchTwin", key="of", value=repr(of))


def plant(rig: Rig) -> str:
    """The truth that twins of a rig are drawn around: its ``plant.toml``."""
    if not isinstance(rig, Rig):
        raise InputError(f"rig: is {rig!r}; accepted is a Rig", key="rig", value=repr(rig))
    found = rig._rig.truth()
    if found is None:
        message = f"{rig.name}/plant.toml: is not there: this rig has no twin"
        raise InputError(message, file=f"{rig.name}/plant.toml")
    return found[1]


__all__ = ["FiberTruth", "Truth", "plant", "truth"]
