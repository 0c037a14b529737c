"""Campaigns: many devices, on the cores of one machine or of many."""

from __future__ import annotations

import os
import tempfile
import time
from typing import TYPE_CHECKING, Any, Protocol

from . import _pigtail
from ._document import Document
from ._errors import Error, InputError
from ._input import flag, maybe_text, maybe_whole, text, whole
from ._progress import Progress, shown
from ._rig import Rig, native

if TYPE_CHECKING:
    import pyarrow


class Client(Protocol):
    """What a campaign asks of a ``dask.distributed.Client``."""

    def map(self, func: Any, *iterables: Any, **options: Any) -> Any:
        """Calls a function with each item, somewhere."""

    def cancel(self, futures: Any) -> Any:
        """Gives up."""


class Campaign(Document):
    """What a campaign came to. ``print`` shows what ``pigtail campaign`` prints; as a mapping, and by :meth:`json`, it is
    what ``pigtail campaign --json`` prints. Its rows hold the twins' truth: it is there to judge."""

    def __init__(self, text: str, words: str, kept: object) -> None:
        super().__init__(text)
        self._words = words
        # A folder that is gone with this.
        self._kept = kept

    def __getstate__(self) -> dict[str, Any]:
        # A copy in another process does not keep the folder.
        return self.__dict__ | {"_kept": None}

    @property
    def path(self) -> str:
        """The Parquet file of the rows, one a fiber; what a column means is in its metadata. It is gone with this object
        where no ``runs`` were named."""
        return str(self["rows"])

    @property
    def rows_sha256(self) -> str:
        """SHA-256 of that file: the same for any number of shards, workers and threads."""
        return str(self["rows_sha256"])

    def to_arrow(self) -> pyarrow.Table:
        """The rows as an Arrow table; needs ``pyarrow``."""
        try:
            import pyarrow.parquet
        except ImportError as error:
            raise ImportError("tables of Arrow need pyarrow: pip install 'pigtail[arrow]'") from error
        return pyarrow.parquet.read_table(self.path)

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        return self.to_arrow().__arrow_c_stream__(requested_schema)

    def __str__(self) -> str:
        return self._words.rstrip("\n")


def run_shard(folder: str | os.PathLike[str], index: int, of: int, *, threads: int = 1) -> tuple[str | None, int]:
    """Runs one shard of a campaign, if nobody has yet: whatever runs it, on whatever machine, writes the same file.

    It is written beside its place and moved there whole. One that is killed leaves nothing that counts.

    Args:
        folder: The campaign's folder, by :func:`pigtail.campaign_folder`; all machines have to see the same.
        index: Which shard, from 1.
        of: Of how many.
        threads: Devices at a time.

    Returns:
        Its file (``None`` of a shard without devices), and how many devices were done just now: none if it was there.
    """
    of = whole("of", of, 1)
    index = whole("index", index, 1, of)
    return _pigtail.campaign_shard(text("folder", folder), index, of, whole("threads", threads, 1, 1024), None)


def campaign_folder(
    devices: int,
    rig: Rig | str | None = None,
    *,
    seed: int = 0,
    machines: int | None = None,
    procedure: str = "fast",
    faults: str | None = None,
    commissioned: bool = False,
    runs: str | os.PathLike[str] = "runs",
) -> str:
    """The folder below ``runs`` for the shards of a campaign, made if it is not there: whoever asks for the same
    campaign, with the same version, gets the same. Arguments as for :func:`pigtail.campaign`."""
    return os.fspath(_spec(devices, rig, seed, machines, procedure, faults, commissioned).folder(text("runs", runs)))


def merge(
    folder: str | os.PathLike[str], *, runs: str | os.PathLike[str] = "runs", progress: Progress = None
) -> Campaign:
    """Makes one campaign of all shards of a folder: a new run below ``runs``, with the rows that a campaign in one
    piece would have written, byte for byte. The shards stay where they are."""
    with shown(progress, "merge") as tell:
        return Campaign(*_pigtail.campaign_merge(text("folder", folder), text("runs", runs), tell), None)


def _spec(
    devices: int,
    rig: Rig | str | None,
    seed: int,
    machines: int | None,
    procedure: str,
    faults: str | None,
    commissioned: bool,
) -> _pigtail.Spec:
    return _pigtail.Spec(
        native(rig),
        text("procedure", procedure),
        whole("seed", seed),
        whole("devices", devices, 1),
        maybe_whole("machines", machines, 1),
        flag("commissioned", commissioned),
        maybe_text("faults", faults),
    )


