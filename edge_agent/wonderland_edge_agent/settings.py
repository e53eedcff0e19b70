"""What a pad's agent is told in ``pad.toml``; every complaint names the field.

pad_id = "pad-1"
connection = "ledger/connection.json"   # paths are relative to this file
identity = "pad"                        # a name in connection.json
spool = "spool"                         # a directory of this pad's own
local_reports = "reports.sock"          # optional: where `wonderland ros2` listens to what this agent reports

[[anchors]]                             # one for each node
anchor_id = "A1"                        # as commissioned
port = "/dev/serial/by-id/usb-…"        # or socket://HOST:PORT, rfc2217://HOST:PORT
baud_rate = 115200                      # optional; flow_control = "rtscts" beside it
device_config = { "e301" = "4a40" }     # optional: its maker's parameters, hexadecimal (antenna delay, power)
power_cycle = ["uhubctl", "-l", "1-1", "-p", "2", "-a", "cycle"]   # optional: run when the node hangs for 20 s

[uwb]
words = "initiator"                     # for nodes that carry data as initiators only; usual: "both_ways"
region = "EU"                           # or UK, US, JP: whose channels may be used (wonderland uwb law)
kind = "dwm1001"                        # a pad of DWM1001 anchors, which have no ports: no [[anchors]] then; drones
listen = "0.0.0.0:5481"                 # measure and report by UDP. "dwm1001-tags": [[anchors]] are tags, which measure
                                        # an anchor on the drone. Proofs have assurance 0 with either

[remote_id]
listen = "127.0.0.1:5480"               # UDP; or serial = ["/dev/ttyUSB4"], mavlink = [...], bluetooth = "hci0",
                                        # wifi = "wlan1" (monitor mode), replay = "heard.pcap"

[remote_id.mqtt]                        # a receiver that publishes JSON over MQTT
host = "broker.example"
topics = ["dronescout/#"]

[drift]
every_s = 600                           # how often the anchors range each other when no drone is there; 0: never
roll_call_every_s = 10                  # how often a short look says whether all of them still range; 0: never

[truth]                                 # a motion capture, for trials: shown beside the estimates, and judges nothing
reference = "natnet:192.0.2.7#3"        # or ros2:/drone/pose, udp:127.0.0.1:5490
uav_id = "1AB0000001"                   # optional: whose place it is; else whichever drone proves itself
delay_ms = 12                           # optional: as `pad commission` finds it
record = "truth.csv"                    # optional: a file to which every position is added

[backend]
url = "wss://console.example/ingest"    # optional: where telemetry goes
tls_ca = "console-ca.pem"               # optional: its certificate authority, where it is not a public one
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Final, Literal
from urllib.parse import urlsplit

from msgspec import Meta

from wonderland.toml_settings import (
    Address,
    FieldError,
    Identifier,
    Table,
    Text,
    load_toml,
    parse_toml,
)
from wonderland.uwb.layout import CHANNELS
from wonderland.uwb.needs import in_region
from wonderland.uwb.regions import BY_CODE
from wonderland_edge_agent.metrics import SUFFIX
from wonderland_edge_agent.receiver.settings import ReceiverSettings
from wonderland_fira_uci.serial_port import BAUD_RATE, Opener, serial_opener, url_problem

MAX_ANCHORS: Final = 8
MIN_ANCHORS: Final = 3
DWM1001_CHANNEL: Final = 5
"""These boards have no other."""
_MIB: Final = 1 << 20


class AnchorSetting(Table, frozen=True):
    """One UWB node: the anchor's name as commissioned, and its port."""

    anchor_id: Identifier
    """The node’s name, as commissioned."""
    port: Text
    """Path of a device, or ``socket://HOST:PORT``, ``rfc2217://HOST:PORT``."""
    baud_rate: Annotated[int, Meta(ge=1_200, le=12_000_000)] = BAUD_RATE
    """Of the serial port."""
    flow_control: Literal["none", "rtscts"] = "none"
    """XON and XOFF are data here."""
    device_config: dict[str, str] | None = None
    """Parameters of the node's maker, id and value in hexadecimal: antenna delay, power."""
    power_cycle: tuple[Text, ...] = ()
    """A program with its arguments that takes the node's power away and gives it back; run when the node hangs."""

    def __post_init__(self) -> None:
        problem = url_problem(self.port)
        if problem:
            raise FieldError(f"port is {self.port!r}: {problem}")
        self.settings()

    def settings(self) -> tuple[tuple[bytes, bytes], ...]:
        """``device_config`` as octets. Raises FieldError."""
        given = self.device_config or {}
        try:
            found = tuple((bytes.fromhex(name), bytes.fromhex(value)) for name, value in given.items())
        except ValueError as error:
            raise FieldError('device_config: ids and values are hexadecimal, for example "e301" = "4a40"') from error
        if any(not 1 <= len(name) <= 2 or not 1 <= len(value) <= 255 for name, value in found):
            raise FieldError("device_config: ids have 1 or 2 octets, values 1 to 255")
        return found

    def opener(self) -> Opener:
        """Opens the node's port."""
        return serial_opener(self.port, self.baud_rate, rtscts=self.flow_control == "rtscts")


