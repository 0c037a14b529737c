"""Aligning the fibers of one device."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from . import _pigtail
from ._document import Document
from ._input import maybe_text, text, texts, whole
from ._progress import Progress, shown
from ._rig import Rig, native

if TYPE_CHECKING:
    import numpy as np
    import pyarrow
    from numpy.typing import NDArray

CHANNELS = _pigtail.CHANNELS
"""The photodiodes, in the order of :attr:`Samples.light_v`."""
SIDES = _pigtail.SIDES
"""The manipulators, in the order of all that is indexed by side."""


@dataclass(frozen=True)
class Phase:
    """One phase of a fiber's alignment."""

    name: str
    """Its name."""
    seconds: float
    """Machine time, seconds."""


@dataclass(frozen=True)
class Believed:
    """What control believes of where an attached fiber is, and how surely."""

    z_um: float
    """Gap beyond the wanted one, micrometres."""
    within_um: dict[float, tuple[float, float, float]]
    """Half widths in x, y and z, micrometres, of the intervals that hold the truth with a probability (the key)."""
    outside: float
    """Control's own probability that the fiber is out of tolerance."""


@dataclass(frozen=True)
class Fiber:
    """How one fiber's alignment went, by control's own word."""

    port: str
    """The port: ``input``, ``output1``, ``output2``."""
    outcome: str
    """What control says of it: ``aligned``, or why not."""
    detail: str
    """The same in a sentence, with the evidence."""
    phases: tuple[Phase, ...]
    """Its phases in order."""
    seconds: float
    """Machine time of all of them, seconds."""
    believed: Believed | None
    """What control believes of it; ``None`` unless attached by a procedure that can say so."""

    @property
    def aligned(self) -> bool:
        """Whether control says that it is."""
        return self.outcome == "aligned"


@dataclass(frozen=True)
class PhaseStart:
    """When a phase began."""

    port: str
    """The port."""
    name: str
    """The phase."""
    start_s: float
    """Machine time, seconds."""


@dataclass(frozen=True)
class Samples:
    """The light samples of an alignment, and where the tips were by the encoders: ``n`` of them."""

    time_s: NDArray[np.float64]
    """When the light was sampled, machine time, seconds: shape ``(n,)``."""
    light_v: NDArray[np.float64]
    """The photodiodes, volts: shape ``(n, 3)``, in the order of ``pigtail.CHANNELS``."""
    endpoint_um: NDArray[np.float64]
    """Endpoint of each macro by its encoders, in its own frame, micrometres: shape ``(n, 2, 3)``, left and right; x, y, z."""
    micro_um: NDArray[np.float64]
    """Displacement commanded to each micro, micrometres: shape ``(n, 2, 2)``, left and right; x, y."""
    phase: NDArray[np.int32]
    """Which of :attr:`phases` a sample belongs to, -1 for none: shape ``(n,)``."""
    phases: tuple[PhaseStart, ...]
    """The phases in order."""

    def __len__(self) -> int:
        return len(self.time_s)

    def columns(self) -> dict[str, Any]:
        """Arrays of shape ``(n,)``, by the names of ``samples.csv``: ``time_s``, ``fiber``, ``phase``, ``sensing_V``, ...,
        ``left_x_um``, ..., ``right_micro_y_um``."""
        import numpy as np

        names = np.array([of.name for of in self.phases] + [""])
        fibers = np.array([of.port for of in self.phases] + [""])
        columns: dict[str, Any] = {
            "time_s": self.time_s,
            "fiber": fibers[self.phase],
            "phase": names[self.phase],
        }
        for k, channel in enumerate(CHANNELS):
            columns[f"{channel}_V"] = self.light_v[:, k]
        for side, name in enumerate(SIDES):
            for way, axis in enumerate("xyz"):
                columns[f"{name}_{axis}_um"] = self.endpoint_um[:, side, way]
            for way, axis in enumerate("xy"):
                columns[f"{name}_micro_{axis}_um"] = self.micro_um[:, side, way]
        return columns

    def to_arrow(self) -> pyarrow.Table:
        """The same as an Arrow table; needs ``pyarrow``."""
        try:
            import pyarrow as pa
        except ImportError as error:
            raise ImportError("tables of Arrow need pyarrow: pip install 'pigtail[arrow]'") from error

        return pa.table({name: pa.array(values) for name, values in self.columns().items()})

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        return self.to_arrow().__arrow_c_stream__(requested_schema)


