"""How the pad is, in Prometheus's terms: a file that the machine's node exporter takes along (textfile collector).

A file and no port: a pad listens for nothing that it does not need. Names begin with ``wonderland_pad_``. Source:
Prometheus exposition formats, text format 0.0.4.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from wonderland_fabric_gateway.files import PUBLIC, write_atomic

PREFIX: Final = "wonderland_pad_"
SUFFIX: Final = ".prom"
"""The node exporter reads files of that name only."""


def exposition(status: Mapping[str, Any]) -> bytes:
    """The text for a status document as the agent writes it."""
    lines: list[str] = []
    for name, kind, text, samples in _families(status):
        lines += [f"# HELP {PREFIX}{name} {text}", f"# TYPE {PREFIX}{name} {kind}"]
        lines += [
            f"{PREFIX}{name}{_labels({'pad_id': status['pad_id'], **labels})} {value}" for labels, value in samples
        ]
    return "\n".join(lines).encode() + b"\n"


def write_metrics(path: Path, status: Mapping[str, Any]) -> None:
    """Replace the file, readable by all. Raises LedgerError (FileWriteError) when the disk does not take it."""
    write_atomic(path, exposition(status), PUBLIC)


_Sample = tuple[dict[str, str], float | int]


def _families(status: Mapping[str, Any]) -> Iterator[tuple[str, str, str, list[_Sample]]]:
    spool, receiver = status["spool"], status["receiver"]

    def one(name: str, kind: str, text: str, value: float) -> tuple[str, str, str, list[_Sample]]:
        return name, kind, text, [({}, value)]

    yield "info", "gauge", "Version of the agent", [({"version": str(status["version"])}, 1)]
    yield one("status_timestamp_seconds", "gauge", "When this was written", status["t_ms"] / 1000)
    yield one("accepts_sessions", "gauge", "1 while the pad can prove", int(bool(status["accepts_sessions"])))
    unknown = int(bool(status.get("not_known")))
    yield one("not_known", "gauge", "1 while nothing has shown whether the anchors range", unknown)
    yield one("session_under_way", "gauge", "1 while a drone is being ranged", int(bool(status["session"])))
    yield one("sessions_total", "counter", "Sessions run since the start", status["sessions_run"])
    yield one("requests_waiting", "gauge", "Drones that wait for the pad", status["requests_waiting"])
    yield one("sessions_to_end", "gauge", "Sessions whose end the ledger has not got yet", status["sessions_to_end"])
    if status.get("prekeys") is not None:
        yield one("prekeys", "gauge", "Keys on the ledger that drones may use", status["prekeys"])
    yield one("spool_records", "gauge", "Records that wait for the backend", spool["records"])
    yield one("spool_bytes", "gauge", "Bytes of these", spool["bytes"])
    yield one("spool_dropped_total", "counter", "Telemetry dropped for want of room", spool["dropped"])
    yield one("remote_id_frames_total", "counter", "Remote ID frames heard since the start", receiver["frames"])
    yield one("remote_id_bad_total", "counter", "Frames of these that could not be read", receiver["bad"])
    yield (
        "anchor_up",
        "gauge",
        "1 while the node answers",
        [({"anchor_id": str(each["anchor_id"])}, int(each["state"] == "up")) for each in status["anchors"]],
    )


def _labels(labels: Mapping[str, str]) -> str:
    inside = ",".join(f'{name}="{_escaped(value)}"' for name, value in labels.items())
    return f"{{{inside}}}"


def _escaped(text: str) -> str:
    return text.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n")
