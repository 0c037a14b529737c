"""What functions return: a document, as the program prints it with ``--json``, and arrays beside it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ._rig import Calibration


class Document(Mapping[str, Any]):
    """A document: a mapping with the keys of the program's ``--json``, digit for digit.

    A key's last letters are its unit. What a key means is said by ``pigtail COMMAND --help`` and in the book.
    """

    def __init__(self, text: str) -> None:
        self._text = text
        document = json.loads(text)
        self._document: dict[str, Any] = document if isinstance(document, dict) else {"rows": document}

    def json(self) -> str:
        """The document as it came."""
        return self._text

    def __getitem__(self, key: str) -> Any:
        return self._document[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._document)

    def __len__(self) -> int:
        return len(self._document)

    def __str__(self) -> str:
        return json.dumps(self._document, indent=2)

    def __repr__(self) -> str:
        return f"<pigtail.{type(self).__name__}: {', '.join(self._document)}>"


class Experiment(Document):
    """What an experiment found, and what it measured.

    Attributes:
        arrays: What was measured, by name; the last letters of a name are its unit. All of one prefix have the same
            length ``(n,)``.
        calibration: What is believed of the rig with what was found; ``None`` where nothing was, or where the axis is
            one's own and in no rig. Take it with ``rig.believing(...)``.
    """

    def __init__(
        self,
        text: str,
        arrays: Mapping[str, NDArray[np.float64]],
        calibration: Calibration | None,
    ) -> None:
        super().__init__(text)
        self.arrays = dict(arrays)
        self.calibration = calibration