class UwbSettings(Table, frozen=True):
    """``[uwb]``: what the anchors are. A pad of DWM1001 boards has no ports; drones report to `listen`."""

    kind: Literal["uci", "dwm1001", "dwm1001-tags"] = "uci"
    """What the nodes speak: FiRa’s UCI, or DWM1001 boards’ own language, as anchors or as tags."""
    listen: Address | None = None
    """Where drones with a DWM1001 report what they measured (UDP)."""
    words: Literal["both_ways", "initiator"] = "both_ways"
    """Whether the pad's nodes carry data as responders, too. No node says so; some carry it as initiators alone."""
    region: Literal["EU", "UK", "US", "JP"] | None = None
    """Whose channels may be used (``wonderland uwb law``); left out: all that the nodes have."""

    def __post_init__(self) -> None:
        if self.kind == "uci" and self.listen is not None:
            raise FieldError('listen is for kind = "dwm1001"; nodes that speak UCI hang on serial ports')
        if self.kind != "uci" and self.listen is None:
            raise FieldError("listen is missing; drones have to report somewhere, for example 0.0.0.0:5481")
        if self.kind != "uci" and not in_region((DWM1001_CHANNEL,), self.region):
            channels = ", ".join(map(str, BY_CODE[self.region or ""].channels))
            raise FieldError(
                f"region {self.region} has channels {channels} alone, and DWM1001 boards use channel {DWM1001_CHANNEL}"
            )

    @property
    def channels(self) -> tuple[int, ...]:
        """Those that may be used."""
        return in_region(CHANNELS, self.region)


class DriftSettings(Table, frozen=True):
    """``[drift]``: how often the anchors range each other while no drone is there; 0: never."""

    every_s: Annotated[int, Meta(ge=0, le=86_400)] = 600
    """How often the anchors range each other while no drone is there; 0: never."""
    roll_call_every_s: Annotated[int, Meta(ge=0, le=86_400)] = 10
    """How often it is seen, while no drone is there, whether all nodes that answer also range; 0: never."""


class TruthSettings(Table, frozen=True):
    """``[truth]``: a motion capture or another reference, shown beside the estimates. It judges nothing."""

    reference: Text | None = None
    """``natnet:HOST[:PORT][#BODY]``, ``ros2:/TOPIC`` or ``udp:HOST:PORT``, in the survey’s frame; left out: none."""
    uav_id: Identifier | None = None
    """The drone that it follows; left out: whichever proves itself."""
    delay_ms: Annotated[int, Meta(ge=-10_000, le=10_000)] = 0
    """So old a position is when it comes, as ``pad commission`` finds it."""
    record: Path | None = None
    """A CSV to which every position is added, as ``--reference`` takes it; left out: none."""

    def __post_init__(self) -> None:
        if self.reference is None:
            if self.record is not None:
                raise FieldError("truth.record is given, and no truth.reference to record")
            return
        from wonderland_edge_agent.references.sources import (  # noqa: PLC0415 - few pads have one
            FORMS,
            parse_source,
        )

        try:
            source = parse_source(self.reference)
        except ValueError as error:
            raise FieldError(f"truth.reference: {error}") from None
        if source is None:
            raise FieldError(f"truth.reference: {self.reference} is a file; live it is {FORMS.removeprefix('a CSV, ')}")