class Alignment(Document):
    """How a device was aligned. ``print`` shows what ``pigtail align`` prints; as a mapping, and by :meth:`json`, it is
    what ``pigtail align --json`` prints. Both hold the twin's truth too, as the program does, for people; programs
    ask :func:`pigtail.sim.truth` for it. The attributes are what a real machine would tell.

    Attributes:
        fibers: The fibers, input first.
        samples: What light was seen, and where.
    """

    def __init__(self, text: str, words: str, samples: dict[str, Any]) -> None:
        super().__init__(text)
        self._words = words
        self.fibers = tuple(_fiber(fiber) for fiber in self["fibers"])
        phases = tuple(PhaseStart(*phase) for phase in samples.pop("phases"))
        self.samples = Samples(**samples, phases=phases)

    @property
    def seed(self) -> int:
        """The seed of machine, device, fixture and noise."""
        return int(self["seed"])

    @property
    def aligned(self) -> bool:
        """Whether control says of every fiber that it is aligned."""
        return all(fiber.aligned for fiber in self.fibers)

    @property
    def phases(self) -> dict[str, tuple[Phase, ...]]:
        """The phases of each fiber, by its port."""
        return {fiber.port: fiber.phases for fiber in self.fibers}

    @property
    def sureness(self) -> dict[str, Believed | None]:
        """What control believes of each fiber, and how surely, by its port."""
        return {fiber.port: fiber.believed for fiber in self.fibers}

    @property
    def seconds_per_fiber(self) -> float:
        """Machine time over the number of fibers that were attempted, seconds."""
        return float(self["seconds_per_fiber"])

    @property
    def fault(self) -> dict[str, Any] | None:
        """Why the machine stopped by itself: code, rule, axis, value, limit, time; ``None`` where it did not."""
        fault: dict[str, Any] | None = self["fault"]
        return fault

    def __str__(self) -> str:
        return self._words.rstrip("\n")


def _fiber(row: dict[str, Any]) -> Fiber:
    believed = None
    if (told := row["believed"]) is not None:
        within = {}
        for percent in (50, 80, 95, 99):
            half = told[f"within_{percent}_percent_um"]
            within[percent / 100] = (half["x"], half["y"], half["z"])
        believed = Believed(told["z_um"], within, told["outside"])
    return Fiber(
        port=row["port"],
        outcome=row["outcome"],
        detail=row["detail"],
        phases=tuple(Phase(phase["name"], phase["seconds"]) for phase in row["phases"]),
        seconds=row["seconds"],
        believed=believed,
    )


def align(
    rig: Rig | str | None = None,
    *,
    seed: int = 0,
    device: int = 0,
    procedure: str = "fast",
    fault: str | Sequence[str] = (),
    faults: str | None = None,
    progress: Progress = None,
) -> Alignment:
    """Aligns the fibers of one device on the twin that a seed draws.

    The numbers are those of ``pigtail align --json``, digit for digit. Nothing is written.

    Args:
        rig: The rig, its folder or name; the one that is built in if not given.
        seed: What to draw: machine, device, fixture and noise.
        device: Which device on the machine of this seed, from 0.
        procedure: How to align: ``fast``, ``thesis``, ...
        fault: Breaks something at a time: ``"encoder-stuck:left.z@0.5s"``, or several.
        faults: Breaks what a campaign with these faults breaks on this device: ``"all"``, or names with commas.
        progress: How to show progress; see :data:`pigtail.Progress`.

    Raises:
        InputError: For what is not accepted.
        KeyboardInterrupt: On Ctrl-C; the machine is stopped first.
    """
    with shown(progress, "align") as tell:
        document, words, samples = _pigtail.align(
            native(rig),
            text("procedure", procedure),
            whole("seed", seed),
            whole("device", device),
            maybe_text("faults", faults),
            texts("fault", fault),
            tell,
        )
    return Alignment(document, words, samples)


__all__ = ["CHANNELS", "SIDES", "Alignment", "Believed", "Fiber", "Phase", "PhaseStart", "Samples", "align"]