def campaign(
    devices: int | None = None,
    rig: Rig | str | None = None,
    *,
    seed: int = 0,
    machines: int | None = None,
    procedure: str = "fast",
    faults: str | None = None,
    commissioned: bool = False,
    threads: int | None = None,
    runs: str | os.PathLike[str] | None = None,
    resume: str | os.PathLike[str] | None = None,
    client: Client | None = None,
    shards: int | None = None,
    progress: Progress = None,
) -> Campaign:
    """Aligns many devices, each on its own machine, and says how often and how well it went.

    Device ``i`` is the one that ``pigtail.align(seed=seed + i)`` aligns. The rows, and their hash, do not depend on
    threads, shards or workers.

    Args:
        devices: How many devices; with ``machines``, on each of them.
        rig: The rig, its folder or name; the one that is built in if not given.
        seed: The first device's seed; each next one has the next.
        machines: How many machines to align them on.
        procedure: How to align.
        faults: What breaks: ``"all"``, or names with commas.
        commissioned: Commission each machine first.
        threads: Devices at a time; one for each core if not given, and one with a ``client``.
        runs: Where to write the run's folder. If not given, nothing is kept: the rows are gone with the result.
        resume: Goes on with the campaign in this folder; nothing else is said then.
        client: A ``dask.distributed.Client``: shards are done by its workers, which must see the same ``runs`` under the
            same path, have the same version of pigtail, and read the same rig. A worker that is killed loses its
            shard's work at most: another one does it again.
        shards: Into how many shards; four for each of the client's threads if not given.
        progress: How to show progress; see :data:`pigtail.Progress`.

    Raises:
        InputError: For what is not accepted.
        KeyboardInterrupt: On Ctrl-C. Devices and machines that were begun are finished (with ``commissioned`` that takes
            seconds), and what is done is kept below ``runs``.
    """
    cores = os.cpu_count() or 1
    at_once = whole("threads", threads if threads is not None else (cores if client is None else 1), 1, 1024)
    if resume is not None:
        if devices is not None or client is not None:
            raise InputError("resume: goes without `devices` and `client`", key="resume", value=repr(resume))
        with shown(progress, "campaign") as tell:
            return Campaign(*_pigtail.campaign_resume(text("resume", resume), at_once, tell), None)
    if devices is None:
        raise InputError("devices: is missing; accepted is a whole number above zero", key="devices")
    spec = _spec(devices, rig, seed, machines, procedure, faults, commissioned)
    if client is None and shards is not None:
        raise InputError("shards: goes with a `client`; accepted is both", key="shards", value=repr(shards))
    if client is not None:
        if not all(hasattr(client, name) for name in ("map", "cancel", "nthreads")):
            message = f"client: is {client!r}; accepted is a dask.distributed.Client"
            raise InputError(message, key="client", value=repr(client))
        if runs is None:
            message = "runs: is missing; accepted is a folder that every worker of the client sees"
            raise InputError(message, key="runs")
        return _on_client(client, spec, shards, text("runs", runs), at_once, progress)
    kept = None
    if runs is None:
        kept = tempfile.TemporaryDirectory(prefix="pigtail-")
        runs = kept.name
    with shown(progress, "campaign") as tell:
        return Campaign(*spec.run(text("runs", runs), at_once, tell), kept)


def _on_client(
    client: Any, spec: _pigtail.Spec, shards: int | None, runs: str, threads: int, progress: Progress
) -> Campaign:
    folder = os.path.abspath(os.fspath(spec.folder(runs)))
    if shards is None:
        shards = 4 * max(1, sum(client.nthreads().values()))
    of = whole("shards", shards, 1)
    with shown(progress, "campaign") as tell:
        # A worker that dies is no mistake of a shard's: another one does it again.
        futures = client.map(
            _shard_on_worker,
            [(folder, index, of, threads) for index in range(1, of + 1)],
            key=[f"pigtail-{os.path.basename(folder)}-{index}-{of}" for index in range(1, of + 1)],
            retries=10,
        )
        try:
            left = list(futures)
            while left:
                time.sleep(0.05)
                left = [future for future in left if not future.done()]
                if tell is not None:
                    tell(of - len(left), of, "shards")
            missing = [future for future in futures if future.status != "finished"]
            if missing:
                missing[0].result()
                raise Error(f"{len(missing)} of {of} shards were not done: {missing[0].status}")
        except BaseException:
            client.cancel(futures)
            raise
    return merge(folder, runs=runs, progress=progress)


def _shard_on_worker(task: tuple[str, int, int, int]) -> str | None:
    folder, index, of, threads = task
    return run_shard(folder, index, of, threads=threads)[0]
