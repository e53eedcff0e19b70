"""What a pad's agent is told in ``pad.toml``; every complaint names the field.

pad_id = "pad-1"
connection = "ledger/connection.json"   # paths are relative to this file
identity = "pad"                        # a name in connection.json
spool = "spool"                         # a directory of this pad's own

[[anchors]]                             # the first one also speaks to the drone
anchor_id = "A1"                        # as commissioned
port = "/dev/serial/by-id/usb-…"        # or socket://HOST:PORT, rfc2217://HOST:PORT
baud_rate = 115200                      # optional; flow_control = "rtscts" beside it

[uwb]                                   # only for a pad of DWM1001 anchors, which have no ports: no [[anchors]] then;
kind = "dwm1001"                        # drones measure and report by UDP, so that proofs have assurance 0
listen = "0.0.0.0:5481"

[remote_id]
listen = "127.0.0.1:5480"               # UDP; or serial = ["/dev/ttyUSB4"], mavlink = [...], bluetooth = "hci0",
                                        # wifi = "wlan1" (monitor mode), replay = "heard.pcap"

[remote_id.mqtt]                        # a receiver that publishes JSON over MQTT
host = "broker.example"
topics = ["dronescout/#"]

[drift]
every_s = 600                           # how often the anchors range each other when no drone is there; 0: never

[backend]
url = "wss://console.example/ingest"    # optional: where telemetry goes
tls_ca = "console-ca.pem"               # optional: its certificate authority, where it is not a public one
"""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, TypeVar
from urllib.parse import urlsplit

from wonderland.proofs.records.fields import ID_PATTERN
from wonderland_edge_agent.metrics import SUFFIX
from wonderland_edge_agent.receiver.settings import ReceiverSettings, parse_receivers
from wonderland_fira_uci.serial_port import BAUD_RATE, Opener, serial_opener, url_problem

MAX_FILE_BYTES: Final = 256 * 1024
MAX_ANCHORS: Final = 8
MIN_ANCHORS: Final = 3
_ID: Final = re.compile(ID_PATTERN)
_MIB: Final = 1 << 20
Value = TypeVar("Value")


class SettingsError(Exception):
    """pad.toml is missing, is no TOML, or holds something that a pad cannot work with; the text names the field."""


@dataclass(frozen=True, slots=True)
class AnchorSetting:
    """One UWB node: the anchor's name as commissioned, and its serial port."""

    anchor_id: str
    port: str
    """Path of a device, or ``socket://HOST:PORT``, ``rfc2217://HOST:PORT``."""
    baud_rate: int = BAUD_RATE
    flow_control: str = "none"
    """``none`` or ``rtscts``."""

    def opener(self) -> Opener:
        """Opens the node's port."""
        return serial_opener(self.port, self.baud_rate, rtscts=self.flow_control == "rtscts")


@dataclass(frozen=True, slots=True, kw_only=True)
class PadSettings:
    """Everything that a pad's agent is told. Paths are absolute."""

    pad_id: str
    connection: Path
    identity: str
    spool: Path
    anchors: tuple[AnchorSetting, ...]
    quota_bytes: int = 64 * _MIB
    prekeys: int = 20
    whole_certificate: bool = False
    permission_command: tuple[str, ...] = ()
    remote_id_listen: tuple[str, int] | None = None
    remote_id_serial: tuple[str, ...] = ()
    receivers: ReceiverSettings = field(default_factory=ReceiverSettings)
    backend_url: str = ""
    backend_tls_ca: Path | None = None
    backend_plaintext: bool = False
    """Whether the backend may be another machine without TLS: the network itself is protected."""
    drift_every_s: int = 600
    """How often the anchors range each other while no drone is there; 0: never."""
    metrics_file: Path | None = None
    """Where the agent writes its metrics for the node exporter's textfile collector; None: nowhere."""
    reports_listen: tuple[str, int] | None = None
    """Where drones with a DWM1001 report; None where the pad has nodes of its own."""

    @property
    def status_file(self) -> Path:
        """Where the agent says how it is, for ``wonderland pad status``."""
        return self.spool / "status.json"

    @property
    def baseline_file(self) -> Path:
        """What the anchors measured to each other when they were commissioned."""
        return self.spool / "anchors.json"

    @property
    def checkpoint_file(self) -> Path:
        """Where the agent notes how far it has read the ledger's events."""
        return self.spool / "events.json"


