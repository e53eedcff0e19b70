"""Metrics in Prometheus's text format, read from the running parts when asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Annotated, Final

from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from wonderland_backend.agents.connected import Agents
from wonderland_backend.context import part
from wonderland_backend.ingest.intake import Intake
from wonderland_backend.live.hub import Hub
from wonderland_backend.mirror.status import MirrorStatus
from wonderland_backend.uspace.service import USpace

CONTENT_TYPE: Final = CONTENT_TYPE_LATEST


@dataclass(frozen=True, eq=False)
class Metrics(Collector):
    """Looks at the parts. `clock` gives milliseconds since the Unix epoch."""

    mirror: MirrorStatus
    hub: Hub
    agents: Agents
    intake: Intake
    uspace: USpace
    clock: Callable[[], int]
    on_duty: Callable[[], bool]

    def exposition(self) -> bytes:
        """The text that Prometheus reads."""
        registry = CollectorRegistry()
        registry.register(self)
        return generate_latest(registry)

    def collect(self) -> Iterable[Metric]:
        """The metrics of now."""
        return [each.kind(each.name, each.text, value=each.value(self)) for each in FAMILIES]


@dataclass(frozen=True, slots=True)
class Family:
    """A metric of the backend; none has labels."""

    kind: type[CounterMetricFamily | GaugeMetricFamily]
    name: str
    text: str
    value: Callable[[Metrics], float]


def _gauge(name: str, text: str, value: Callable[[Metrics], float]) -> Family:
    return Family(GaugeMetricFamily, f"wonderland_{name}", text, value)


def _counter(name: str, text: str, value: Callable[[Metrics], float]) -> Family:
    return Family(CounterMetricFamily, f"wonderland_{name}_total", text, value)


FAMILIES: Final = (
    _gauge("backend_on_duty", "1 where it mirrors and takes in, 0 where another does", lambda of: of.on_duty()),
    _gauge("mirror_blocks", "Blocks mirrored", lambda of: of.mirror.mirrored),
    _gauge("mirror_height_blocks", "Blocks that the ledger is known to have", lambda of: of.mirror.height),
    _gauge("mirror_lag_seconds", "Since when the mirror is behind", lambda of: of.mirror.lag_ms(of.clock()) / 1000),
    _gauge(
        "mirror_halted",
        "1 when the mirror has halted until somebody looks",
        lambda of: of.mirror.halted is not None,
    ),
    _gauge("mirror_rows_differ", "Rows that were not what the ledger says", lambda of: len(of.mirror.rows_differ)),
    _gauge(
        "mirror_rows_checked_timestamp_seconds",
        "When all rows were last compared with the ledger; 0 before the first time",
        lambda of: (of.mirror.rows_checked_ms or 0) / 1000,
    ),
    _gauge(
        "mirror_alone",
        "1 while no other organisation confirms validity",
        lambda of: of.mirror.alone_since_ms is not None,
    ),
    _gauge("mirror_connected", "1 while the ledger can be reached", lambda of: of.mirror.connected),
    _counter("mirror_transactions", "Transactions mirrored since the start", lambda of: of.mirror.transactions),
    _counter("mirror_unread_writes", "Writes that could not be read since the start", lambda of: of.mirror.unread),
    _gauge("ingest_agents", "Agents connected", lambda of: len(of.agents)),
    _counter("ingest_records", "Agents' records taken in since the start", lambda of: of.intake.records),
    _counter("ingest_rejected", "Agents' records rejected since the start", lambda of: of.intake.rejected),
    _gauge("live_clients", "Live connections", lambda of: len(of.hub)),
    _counter("live_frames", "Live frames queued for clients since the start", lambda of: of.hub.frames),
    _counter("live_bytes", "Characters of these; of those that go packed, bytes", lambda of: of.hub.bytes),
    _counter("live_closed_slow", "Live connections closed because they fell behind", lambda of: of.hub.closed_slow),
    _gauge("uspace_flights", "Flights that other U-space systems are told of", lambda of: of.uspace.served),
    _gauge("uspace_areas", "Identification service areas that stand in the DSS", lambda of: len(of.uspace.areas)),
    _counter("uspace_problems", "Times that an area could not be announced", lambda of: of.uspace.problems),
)
"""All of them, in the order in which they are told."""

MetricsDep = Annotated[Metrics, part(Metrics)]