class BackendSettings(Table, frozen=True):
    """``[backend]``: where telemetry goes."""

    url: Text | None = None
    """The backend’s WebSocket for agents, or where it is on a bus of Zenoh; left out: the pad reports to nobody."""
    tls_ca: Path | None = None
    """Its certificate authority (PEM), where it is not a public one."""
    plaintext: bool = False
    """Whether the backend may be another machine without TLS: the network itself is protected."""

    def __post_init__(self) -> None:
        try:
            parts = urlsplit(self.url or "ws://none")
            usable = parts.scheme == "zenoh+tls" or (
                parts.scheme in {"ws", "wss"} and bool(parts.hostname) and parts.port != 0
            )
        except ValueError:
            usable = False
        if not usable:
            raise FieldError(f"url is {self.url!r}: no address of a backend, for example wss://console.example/ingest")


class PadSettings(Table, frozen=True):
    """Everything that a pad's agent is told. Paths are absolute."""

    pad_id: Identifier
    """The pad’s name on the ledger."""
    connection: Path
    """``connection.json`` of the ledger."""
    spool: Path
    """A directory of this pad’s own: what waits for the backend, prekeys, state."""
    identity: Text = "pad"
    """A name in ``connection.json``."""
    anchors: tuple[AnchorSetting, ...] = ()
    uwb: UwbSettings = UwbSettings()
    quota_mb: Annotated[int, Meta(ge=1, le=1_000_000)] = 64
    """How much of the disk the spool may take, in MiB; the oldest telemetry goes first, never evidence."""
    prekeys: Annotated[int, Meta(ge=1, le=50)] = 20
    """How many keys for coming sessions are kept on the ledger."""
    whole_certificate: bool = False
    """Say the whole certificate over UWB, not its hash."""
    permission_command: tuple[Text, ...] = ()
    """A program with its arguments, run with the action and the session’s id once it is permitted."""
    remote_id: ReceiverSettings = ReceiverSettings()
    backend: BackendSettings = BackendSettings()
    drift: DriftSettings = DriftSettings()
    truth: TruthSettings = TruthSettings()
    metrics_file: Path | None = None
    """Where the agent writes its metrics for the node exporter's textfile collector; left out: nowhere."""
    local_reports: Path | None = None
    """Unix socket on which another program of this machine hears what is reported (`wonderland ros2`)."""

    def __post_init__(self) -> None:
        if self.uwb.kind == "dwm1001":
            if self.anchors:
                raise FieldError('anchors has no place beside uwb.kind = "dwm1001": these anchors have no serial ports')
        elif not MIN_ANCHORS <= len(self.anchors) <= MAX_ANCHORS:
            raise FieldError(f"anchors has {len(self.anchors)} entries; a pad has {MIN_ANCHORS} to {MAX_ANCHORS}")
        for name in ("anchor_id", "port"):
            if len({getattr(anchor, name) for anchor in self.anchors}) != len(self.anchors):
                raise FieldError(f"anchors: two entries have the same {name}")
        if self.metrics_file is not None and self.metrics_file.suffix != SUFFIX:
            raise FieldError(
                f"metrics_file is {self.metrics_file.name}; the node exporter reads files that end in {SUFFIX} only"
            )

    @property
    def quota_bytes(self) -> int:
        """How much of the disk the spool may take."""
        return self.quota_mb * _MIB

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
    return load_toml(path, PadSettings)


def parse(document: dict[str, Any], path: Path) -> PadSettings:
    """Settings from a decoded document; ``path`` is the file's, for relative paths and for error texts."""
    return parse_toml(document, path, PadSettings)
