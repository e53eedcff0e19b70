"""What the service counts, in Prometheus's terms. Names begin with ``wonderland_contract_``; times in seconds.

Written out here instead of by the Prometheus client, which costs 3 MB of the 60 that a contract service may take.
Source: Prometheus exposition formats, text format 0.0.4.
"""

from __future__ import annotations

import bisect
import itertools
import os
import time
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

BUCKETS_S: Final = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 30.0)
OTHER: Final = "other"
PREFIX: Final = "wonderland_contract_"
_Labels = tuple[tuple[str, str], ...]
_STATM: Final = Path("/proc/self/statm")


@dataclass
class Value:
    """A number that goes up (a counter), or up and down (a gauge), for each set of labels."""

    name: str
    text: str
    kind: str = "counter"
    values: dict[_Labels, float] = field(default_factory=dict)

    def inc(self, by: float = 1.0, **labels: str) -> None:
        """Add `by` for this set of labels, which begins at 0."""
        key = tuple(labels.items())
        self.values[key] = self.values.get(key, 0.0) + by

    def dec(self) -> None:
        """Take one off a gauge that has no labels."""
        self.inc(-1.0)

    def set(self, value: float, **labels: str) -> None:
        """Set a gauge's value for this set of labels."""
        self.values[tuple(labels.items())] = value

    def lines(self) -> Iterator[str]:
        """Its lines of the exposition."""
        name = f"{PREFIX}{self.name}" if not self.name.startswith("process_") else self.name
        yield f"# HELP {name} {self.text}"
        yield f"# TYPE {name} {self.kind}"
        for labels, value in (self.values or {(): 0.0}).items():
            yield f"{name}{_labels(labels)} {_number(value)}"


@dataclass
class Durations:
    """How long something took, in buckets, for each function."""

    name: str
    text: str
    counts: dict[str, list[int]] = field(default_factory=dict)
    sums: dict[str, float] = field(default_factory=dict)

    def observe(self, function: str, seconds: float) -> None:
        """One took so long."""
        counts = self.counts.get(function)
        if counts is None:
            counts = self.counts[function] = [0] * (len(BUCKETS_S) + 1)
        counts[bisect.bisect_left(BUCKETS_S, seconds)] += 1
        self.sums[function] = self.sums.get(function, 0.0) + seconds

    def lines(self) -> Iterator[str]:
        """Its lines of the exposition."""
        name = f"{PREFIX}{self.name}"
        yield f"# HELP {name} {self.text}"
        yield f"# TYPE {name} histogram"
        for function, counts in self.counts.items():
            bounds = [*map(_number, BUCKETS_S), "+Inf"]
            for bound, count in zip(bounds, itertools.accumulate(counts), strict=True):
                yield f"{name}_bucket{_labels((('function', function), ('le', bound)))} {count}"
            labels = _labels((("function", function),))
            yield f"{name}_sum{labels} {_number(self.sums[function])}"
            yield f"{name}_count{labels} {sum(counts)}"


class Metrics:
    """The counters of one service."""

    def __init__(self, functions: Collection[str] = ()) -> None:
        """`functions` get a label of their own; any other name that a client makes up is counted as "other"."""
        self._functions = frozenset(functions)
        self._started_s = time.time()
        self.transactions: Final = Value(
            "transactions_total",
            "Transactions ended: ok, refused by the contract, fault of the contract, unavailable, bad message",
        )
        self.seconds: Final = Durations(
            "transaction_seconds", "From the transaction's arrival to its answer, reads and writes included"
        )
        self.peer_calls: Final = Value("peer_calls_total", "Reads and writes asked of peers")
        self.peer_seconds: Final = Value("peer_call_seconds_total", "Seconds for which transactions waited for peers")
        self.in_flight: Final = Value("transactions_in_flight", "Transactions under way", "gauge")
        self.streams: Final = Value("streams", "Peers connected", "gauge")
        self.connections: Final = Value("connections_total", "Streams that peers opened")
        self.protocol_errors: Final = Value("protocol_errors_total", "Streams ended for what the peer sent")
        self.unexpected: Final = Value("unexpected_messages_total", "Messages of peers that were ignored")
        self.certificate_expiry: Final = Value(
            "tls_certificate_expiry_timestamp_seconds", "When the TLS certificate expires; 0 without TLS", "gauge"
        )
        self.info: Final = Value("info", "1, with what runs", "gauge")

    def finished(self, function: str, outcome: str, seconds: float) -> None:
        """One transaction has its answer."""
        label = function if function in self._functions else OTHER
        self.transactions.inc(function=label, outcome=outcome)
        self.seconds.observe(label, seconds)

    def asked(self, kind: str, seconds: float) -> None:
        """One read or write of a transaction was answered, or given up."""
        self.peer_calls.inc(kind=kind)
        self.peer_seconds.inc(seconds)

    def exposition(self) -> bytes:
        """All of it, as Prometheus reads it."""
        lines = [line for each in vars(self).values() if isinstance(each, Value | Durations) for line in each.lines()]
        for each in _process(self._started_s):
            lines.extend(each.lines())
        return ("\n".join(lines) + "\n").encode()


def _process(started_s: float) -> Iterator[Value]:
    """The figures that every Prometheus client gives of its process."""
    yield Value("process_start_time_seconds", "When the process began to serve", "gauge", {(): started_s})
    yield Value("process_cpu_seconds_total", "Processor time", "counter", {(): time.process_time()})
    try:
        pages = int(_STATM.read_text().split()[1])
    except (OSError, ValueError, IndexError):
        return  # no Linux
    yield Value(
        "process_resident_memory_bytes", "Memory in use", "gauge", {(): float(pages * os.sysconf("SC_PAGE_SIZE"))}
    )


def _labels(labels: _Labels) -> str:
    if not labels:
        return ""
    return "{" + ",".join(f'{name}="{_escaped(value)}"' for name, value in labels) + "}"


def _escaped(text: str) -> str:
    return text.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n")


def _number(value: float) -> str:
    return str(int(value)) if float(value).is_integer() else repr(value)
