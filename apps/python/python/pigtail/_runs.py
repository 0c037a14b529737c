"""The store: every run that was made, and how."""

from __future__ import annotations

import json
import os
from typing import Any

from . import _pigtail
from ._document import Document
from ._input import text


class Runs:
    """A folder of runs, and the database in it.

    Args:
        folder: The folder, as ``pigtail ... --runs`` names it.

    Raises:
        InputError: When it is not there, or its database is damaged.
    """

    def __init__(self, folder: str | os.PathLike[str] = "runs") -> None:
        self.folder = text("folder", folder)
        self.list()

    def list(self) -> list[dict[str, Any]]:
        """The runs in the store, the newest last, with the keys of ``pigtail runs list --json``."""
        runs: list[dict[str, Any]] = json.loads(_pigtail.runs_list(self.folder))["runs"]
        return runs

    def show(self, run: str) -> Document:
        """All that is known of a run, with the keys of ``pigtail runs show --json``."""
        return Document(_pigtail.runs_show(self.folder, text("run", run)))

    def __getitem__(self, run: str) -> Document:
        return self.show(run)

    def __len__(self) -> int:
        return len(self.list())

    def __repr__(self) -> str:
        return f"<pigtail.Runs: {len(self)} in {self.folder}>"
