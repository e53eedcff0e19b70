"""The receiver's shell: whatever the sources hear goes into the assembler, and out come positions and findings."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from wonderland_edge_agent.receiver.assembler import Assembler
from wonderland_edge_agent.receiver.errors import ReceiverError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wonderland.proofs.records.sessions import BroadcastClaim
    from wonderland.telemetry import Signature
    from wonderland_edge_agent.receiver.findings import Finding
    from wonderland_edge_agent.receiver.heard import Heard, ReceiverCounts
    from wonderland_edge_agent.receiver.limits import ReceiverLimits
    from wonderland_edge_agent.receiver.sources import Source
    from wonderland_edge_agent.receiver.sources.udp import UdpSource
    from wonderland_fira_uci.serial_port import Opener
    from wonderland_remote_id.drip.registry import Registry
    from wonderland_remote_id.framings.framed import Framed

OnHeard = Callable[["Heard"], None]
OnFinding = Callable[["Finding"], None]
ClockMs = Callable[[], int]


def system_clock_ms() -> int:
    """Unix time of this machine."""
    return time.time_ns() // 1_000_000


class RemoteIdReceiver:
    """Hears Remote ID; tells ``on_heard`` of each new position that has a drone's name, ``on_finding`` of oddities.

    ``listen`` is (host, port) of a UDP socket, port 0 for one that the system chooses (`address` says which);
    ``serial_ports`` are device paths or openers, each read as lines; ``sources`` are any others. ``drip`` are the
    registries whose signatures are believed; without them nobody's are looked at.

    >>> receiver = RemoteIdReceiver(listen=("127.0.0.1", 0), on_heard=lambda heard: spool.offer(...))
    >>> await receiver.start(); receiver.address
    >>> receiver.recent("1581F5FKD229400A1234", since_ms)
    """

    def __init__(
        self,
        *,
        listen: tuple[str, int] | None = None,
        serial_ports: Sequence[str | Opener] = (),
        sources: Sequence[Source] = (),
        on_heard: OnHeard | None = None,
        on_finding: OnFinding | None = None,
        clock_ms: ClockMs = system_clock_ms,
        limits: ReceiverLimits | None = None,
        drip: Registry | None = None,
    ) -> None:
        self._clock_ms = clock_ms
        self._on_heard = on_heard
        self._on_finding = on_finding
        self._assembler = Assembler(clock_ms(), limits, drip)
        self._udp: UdpSource | None = None
        self._sources = list(sources)
        if listen is not None:
            from wonderland_edge_agent.receiver.sources.udp import UdpSource  # noqa: PLC0415 - each source only where it is used

            self._udp = UdpSource(*listen)
            self._sources.append(self._udp)
        if serial_ports:
            from wonderland_edge_agent.receiver.sources.serial import SerialLines  # noqa: PLC0415 - as above

            self._sources += [SerialLines(f"serial:{index}", port) for index, port in enumerate(serial_ports)]

    @property
    def address(self) -> tuple[str, int]:
        """Where it listens for datagrams. Raises `ReceiverError` when it does not."""
        if self._udp is None:
            raise ReceiverError("the Remote ID receiver does not listen for datagrams")
        return self._udp.address

    @property
    def counts(self) -> ReceiverCounts:
        """What became of the frames so far."""
        return self._assembler.counts

    async def start(self) -> None:
        """Begin to hear. Raises `ReceiverError` when a source cannot be had; then none is left open."""
        for source in self._sources:
            try:
                await source.start(self)
            except ReceiverError:
                await self.close()
                raise

    async def close(self) -> None:
        """Stop hearing; what was heard stays readable."""
        for source in self._sources:
            await source.close()

    def recent(self, uav_id: str, since_ms: int) -> tuple[BroadcastClaim, ...]:
        """What was heard of a drone from ``since_ms`` (the pad's clock) on, as far as it is remembered."""
        return self._assembler.recent(uav_id, since_ms)

    def unsure(self, uav_id: str, since_ms: int) -> tuple[BroadcastClaim, ...]:
        """Positions since then that may be a watched drone's, of transmitters that named others as well."""
        return self._assembler.unsure(uav_id, since_ms)

    def signature(self, uav_id: str, since_ms: int) -> Signature | None:
        """Who signed what was heard of a drone from ``since_ms`` on; None where nothing was signed."""
        return self._assembler.signature(uav_id, since_ms)

    def watch(self, uav_id: str) -> None:
        """Keep this drone's history whatever flood comes: call it when a session begins."""
        self._assembler.watch(uav_id)

    def unwatch(self, uav_id: str) -> None:
        """End what `watch` began."""
        self._assembler.unwatch(uav_id)

    def take_frame(self, frame: bytes, *, source: str, transport: str, rssi_dbm: int | None = None) -> None:
        """Take a bare frame from any other transport; ``source`` tells transmitters apart."""
        self._feed(frame, source=source, transport=transport, rssi_dbm=rssi_dbm)

    def take_framed(self, framed: Framed, source: str) -> None:
        """Take a frame out of its wrapping; ``source`` is the receiver that heard it."""
        self._feed(
            framed.frame,
            source=f"{source}:{framed.transport}:{framed.address}" if framed.address else source,
            transport=framed.transport,
            rssi_dbm=framed.rssi_dbm,
            counter=framed.counter,
            address=framed.address,
        )

    def take_bad(self) -> None:
        """Count what should have held a frame and does not."""
        self._assembler.count_bad()

    def _feed(
        self,
        frame: bytes,
        *,
        source: str,
        transport: str,
        rssi_dbm: int | None = None,
        counter: int | None = None,
        address: str | None = None,
    ) -> None:
        heard = self._assembler.feed(
            frame,
            source=source,
            transport=transport,
            now_ms=self._clock_ms(),
            rssi_dbm=rssi_dbm,
            counter=counter,
            address=address,
        )
        if heard is not None and self._on_heard is not None:
            self._on_heard(heard)
        for finding in self._assembler.findings():
            if self._on_finding is not None:
                self._on_finding(finding)
