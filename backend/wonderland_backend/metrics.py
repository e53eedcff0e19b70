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
        mirror, hub, intake, uspace = self.mirror, self.hub, self.intake, self.uspace
        yield _gauge("backend_on_duty", "1 where it mirrors and takes in, 0 where another does", int(self.on_duty()))
        yield _gauge("mirror_blocks", "Blocks mirrored", mirror.mirrored)
        yield _gauge("mirror_height_blocks", "Blocks that the ledger is known to have", mirror.height)
        yield _gauge("mirror_lag_seconds", "Since when the mirror is behind", mirror.lag_ms(self.clock()) / 1000)
        yield _gauge(
            "mirror_halted", "1 when the mirror has halted until somebody looks", int(mirror.halted is not None)
        )
        yield _gauge("mirror_rows_differ", "Rows that were not what the ledger says", len(mirror.rows_differ))
        yield _gauge(
            "mirror_rows_checked_timestamp_seconds",
            "When all rows were last compared with the ledger; 0 before the first time",
            (mirror.rows_checked_ms or 0) / 1000,
        )
        yield _gauge(
            "mirror_alone", "1 while no other organisation confirms validity", int(mirror.alone_since_ms is not None)
        )
        yield _gauge("mirror_connected", "1 while the ledger can be reached", int(mirror.connected))
        yield _counter("mirror_transactions", "Transactions mirrored since the start", mirror.transactions)
        yield _counter("mirror_unread_writes", "Writes that could not be read since the start", mirror.unread)
        yield _gauge("ingest_agents", "Agents connected", len(self.agents))
        yield _counter("ingest_records", "Agents' records taken in since the start", intake.records)
        yield _counter("ingest_rejected", "Agents' records rejected since the start", intake.rejected)
        yield _gauge("live_clients", "Live connections", len(hub))
        yield _counter("live_frames", "Live frames queued for clients since the start", hub.frames)
        yield _counter("live_bytes", "Characters of these; of those that go packed, bytes", hub.bytes)
        yield _counter("live_closed_slow", "Live connections closed because they fell behind", hub.closed_slow)
        yield _gauge("uspace_flights", "Flights that other U-space systems are told of", uspace.served)
        yield _gauge("uspace_areas", "Identification service areas that stand in the DSS", len(uspace.areas))
        yield _counter("uspace_problems", "Times that an area could not be announced", uspace.problems)


MetricsDep = Annotated[Metrics, part(Metrics)]


def _gauge(name: str, text: str, value: float) -> Metric:
    return GaugeMetricFamily(f"wonderland_{name}", text, value=value)


def _counter(name: str, text: str, value: float) -> Metric:
    return CounterMetricFamily(f"wonderland_{name}", text, value=value)
