"""Writes the reference of every Prometheus metric (``make docs``).

The backend's from their definitions; those of parts that write their text themselves from what they say of a sample.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from pages import prose, table, write

from wonderland_backend.metrics import FAMILIES
from wonderland_chaincode.service.metrics import Metrics as ContractMetrics
from wonderland_edge_agent import metrics as pad
from wonderland_fabric_network.status import CertificateStatus, ComponentStatus, NetworkStatus

Row = tuple[str, str, str, str]
"""Name, type, labels, what it is."""
PAD = {
    "pad_id": "", "version": "", "t_ms": 0, "accepts_sessions": True, "session": None, "sessions_run": 0,
    "requests_waiting": 0, "sessions_to_end": 0, "prekeys": 0, "anchors": [{"anchor_id": "", "state": "up"}],
    "spool": {"records": 0, "bytes": 0, "dropped": 0}, "receiver": {"frames": 0, "bad": 0},
}  # fmt: skip
NETWORK = NetworkStatus(
    channel="",
    consensus="",
    elsewhere=True,
    components=(ComponentStatus("", "peer", None),),
    certificates=(CertificateStatus("", "", "2030-01-01T00:00:00Z", 0),),
)


def page() -> str:
    """The whole page in Markdown. Raises ValueError for a metric that says nothing of itself."""
    kinds = {"CounterMetricFamily": "counter", "GaugeMetricFamily": "gauge"}
    backend = [(each.name, kinds[each.kind.__name__], "", each.text) for each in FAMILIES]
    lines = [
        "# Metrics",
        "",
        "Made by `make docs` from the metrics’ own definitions; do not edit. In Prometheus’s text format; how to",
        "collect them and what to look at is in [monitoring](../operate/monitoring.md). Peers, orderers and CAs have",
        "Fabric’s own beside these. The drone’s agent and the bridges to ROS have none: they listen for nothing.",
        "",
        "## Backend",
        "",
        "`GET /api/v1/metrics`, with the metrics token.",
        "",
        *_table(backend),
        "",
        "## Pad’s agent",
        "",
        "In the file that `metrics_file` in [`pad.toml`](settings.md#pad-pad-toml) names.",
        "",
        *_table(_told(pad.exposition(PAD))),
        "",
        "## Contract server",
        "",
        "`/metrics` at the address that [`--metrics`](commands.md#wonderland-chaincode-serve) gives.",
        "",
        *_table(_told(_contract())),
        "",
        "## Network",
        "",
        "In the file that [`wonderland network status --metrics`](commands.md#wonderland-network-status) names.",
        "",
        *_table(_told(NETWORK.exposition())),
    ]
    return "\n".join(lines) + "\n"


def _contract() -> bytes:
    metrics = ContractMetrics()
    metrics.finished("", "ok", 0.0)
    metrics.asked("", 0.0)
    metrics.info.set(1, contract="", version="", package_id="")
    return metrics.exposition()


def _told(exposition: bytes) -> list[Row]:
    """What a text says of its metrics."""
    text = exposition.decode()
    kinds = dict(re.findall(r"^# TYPE (\S+) (\S+)$", text, re.MULTILINE))
    found = []
    for name, said in re.findall(r"^# HELP (\S+) (.+)$", text, re.MULTILINE):
        samples = re.findall(rf"^{name}(?:_bucket)?\{{(.*)\}} ", text, re.MULTILINE)
        labels = dict.fromkeys(label for each in samples for label in re.findall(r'(\w+)="', each))
        found.append((name, kinds[name], ", ".join(f"`{label}`" for label in labels if label != "le"), said))
    return found


def _table(rows: Iterable[Row]) -> list[str]:
    shown = []
    for name, kind, labels, text in rows:
        if not text.strip():
            raise ValueError(f"{name} does not say what it is")
        shown.append((f"`{name}`", kind, labels, prose(text)))
    return table(("Metric", "Type", "Labels", ""), shown)


if __name__ == "__main__":
    write(page)
