"""What the service counts, in Prometheus's terms. Names begin with ``wonderland_contract_``; times in seconds."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, ProcessCollector, generate_latest

BUCKETS_S: Final = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 30.0)
OTHER: Final = "other"


class Metrics:
    """The counters of one service, with a registry of their own."""

    def __init__(self, functions: Collection[str] = ()) -> None:
        """`functions` get a label of their own; any other name that a client makes up is counted as "other"."""
        self.registry: Final = CollectorRegistry()
        self._functions = frozenset(functions)
        self._transactions = Counter(
            "wonderland_contract_transactions",
            "Transactions ended: ok, refused by the contract, fault of the contract, unavailable, bad message",
            ("function", "outcome"),
            registry=self.registry,
        )
        self._seconds = Histogram(
            "wonderland_contract_transaction_seconds",
            "From the transaction's arrival to its answer, the peer's reads and writes included",
            ("function",),
            buckets=BUCKETS_S,
            registry=self.registry,
        )
        self._questions = Counter(
            "wonderland_contract_peer_calls", "Reads and writes asked of peers", ("kind",), registry=self.registry
        )
        self._waited = Counter(
            "wonderland_contract_peer_call_seconds",
            "Seconds for which transactions waited for peers",
            registry=self.registry,
        )
        self.in_flight: Final = Gauge(
            "wonderland_contract_transactions_in_flight", "Transactions under way", registry=self.registry
        )
        self.streams: Final = Gauge("wonderland_contract_streams", "Peers connected", registry=self.registry)
        self.connections: Final = Counter(
            "wonderland_contract_connections", "Streams that peers opened", registry=self.registry
        )
        self.protocol_errors: Final = Counter(
            "wonderland_contract_protocol_errors", "Streams ended for what the peer sent", registry=self.registry
        )
        self.unexpected: Final = Counter(
            "wonderland_contract_unexpected_messages", "Messages of peers that were ignored", registry=self.registry
        )
        self.certificate_expiry: Final = Gauge(
            "wonderland_contract_tls_certificate_expiry_timestamp_seconds",
            "When the TLS certificate expires; 0 without TLS",
            registry=self.registry,
        )
        self._version = Gauge(
            "wonderland_contract_info",
            "1, with what runs",
            ("contract", "version", "package_id"),
            registry=self.registry,
        )
        ProcessCollector(registry=self.registry)

    def finished(self, function: str, outcome: str, seconds: float) -> None:
        """One transaction has its answer."""
        label = function if function in self._functions else OTHER
        self._transactions.labels(label, outcome).inc()
        self._seconds.labels(label).observe(seconds)

    def asked(self, kind: str, seconds: float) -> None:
        """One read or write of a transaction was answered, or given up."""
        self._questions.labels(kind).inc()
        self._waited.inc(seconds)

    def runs(self, contract: str, version: str, package_id: str) -> None:
        """Say what runs."""
        self._version.labels(contract, version, package_id).set(1)

    def exposition(self) -> bytes:
        """All of it, as Prometheus reads it (text format 0.0.4)."""
        return generate_latest(self.registry)
