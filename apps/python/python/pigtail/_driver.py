"""One thread on which a bench is called, for whoever asks from others: what is under way there, and when it is over."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from ._errors import Error, Refused
from .bench import Batch, Bench, Done, Failed, Light

T = TypeVar("T")

_SLICE_S = 0.05
LONGEST_S = 120.0


class Status:
    """Something that was begun: as bluesky's protocol of the same name has it."""

    def __init__(self) -> None:
        self._over = threading.Event()
        self._error: BaseException | None = None
        self._lock = threading.Lock()
        self._callbacks: list[Callable[[Status], None]] = []

    def _finish(self, error: BaseException | None = None) -> None:
        with self._lock:
            if self._over.is_set():
                return
            self._error = error
            self._over.set()
            callbacks, self._callbacks = self._callbacks, []
        for callback in callbacks:
            callback(self)

    def add_callback(self, callback: Callable[[Status], None]) -> None:
        """Calls this when it is done; at once where it is."""
        with self._lock:
            if not self._over.is_set():
                self._callbacks.append(callback)
                return
        callback(self)

    @property
    def done(self) -> bool:
        """Whether it is over."""
        return self._over.is_set()

    @property
    def success(self) -> bool:
        """Whether it is over and went well."""
        return self.done and self._error is None

    def exception(self, timeout: float | None = 0.0) -> BaseException | None:
        """Why it did not go well; waits for so long until it is over."""
        if not self._over.wait(timeout):
            raise TimeoutError("it is not over")
        return self._error

    def wait(self, timeout: float | None = None) -> None:
        """Waits until it is over, and raises what went wrong."""
        error = self.exception(timeout)
        if error is not None:
            raise error


@dataclass
class Waiting:
    """What is under way on the bench's thread."""

    status: Status
    end_s: float
    ticket: int | None = None
    # Or a sample of light after this time...
    after_s: float | None = None
    # ...which goes here.
    into: Callable[[Light], None] | None = None
    # Or until this time.
    until_s: float | None = None


class Driver:
    """The one thread on which a bench is called."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.began = time.time() - bench.now_s
        self.hears: list[Callable[[Light], None]] = []
        self.busy = ""
        self._jobs: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self.waiting: list[Waiting] = []
        threading.Thread(target=self._run, name=f"pigtail {bench.caps.name}", daemon=True).start()

    def do(self, job: Callable[[], T]) -> T:
        """What it gives when it is called there."""
        if self.busy:
            raise Error(f"the bench is busy: {self.busy}")
        given: list[T] = []
        status = self.post(lambda: given.append(job()))
        status.wait()
        return given[0]

    def post(self, job: Callable[[], object]) -> Status:
        """Calls it there, and says when that is over."""
        status = Status()

        def work() -> None:
            try:
                job()
            except BaseException as error:  # noqa: BLE001  (it is raised where it is waited for)
                status._finish(error)
            else:
                status._finish()

        self._jobs.put(work)
        return status

    def begin(self, job: Callable[[], Waiting]) -> Status:
        """Begins something there; its status is done when what was begun is."""
        status = Status()

        def work() -> None:
            try:
                waiting = job()
            except BaseException as error:  # noqa: BLE001
                status._finish(error)
                return
            waiting.status.add_callback(lambda of: status._finish(of.exception()))
            self.waiting.append(waiting)

        self._jobs.put(work)
        return status

    def let_go(self, statuses: Sequence[Status], error: BaseException | None) -> None:
        """Ends statuses, on the bench's thread."""
        self.waiting = [of for of in self.waiting if of.status not in statuses]
        for status in statuses:
            status._finish(error)

    def _run(self) -> None:
        while True:
            try:
                job = self._jobs.get(block=not self.waiting)
            except queue.Empty:
                self._pump()
            else:
                job()

    def _pump(self) -> None:
        now = self.bench.now_s
        ends = [of.until_s for of in self.waiting if of.until_s is not None]
        try:
            event = self.bench.next(min([now + _SLICE_S, *ends]))
        except BaseException as error:  # noqa: BLE001
            self.let_go([of.status for of in self.waiting], error)
            return
        lights = (event,) if isinstance(event, Light) else event.lights if isinstance(event, Batch) else ()
        for light in lights:
            for hear in list(self.hears):
                hear(light)
        now = self.bench.now_s
        over: list[tuple[Status, Exception | None]] = []
        for of in self.waiting:
            if isinstance(event, Done) and event.ticket == of.ticket:
                over.append((of.status, None))
            elif isinstance(event, Failed) and event.ticket == of.ticket:
                over.append((of.status, Refused(event.why)))
            elif of.after_s is not None and (heard := [light for light in lights if light.time_s >= of.after_s]):
                if of.into is not None:
                    of.into(heard[0])
                over.append((of.status, None))
            elif of.until_s is not None and now >= of.until_s - 1e-9:
                over.append((of.status, None))
            elif now > of.end_s:
                over.append((of.status, TimeoutError(f"not done within {LONGEST_S:g} s of the bench's time")))
        for status, why in over:
            self.let_go([status], why)
