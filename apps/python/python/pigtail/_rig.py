"""Rigs: what is known of a machine, and of the device on it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

from . import _pigtail
from ._errors import InputError
from ._input import maybe_text, text, texts


class Calibration:
    """What is believed of a rig: a ``calibration.toml`` and the weights that it names.

    Made by :meth:`Rig.calibration`, and by whatever finds something out: :func:`pigtail.tune`,
    :func:`pigtail.identify`, :func:`pigtail.characterize`, :func:`pigtail.commission`. Nothing is written unless
    :meth:`write` is called.
    """

    def __init__(self, belief: _pigtail.Belief) -> None:
        self._belief = belief

    @property
    def files(self) -> dict[str, str]:
        """File names and texts."""
        return dict(self._belief.files())

    def write(self, folder: str | os.PathLike[str]) -> None:
        """Writes the files into a folder, each whole or not at all: ``Rig(calibration=folder/"calibration.toml")``."""
        self._belief.write(text("folder", folder))

    def __str__(self) -> str:
        return self.files["calibration.toml"]

    def __reduce__(self) -> tuple[Any, ...]:
        return Calibration._of, self._belief.parts()

    @staticmethod
    def _of(name: str, text: str, weights: list[tuple[str, str]]) -> Calibration:
        return Calibration(_pigtail.Belief(name, text, weights))


class Rig:
    """A rig, a recipe, and what machines and devices may be.

    It can be pickled, as for a worker of Dask: what is believed goes with it, its files are read again by their names. Where
    they are others than here, that is an :class:`InputError`.

    Args:
        rig: A folder with the files of a rig, or the name of one below ``rigs``; ``afpm`` is built in.
        recipe: A recipe's file, or the name of one below ``recipes``; ``y-branch`` is built in.
        fleet: What machine and device may be: ``nominal``, or a fleet of the rig, or a TOML file.
        calibration: In place of the rig's: the number of a version, a run that found it, or a file.
        scenario: What is wrong with device, fixture or light: ``nominal``, ``weak``, ...
        axes: Axes of one's own: fragments that ``pigtail identify`` wrote, or folders of such runs.
        runs: Where runs are that ``calibration`` may name.

    Raises:
        InputError: When something cannot be read, or is not what is accepted: with file, key and value.
    """

    def __init__(
        self,
        rig: str | os.PathLike[str] = "afpm",
        recipe: str | os.PathLike[str] = "y-branch",
        *,
        fleet: str | os.PathLike[str] = "nominal",
        calibration: str | int | os.PathLike[str] | None = None,
        scenario: str = "nominal",
        axes: Sequence[str | os.PathLike[str]] = (),
        runs: str | os.PathLike[str] = "runs",
    ) -> None:
        if isinstance(calibration, int):
            calibration = str(calibration)
        self._named = (
            text("rig", rig),
            text("recipe", recipe),
            text("fleet", fleet),
            maybe_text("calibration", calibration),
            text("scenario", scenario),
            texts("axes", axes),
            text("runs", runs),
        )
        self._believed: Calibration | None = None
        self._rig = _pigtail.Rig(*self._named)

    @staticmethod
    def _of(named: tuple[Any, ...], believed: Calibration | None, hashes: dict[str, str]) -> Rig:
        made = Rig.__new__(Rig)
        made._named, made._believed, made._rig = named, None, _pigtail.Rig(*named)
        made = made if believed is None else made.believing(believed)
        same_files(made.hashes, hashes)
        return made

    def __reduce__(self) -> tuple[Any, ...]:
        return Rig._of, (self._named, self._believed, self.hashes)

    def believing(self, calibration: Calibration) -> Rig:
        """The same rig, believing this calibration."""
        if not isinstance(calibration, Calibration):
            message = f"calibration: is {calibration!r}; accepted is a Calibration"
            raise InputError(message, key="calibration", value=repr(calibration))
        made = Rig.__new__(Rig)
        made._named, made._believed = self._named, calibration
        made._rig = self._rig.with_belief(calibration._belief)
        return made

    @property
    def name(self) -> str:
        """The rig as it was named."""
        return self._rig.name

    @property
    def recipe(self) -> str:
        """The recipe as it was named."""
        return self._rig.recipe

    @property
    def fleet(self) -> str:
        """What machine and device may be."""
        return self._rig.fleet

    @property
    def scenario(self) -> str:
        """What is wrong with device, fixture or light."""
        return self._rig.scenario

    @property
    def has_twin(self) -> bool:
        """Whether it has a truth, so that twins can be drawn of it."""
        return self._rig.has_twin

    @property
    def rate_hz(self) -> float:
        """Servo cycles a second."""
        return self._rig.rate_hz

    @property
    def calibration(self) -> Calibration:
        """What is believed of it."""
        return Calibration(self._rig.belief())

    @property
    def files(self) -> dict[str, str]:
        """What was read, by name: datasheet, belief and recipe; not the truth, which :mod:`pigtail.sim` tells."""
        return dict(self._rig.sources())

    @property
    def hashes(self) -> dict[str, str]:
        """SHA-256 of all that was read, by name."""
        return dict(self._rig.hashes)

    def __repr__(self) -> str:
        return f"<pigtail.Rig: {self._rig.runs_on()}>"


def same_files(here: dict[str, str], there: dict[str, str]) -> None:
    """Refuses files that are others than those of which a rig was made elsewhere."""
    for name in there | here:
        if here.get(name) != there.get(name):
            message = f"{name}: is another file here than where the rig was made; accepted is the same"
            raise InputError(message, file=name)


def native(rig: Any) -> _pigtail.Rig:
    """The rig that is meant: one, the name of one, or the one that is built in."""
    if isinstance(rig, Rig):
        return rig._rig
    return (Rig() if rig is None else Rig(text("rig", rig)))._rig
