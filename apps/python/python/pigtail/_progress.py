"""How far something is: a bar in a terminal or a notebook, or whatever a caller makes of it."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeAlias

from ._errors import InputError

Progress: TypeAlias = "bool | Callable[[int, int, str], object] | None"
"""How to show progress: a bar (``True``), nothing (``False``), a bar where somebody can see it (``None``), or a function
that is called with how much is done, of how much (0 where nobody knows), and what is being done."""

_Called: TypeAlias = "Callable[[int, int, str], object] | None"


def _seen() -> bool:
    """Whether there is a terminal or a notebook."""
    # That a kernel's module was imported does not make this its process.
    shell: object = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    if getattr(shell, "kernel", None) is not None:
        return True
    return sys.stderr is not None and sys.stderr.isatty()


@contextmanager
def shown(progress: Progress, what: str) -> Iterator[_Called]:
    """What to call with progress, while the block runs."""
    if callable(progress):
        yield progress
        return
    if progress is not None and not isinstance(progress, bool):
        message = f"progress: is {progress!r}; accepted is True, False, None or what is called with (done, total, text)"
        raise InputError(message, key="progress", value=repr(progress))
    if progress is False or (progress is None and not _seen()):
        yield None
        return
    with warnings.catch_warnings():
        # In a notebook without widgets its bar is text, and that is well.
        warnings.simplefilter("ignore")
        from tqdm.auto import tqdm

    bar: Any = tqdm(desc=what, leave=False)

    def tell(done: int, total: int, text: str) -> None:
        if total and bar.total != total:
            # What was done before says nothing about how fast this is.
            bar.reset(total)
            bar.initial = done
            bar.n = done
        bar.set_postfix_str(text, refresh=False)
        bar.update(done - bar.n)
        bar.refresh()

    try:
        yield tell
    finally:
        bar.close()
