"""The notebooks run from their first cell to their last, and make the pictures that the book shows.

``PIGTAIL_PICTURES=folder`` keeps the pictures, and executed notebooks beside them.
"""

from __future__ import annotations

import base64
import os
from pathlib import Path

import pytest

from conftest import ROOT

nbclient = pytest.importorskip("nbclient")
nbformat = pytest.importorskip("nbformat")
pytest.importorskip("ipykernel")
pytest.importorskip("matplotlib")

NOTEBOOKS = ROOT / "apps" / "python" / "notebooks"
PICTURES = {"first-light": 3, "my-algorithm": 2, "my-axis": 2, "dask": 1}


def test_all_are_run() -> None:
    assert {path.stem for path in NOTEBOOKS.glob("*.ipynb")} == set(PICTURES)


@pytest.mark.parametrize("name", PICTURES)
def test_a_notebook_runs(name: str, tmp_path: Path) -> None:
    if name == "dask":
        pytest.importorskip("distributed")
    notebook = nbformat.read(NOTEBOOKS / f"{name}.ipynb", as_version=4)
    # Kept without what running it gave.
    assert not any(cell.get("outputs") for cell in notebook.cells)
    nbclient.NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [of for cell in notebook.cells for of in cell.get("outputs", [])]
    pictures = [of.data["image/png"] for of in outputs if "image/png" in of.get("data", {})]
    assert len(pictures) == PICTURES[name]
    if name == "first-light":
        # The bar of what takes long, as a widget.
        assert any("application/vnd.jupyter.widget-view+json" in of.get("data", {}) for of in outputs)
    if name != "dask":  # which says there that a worker is gone
        assert all(of.name == "stdout" for of in outputs if of.output_type == "stream"), outputs
    if kept := os.environ.get("PIGTAIL_PICTURES"):
        Path(kept).mkdir(parents=True, exist_ok=True)
        nbformat.write(notebook, Path(kept) / f"{name}.ipynb")
        for k, picture in enumerate(pictures, 1):
            (Path(kept) / f"{name}-{k}.png").write_bytes(base64.b64decode(picture))
    # What it writes, it writes where it was told to.
    assert not list(tmp_path.iterdir())
