"""What the book's pages on Python say runs."""

import re
from pathlib import Path
from typing import Any

import pytest

from conftest import ROOT

PAGES: dict[str, tuple[str, ...]] = {
    "python.md": ("pyarrow",),
    "python-bench.md": (),
    "python-benchmark.md": (),
    "python-bluesky.md": ("bluesky",),
}


@pytest.mark.parametrize("page", PAGES)
def test_what_a_page_says_runs(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for needed in PAGES[page]:
        pytest.importorskip(needed)
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "book" / "src" / "howto" / page).read_text()
    blocks = re.findall(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    assert blocks
    known: dict[str, Any] = {}
    for block in blocks:
        exec(compile(block, page, "exec"), known)  # noqa: S102
    if page == "python-bench.md":
        assert [fiber.outcome for fiber in known["device"].fibers] == ["aligned"] * 3
    if page == "python-bluesky.md":
        assert known["documents"][-1][1]["exit_status"] == "success"
    assert not list(tmp_path.iterdir())
