"""Experiments on one machine."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from . import _pigtail
from ._document import Document, Experiment
from ._errors import InputError
from ._input import floats, maybe_number, maybe_whole, number, text, texts, whole
from ._progress import Progress, shown
from ._rig import Calibration, Rig, native

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray


def _experiment(found: tuple[str, dict[str, Any], _pigtail.Belief | None]) -> Experiment:
    document, arrays, belief = found
    return Experiment(document, arrays, None if belief is None else Calibration(belief))


def tune(
    axis: str,
    rig: Rig | str | None = None,
    *,
    seed: int = 0,
    search: str = "simplex",
    trials: int | None = None,
    step: int | None = None,
    progress: Progress = None,
) -> Experiment:
    """Tunes the PID of an axis on the machine, as ``pigtail tune`` does.

    Args:
        axis: ``fivebar``, ``z``, or ``left.a``, ``left.b``, ``left.z``, ``right.a``, ``right.b``, ``right.z``.
        rig: The rig, its folder or name; the one that is built in if not given.
        seed: The machine, and what random trials are drawn by.
        search: ``simplex`` or ``random``.
        trials: Trials of each start, 5 to 100.
        step: The larger of the two steps, counts.
        progress: How to show progress; see :data:`pigtail.Progress`.

    Returns:
        Gains, rise and settling times as ``pigtail tune --json`` has them. Arrays: ``before.`` and ``after.`` with
        ``time_s``, ``reference_counts``, ``encoder_counts``, ``output_um``, ``voltage_v``.
    """
    with shown(progress, f"tune {axis}") as tell:
        return _experiment(
            _pigtail.tune(
                native(rig),
                text("axis", axis),
                whole("seed", seed),
                text("search", search),
                maybe_whole("trials", trials, 5, 100),
                maybe_whole("step", step, 1, 2**62),
                tell,
            )
        )


def identify(
    axis: str,
    rig: Rig | str | None = None,
    *,
    seed: int = 0,
    model: str = "memory",
    progress: Progress = None,
) -> Experiment:
    """Identifies the windup of a transmission (thesis 2.4), as ``pigtail identify windup`` does.

    Args:
        axis: As for :func:`pigtail.tune`.
        rig: The rig, its folder or name; the one that is built in if not given. It needs probes.
        seed: The machine, and what random reversals are drawn by.
        model: ``memory`` (remembers every reversal that matters) or ``reversal``, (2.20) to (2.26).
        progress: How to show progress; see :data:`pigtail.Progress`.

    Returns:
        What ``pigtail identify windup --json`` prints. Arrays: ``time_s``, ``input_rad`` (the motor's angle through its
        ratio), ``output_rad`` (by the probe), ``wanted_rad``, and the same with ``before.`` and ``after.`` for a scan
        without and with compensation.
    """
    with shown(progress, f"identify {axis}") as tell:
        return _experiment(
            _pigtail.identify(native(rig), text("axis", axis), whole("seed", seed), text("model", model), tell)
        )


def characterize(
    axis: str,
    what: str,
    rig: Rig | str | None = None,
    *,
    seed: int = 0,
    size: int | None = None,
    frequency_hz: float | None = None,
    steps: int = 1000,
    progress: Progress = None,
) -> Experiment:
    """Measures what an axis can do, as ``pigtail characterize`` does.

    Args:
        axis: As for :func:`pigtail.tune`.
        what: ``step``, ``sine``, ``resolution``, ``frequency``, ``windup`` or ``impulse``.
        rig: The rig, its folder or name; the one that is built in if not given.
        seed: The machine.
        size: Size of the step, or amplitude of sine or noise, counts.
        frequency_hz: Frequency of the sine, hertz.
        steps: Steps of the resolution test, 10 to 10000.
        progress: How to show progress; see :data:`pigtail.Progress`.

    Returns:
        What ``pigtail characterize --json`` prints; for ``resolution``, its rows are under the key ``rows``. Arrays:

        - ``step``, ``sine``: ``time_s``, ``reference_counts``, ``encoder_counts``, ``output_um`` (empty without a
          probe), ``voltage_v``;
        - ``frequency``: ``encoder.`` and ``output.`` with ``frequency_hz``, ``gain``, ``phase_rad``, ``coherence``;
        - ``resolution``: ``increments_um.N`` for steps of N counts;
        - ``windup``: ``K.time_s``, ``K.input_rad``, ``K.output_rad``, ``K.wanted_rad`` for case K.
    """
    with shown(progress, f"characterize {axis} {what}") as tell:
        return _experiment(
            _pigtail.characterize(
                native(rig),
                text("axis", axis),
                text("what", what),
                whole("seed", seed),
                maybe_whole("size", size, 1, 2**62),
                maybe_number("frequency_hz", frequency_hz),
                whole("steps", steps, 10, 10_000),
                tell,
            )
        )


class Commissioning(Document):
    """What commissioning a machine came to.

    Attributes:
        calibration: All that is believed of the machine now; ``None`` where nothing was found.
    """

    def __init__(self, text: str, calibration: Calibration | None) -> None:
        super().__init__(text)
        self.calibration = calibration

    @property
    def accepted(self) -> bool:
        """Whether every step has passed, and the acceptance test was among them."""
        return bool(self["accepted"])


def commission(
    rig: Rig | str | None = None,
    *,
    seed: int = 0,
    steps: str | Sequence[str] = (),
    devices: int = 5,
    progress: Progress = None,
) -> Commissioning:
    """Commissions a machine, from its datasheet to a calibration that was tried on devices, as ``pigtail commission``
    does: through encoders, photodiodes, probes and vision alone.

    Args:
        rig: The rig, its folder or name; the one that is built in if not given.
        seed: The machine.
        steps: The steps to do; all if not given: ``axes``, ``dark``, ``gains``, ``windup``, ``piezos``, ``shaking``,
            ``acceptance``.
        devices: Devices of the acceptance test, 1 to 1000.
        progress: How to show progress; see :data:`pigtail.Progress`.
    """
    with shown(progress, "commission") as tell:
        document, belief = _pigtail.commission(
            native(rig), whole("seed", seed), texts("steps", steps), whole("devices", devices, 1, 1000), tell
        )
    return Commissioning(document, None if belief is None else Calibration(belief))


def _numbers(name: str, values: Any, count: int) -> list[float]:
    try:
        items = list(values)
    except TypeError:
        items = []
    if len(items) != count:
        message = f"{name}: is {values!r}; accepted are {count} numbers"
        raise InputError(message, key=name, value=repr(values))
    return [number(name, item) for item in items]


def _vector(name: str, values: ArrayLike) -> list[float]:
    array = floats(name, values)
    if array.ndim != 1:
        message = f"{name}: has the shape {array.shape}; accepted is (n,)"
        raise InputError(message, key=name, value=str(array.shape))
    result: list[float] = array.tolist()
    return result


def simulate_joint(
    params: str | os.PathLike[str] | Mapping[str, float],
    axis: str = "axis",
    *,
    voltages: tuple[ArrayLike, ArrayLike] | None = None,
    impulse: Sequence[float] | None = None,
    step: float | None = None,
    triangle: Sequence[float] | None = None,
    duration_s: float | None = None,
    row_period_s: float | None = None,
    max_step_s: float = 25e-6,
    progress: Progress = False,
) -> dict[str, NDArray[np.float64]]:
    """Simulates one joint, (2.1) to (2.13), from rest, as ``pigtail simulate joint`` does.

    Exactly one of ``voltages``, ``impulse``, ``step`` and ``triangle`` drives it.

    Args:
        params: A TOML or JSON file with a table for each axis, or the parameters of one, named as in the equations, SI
            units: ``Jm``, ``Jl``, ``r``, ``P``, ``km``, ``kb``, ``R``, ``ks``, ...
        axis: Which table of the file.
        voltages: Times (seconds, shape ``(n,)``) and volts (shape ``(n,)``), each held until the next.
        impulse: The impulse (4.7): its two amplitudes over the motor's static friction, and its length in seconds.
        step: A step of the PID's reference, counts.
        triangle: A reference that rises to so many counts and falls back in so many seconds, twice.
        duration_s: How long, seconds; what the input needs if not given.
        row_period_s: Time between rows, seconds; divides the servo period.
        max_step_s: Longest integration step, seconds.
        progress: How to show progress; see :data:`pigtail.Progress`.

    Returns:
        Arrays of shape ``(n,)``: ``time_s``, ``u_V``, ``q_m_rad``, ``q_l_rad``, ``v_m_rad_s``, ``v_l_rad_s``,
        ``output_m``, ``mode_m``, ``mode_l`` (-1, 0 stuck, +1), ``count``, ``ref_count``.
    """
    driven = None
    if voltages is not None:
        try:
            times, volts = voltages
        except (TypeError, ValueError):
            message = "voltages: accepted are two arrays, times and volts"
            raise InputError(message, key="voltages", value=repr(voltages)) from None
        driven = (_vector("voltages", times), _vector("voltages", volts))
    given: str | tuple[str]
    if isinstance(params, Mapping):
        given = (json.dumps({str(key): number(str(key), value) for key, value in params.items()}),)
    else:
        given = text("params", params)
    with shown(progress, "simulate joint") as tell:
        return _pigtail.simulate_joint(
            given,
            text("axis", axis),
            driven,
            None if impulse is None else _numbers("impulse", impulse, 3),
            maybe_number("step", step),
            None if triangle is None else _numbers("triangle", triangle, 2),
            maybe_number("duration_s", duration_s),
            maybe_number("row_period_s", row_period_s),
            number("max_step_s", max_step_s),
            tell,
        )