def load(path: Path) -> PadSettings:
    """Read a file. Raises SettingsError."""
    try:
        with path.open("rb") as file:
            data = file.read(MAX_FILE_BYTES + 1)
    except OSError as cause:
        raise SettingsError(f"{path}: cannot be read ({cause.strerror or cause})") from cause
    if len(data) > MAX_FILE_BYTES:
        raise SettingsError(f"{path}: larger than {MAX_FILE_BYTES} bytes; is it the right file?")
    try:
        document = tomllib.loads(data.decode("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as cause:
        raise SettingsError(f"{path}: no TOML: {cause}") from cause
    return parse(document, path)


def parse(document: dict[str, Any], path: Path) -> PadSettings:
    """Settings from a decoded document; ``path`` is the file's, for relative paths and for error texts."""
    top = _Table(document, path, "")
    remote_id = top.table("remote_id")
    backend = top.table("backend")
    drift = top.table("drift")
    reports_listen = _reports_listen(top, top.table("uwb"))
    anchors = tuple(_anchor(entry) for entry in top.tables("anchors"))
    if reports_listen is None and not MIN_ANCHORS <= len(anchors) <= MAX_ANCHORS:
        raise top.wrong("anchors", f"has {len(anchors)} entries; a pad has {MIN_ANCHORS} to {MAX_ANCHORS}")
    for name in ("anchor_id", "port"):
        if len({getattr(anchor, name) for anchor in anchors}) != len(anchors):
            raise top.wrong("anchors", f"two entries have the same {name}")
    settings = PadSettings(
        pad_id=top.identifier("pad_id"),
        connection=top.path("connection"),
        identity=top.text("identity", "pad"),
        spool=top.path("spool"),
        anchors=anchors,
        quota_bytes=top.integer("quota_mb", 64, 1, 1_000_000) * _MIB,
        prekeys=top.integer("prekeys", 20, 1, 50),
        whole_certificate=top.flag("whole_certificate", default=False),
        permission_command=top.texts("permission_command"),
        remote_id_listen=remote_id.address("listen"),
        remote_id_serial=remote_id.texts("serial"),
        receivers=parse_receivers(remote_id),
        backend_url=backend.url("url"),
        backend_tls_ca=backend.path("tls_ca") if backend.has("tls_ca") else None,
        backend_plaintext=backend.flag("plaintext", default=False),
        drift_every_s=drift.integer("every_s", 600, 0, 86_400),
        metrics_file=_metrics_file(top),
        reports_listen=reports_listen,
    )
    for table in (top, remote_id, backend, drift):
        table.refuse_unknown()
    return settings


def _anchor(entry: _Table) -> AnchorSetting:
    port = entry.text("port")
    problem = url_problem(port)
    if problem:
        raise entry.wrong("port", f"is {port!r}: {problem}")
    flow_control = entry.text("flow_control", "none")
    if flow_control not in {"none", "rtscts"}:
        raise entry.wrong(
            "flow_control", f"is {flow_control!r}; none and rtscts are known (XON and XOFF are data here)"
        )
    baud_rate = entry.integer("baud_rate", BAUD_RATE, 1_200, 12_000_000)
    return AnchorSetting(entry.identifier("anchor_id"), port, baud_rate, flow_control)


def _metrics_file(top: _Table) -> Path | None:
    if not top.has("metrics_file"):
        return None
    path = top.path("metrics_file")
    if path.suffix != SUFFIX:
        raise top.wrong("metrics_file", f"is {path.name}; the node exporter reads files that end in {SUFFIX} only")
    return path


def _reports_listen(top: _Table, uwb: _Table) -> tuple[str, int] | None:
    """The address for drones' reports, on a pad whose anchors are DWM1001 boards."""
    kind = uwb.text("kind", "uci")
    listen = uwb.address("listen")
    uwb.refuse_unknown()
    if kind not in {"uci", "dwm1001"}:
        raise uwb.wrong("kind", f"is {kind!r}; uci and dwm1001 are known")
    if kind == "uci":
        if listen is not None:
            raise uwb.wrong("listen", 'is for kind = "dwm1001"; nodes that speak UCI hang on serial ports')
        return None
    if listen is None:
        raise uwb.wrong("listen", "is missing; drones have to report somewhere, for example 0.0.0.0:5481")
    if top.has("anchors"):
        raise top.wrong("anchors", 'has no place beside uwb.kind = "dwm1001": these anchors have no serial ports')
    return listen


class _Table:
    """One table of the file; each getter checks a field and remembers that it is known."""

    def __init__(self, fields: dict[str, Any], path: Path, prefix: str) -> None:
        self._fields = fields
        self._path = path
        self._prefix = prefix
        self._known: set[str] = set()

    def wrong(self, name: str, why: str) -> SettingsError:
        """The error for a field."""
        return SettingsError(f"{self._path}: {self._prefix}{name} {why}")

    def has(self, name: str) -> bool:
        """Whether the field is there."""
        self._known.add(name)
        return name in self._fields

    def text(self, name: str, default: str | None = None) -> str:
        """A non-empty string."""
        value = self._get(name, str, "a text in quotes", default)
        if not value or "\0" in value:
            raise self.wrong(name, "is empty" if not value else "holds a NUL character")
        return value

    def identifier(self, name: str) -> str:
        """A name as the ledger's records allow it."""
        value = self.text(name)
        if not _ID.fullmatch(value):
            raise self.wrong(
                name, f"is {value!r}; letters, digits and . _ : - are allowed, beginning with one of the first"
            )
        return value

    def path(self, name: str) -> Path:
        """A path, relative to the file."""
        return (self._path.resolve().parent / Path(self.text(name)).expanduser()).absolute()

    def texts(self, name: str) -> tuple[str, ...]:
        """A list of non-empty strings; empty where it is missing."""
        values = self._get(name, list, "a list of texts", [])
        if any(not isinstance(value, str) or not value for value in values):
            raise self.wrong(name, "is not a list of texts")
        return tuple(values)

    def integer(self, name: str, default: int, minimum: int, maximum: int) -> int:
        """A whole number within bounds."""
        value = self._get(name, int, "a whole number", default)
        if isinstance(value, bool) or not minimum <= value <= maximum:
            raise self.wrong(name, f"is {value}; {minimum} to {maximum} are allowed")
        return value

    def flag(self, name: str, *, default: bool) -> bool:
        """True or false."""
        return self._get(name, bool, "true or false", default)

    def address(self, name: str) -> tuple[str, int] | None:
        """``host:port``; None where it is missing. Without a host, ``:5480``, it is this machine alone."""
        if not self.has(name):
            return None
        host, separator, port = self.text(name).rpartition(":")
        if not (separator and port.isascii() and port.isdigit() and len(port) <= 5 and int(port) < 65_536):
            raise self.wrong(name, "is not host:port, for example 127.0.0.1:5480")
        return host.strip("[]") or "127.0.0.1", int(port)

    def url(self, name: str) -> str:
        """A WebSocket address; empty where it is missing."""
        if not self.has(name):
            return ""
        value = self.text(name)
        try:
            parts = urlsplit(value)
            usable = parts.scheme in {"ws", "wss"} and bool(parts.hostname) and parts.port != 0
        except ValueError:
            usable = False
        if not usable:
            raise self.wrong(name, "is no WebSocket address, for example wss://console.example/ingest")
        return value

    def table(self, name: str) -> _Table:
        """A table; empty where it is missing."""
        return _Table(self._get(name, dict, "a table", {}), self._path, f"{self._prefix}{name}.")

    def tables(self, name: str) -> list[_Table]:
        """A list of tables, each of whose fields must be known."""
        entries = self._get(name, list, "a list of tables", [])
        out = []
        for index, entry in enumerate(entries):
            if not isinstance(entry, dict):
                raise self.wrong(f"{name}[{index}]", "is not a table")
            table = _Table(entry, self._path, f"{self._prefix}{name}[{index}].")
            unknown = sorted(set(entry) - {"anchor_id", "port", "baud_rate", "flow_control"})
            if unknown:
                raise table.wrong(unknown[0], "is unknown")
            out.append(table)
        return out

    def refuse_unknown(self) -> None:
        """A misspelt field must not be ignored."""
        unknown = sorted(set(self._fields) - self._known)
        if unknown:
            raise self.wrong(unknown[0], f"is unknown; known are {', '.join(sorted(self._known))}")

    def _get(self, name: str, kind: type[Value], what: str, default: Value | None) -> Value:
        self._known.add(name)
        value = self._fields.get(name, default)
        if value is None:
            raise self.wrong(name, "is missing")
        if not isinstance(value, kind):
            raise self.wrong(name, f"is not {what}")
        return value
