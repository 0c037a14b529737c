"""A twin, driven servo cycle by servo cycle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from . import _pigtail
from ._errors import InputError
from ._input import floats, switch, texts, whole
from ._rig import Rig, native

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray


def _table(name: str, values: ArrayLike | None) -> NDArray[np.float64] | None:
    return None if values is None else floats(name, values)


def _no_fiber(fiber: object) -> InputError:
    message = (
        f"fiber: is {fiber!r}; accepted are two, for the left and the right holder, each None, \"attach\", \"unload\" or "
        "(\"load\", port)"
    )
    return InputError(message, key="fiber", value=repr(fiber))


def _each(fiber: object, values: Any) -> list[Any]:
    try:
        if isinstance(values, (str, bytes)):
            raise TypeError
        return list(values)
    except TypeError:
        raise _no_fiber(fiber) from None


def _handled(fiber: object, what: object) -> tuple[str, int] | None:
    if what is None:
        return None
    if isinstance(what, str):
        return what, 0
    pair = _each(fiber, what)
    if len(pair) != 2 or not isinstance(pair[0], str):
        raise _no_fiber(fiber)
    return pair[0], whole("fiber", pair[1], 0, 255)


class Command:
    """What control says in one servo cycle; all is held until the next.

    Indices are ``[side][axis]``: left and right; joints a and b of the five-bar, and z.

    Args:
        motors_v: Motor voltages, volts: shape ``(2, 3)``; no voltage if not given.
        micro_v: Amplifier inputs of the piezos, volts: shape ``(2, 2)``, x and y; zero if not given.
        laser: Whether the laser at the input fiber's far end is on.
        fiber: What each holder does with its fiber, left and right: ``None``, ``"attach"``, ``"unload"``, or
            ``("load", port)``, with ports from 0 on each side.
        references_counts: Where a servo wants each axis, encoder counts, ``NaN`` where none holds it: shape ``(2, 3)``.
            Nothing follows it: a guard compares.

    Raises:
        InputError: For a wrong shape, or what is no finite number.
    """

    __slots__ = ("_command",)

    def __init__(
        self,
        *,
        motors_v: ArrayLike | None = None,
        micro_v: ArrayLike | None = None,
        laser: bool = False,
        fiber: Sequence[str | tuple[str, int] | None] = (None, None),
        references_counts: ArrayLike | None = None,
    ) -> None:
        handled = [_handled(fiber, what) for what in _each(fiber, fiber)]
        if len(handled) != 2:
            raise _no_fiber(fiber)
        self._command = _pigtail.Command(
            _table("motors_v", motors_v),
            _table("micro_v", micro_v),
            switch("laser", laser),
            handled,
            _table("references_counts", references_counts),
        )


@dataclass(frozen=True)
class Light:
    """One sample of all photodiodes."""

    time_s: float
    """When it was taken, machine time, seconds."""
    volts: NDArray[np.float64]
    """Photodiode amplifiers after the converter, volts: shape ``(3,)``, in the order of ``pigtail.CHANNELS``."""


@dataclass(frozen=True)
class Tip:
    """A fiber's tip as vision sees it, in the chip's frame."""

    x_um: float
    """Across the chip, micrometres."""
    z_um: float
    """Along the waveguide from the input facet, micrometres."""
    sigma_um: float
    """Standard deviation of one frame's own noise, micrometres."""


@dataclass(frozen=True)
class Frame:
    """What vision saw in one frame."""

    time_s: float
    """When it was exposed, machine time, seconds; it arrives later."""
    fiber: tuple[Tip | None, ...]
    """The tip of each held fiber, left and right; ``None`` where the holder is empty."""
    sensing: Tip
    """The tip of the sensing fiber."""


class Measurement:
    """What a machine measured in one servo cycle. Sensors slower than the servo speak only in some cycles."""

    __slots__ = ("_measurement",)

    def __init__(self, measurement: _pigtail.Measurement) -> None:
        self._measurement = measurement

    @property
    def time_s(self) -> float:
        """Machine time at the end of the cycle, seconds since power-on."""
        return self._measurement.time_s

    @property
    def encoders_counts(self) -> NDArray[np.int64]:
        """Motor encoders, counts from home: shape ``(2, 3)``."""
        return self._measurement.encoders_counts

    @property
    def light(self) -> Light | None:
        """A new sample of the photodiodes."""
        light = self._measurement.light
        return None if light is None else Light(*light)

    @property
    def vision(self) -> Frame | None:
        """A new frame of the vision system."""
        frame = self._measurement.vision
        if frame is None:
            return None
        time, fibers, sensing = frame
        return Frame(time, tuple(None if tip is None else Tip(*tip) for tip in fibers), Tip(*sensing))

    @property
    def probes_um(self) -> NDArray[np.float64] | None:
        """Displacement of each axis's output from home by its probe, micrometres: shape ``(2, 3)``; ``None`` on a rig
        without probes."""
        return self._measurement.probes_um

    @property
    def stop(self) -> bool:
        """Whether a person asks the machine to stop."""
        return self._measurement.stop

    def __repr__(self) -> str:
        return f"<pigtail.Measurement at {self.time_s:.4f} s>"


class Twin:
    """A simulated machine that a seed draws: the boundary of machine and control, with nothing around it. It stands at
    home, without fibers. What is true of it, :mod:`pigtail.sim` tells.

    Args:
        rig: The rig, its folder or name; the one that is built in if not given.
        seed: Machine, device, fixture and noise.
        fault: Breaks something at a time: ``"encoder-stuck:left.z@0.5s"``, or several.

    Example:
        >>> twin = pigtail.Twin(seed=7)
        >>> volt = pigtail.Command(motors_v=[[0, 0, 1.0], [0, 0, 0]])
        >>> for _ in range(100):
        ...     seen = twin.exchange(volt)
        >>> seen.encoders_counts[0, 2]
    """

    def __init__(self, rig: Rig | str | None = None, seed: int = 0, *, fault: str | Sequence[str] = ()) -> None:
        self._twin = _pigtail.Twin(native(rig), whole("seed", seed), texts("fault", fault))

    def exchange(self, command: Command) -> Measurement:
        """One servo cycle: applies a command for one period, then measures.

        Raises:
            FaultError: When the machine has stopped. It is then safe, and answers every further command with the same
                fault: draw another twin.
        """
        if not isinstance(command, Command):
            message = f"command: is {command!r}; accepted is a pigtail.Command"
            raise InputError(message, key="command", value=repr(command))
        return Measurement(self._twin.exchange(command._command))

    def stop(self) -> None:
        """Stops at once and holds: motors without voltage, laser off, piezos as they are."""
        self._twin.stop()

    @property
    def period_s(self) -> float:
        """Length of a servo cycle, seconds."""
        return self._twin.period_s


