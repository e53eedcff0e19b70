"""Ends a contract that does not come to its end, as a Fabric peer does after ``chaincode.executetimeout`` (30 s).

The contract runs in the ledger's own thread, so that one that loops for ever would stop the whole ledger. A thread
watches how long it takes, says so, and raises an exception in its midst. What waits inside a C function for ever cannot
be ended like that; then at least the log tells why nothing is answered.
"""

from __future__ import annotations

import contextlib
import ctypes
import logging
import threading
import time
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterator

DEFAULT_LIMIT_S: Final = 30.0
LOOKS_PER_LIMIT: Final = 10
_log: Final = logging.getLogger(__name__)


class ContractOvertimeError(BaseException):
    """Raised inside the contract. No Exception, so that no contract takes it for one of its own."""


class Watchdog:
    """Watches one thread. `watch` may be entered once at a time; `close` ends the watching thread."""

    def __init__(self, limit_s: float = DEFAULT_LIMIT_S) -> None:
        self.limit_s: Final = limit_s
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._watched: tuple[str, float, int] | None = None
        self._raised = False
        self._thread: threading.Thread | None = None

    @contextlib.contextmanager
    def watch(self, what: str) -> Iterator[None]:
        """Raises `ContractOvertimeError` inside when that takes longer than the limit. `what` is for the log."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._look, name="contract-watchdog", daemon=True)
            self._thread.start()
        with self._lock:
            self._raised = False
            self._watched = what, time.monotonic() + self.limit_s, threading.get_ident()
        try:
            yield
        finally:
            with self._lock:
                self._watched = None
                if self._raised:
                    # If it has not come out yet, it must not come out anywhere else.
                    _set_asynchronous_exception(threading.get_ident(), None)

    def close(self) -> None:
        """End the watching thread."""
        self._closed.set()
        if self._thread is not None:
            self._thread.join()

    def _look(self) -> None:
        while not self._closed.wait(self.limit_s / LOOKS_PER_LIMIT):
            with self._lock:
                if self._watched is None or self._raised:
                    continue
                what, deadline, thread_id = self._watched
                if time.monotonic() < deadline:
                    continue
                self._raised = True
                _set_asynchronous_exception(thread_id, ContractOvertimeError)
            _log.critical("%s takes longer than %g s and is ended; nobody was answered meanwhile", what, self.limit_s)


def _set_asynchronous_exception(thread_id: int, kind: type[BaseException] | None) -> None:
    """Have an exception raised in a thread between two of its instructions; None takes back one that is due."""
    exception = None if kind is None else ctypes.py_object(kind)
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread_id), exception)
