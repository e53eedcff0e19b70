"""Virtual nodes, their air and the hosts' state machines in virtual time: as fast as the processor, and repeatable."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Coroutine
from typing import Any

from wonderland_fira_uci.uci.config import SessionConfig
from wonderland_fira_uci.uci.data import DataReceive, DataTransferStatus
from wonderland_fira_uci.uci.device import UciDevice
from wonderland_fira_uci.uci.device_events import SessionEnded, SessionMessage
from wonderland_fira_uci.uci.ranging import RangeData, TwoWayMeasurement
from wonderland_simulator.uci_node import Air, Measurement, NodeProfile, VirtualNode

STEP_MS = 5


class VirtualLoop(asyncio.SelectorEventLoop):
    """An event loop that never waits: its clock jumps to whatever is due next."""

    def __init__(self) -> None:
        super().__init__()
        self._virtual_s = 100.0
        really: Any = self._selector.select  # type: ignore[attr-defined]

        def select(timeout: float | None) -> Any:
            self._virtual_s += timeout or 0.0
            return really(0)

        self._selector.select = select  # type: ignore[attr-defined]

    def time(self) -> float:
        return self._virtual_s


class Host:
    """One host and its node, on a line without delay."""

    def __init__(self, name: str, air: Air, profile: NodeProfile) -> None:
        self.node = VirtualNode(name, air, profile=profile)
        self.device = UciDevice()
        self._said: list[bytes] = []
        self.node.transmit = self._said.append
        self.messages: list[SessionMessage] = []
        self.ended: dict[int, str] = {}

    def settle(self, now_ms: int) -> None:
        """Until neither has anything to say."""
        self.device.advance(now_ms)
        while True:
            out = self.device.data_to_send()
            if out:
                self.node.receive(out)
            said, self._said[:] = list(self._said), []
            for octets in said:
                self.device.receive_data(octets, now_ms)
            for event in self.device.events():
                if isinstance(event, SessionMessage):
                    self.messages.append(event)
                elif isinstance(event, SessionEnded):
                    self.ended[event.session_id] = str(event.error or "")
            if not out and not said:
                return

    def active(self, session_id: int) -> bool:
        session = self.device._sessions.get(session_id)
        return session is not None and session.active

    # What it heard

    def reports(self, session_id: int) -> list[RangeData]:
        return [m.message for m in self.messages if m.session_id == session_id and isinstance(m.message, RangeData)]

    def records(self, session_id: int) -> list[TwoWayMeasurement]:
        return [record for report in self.reports(session_id) for record in report.two_way]

    def data(self, session_id: int) -> list[bytes]:
        return [
            m.message.data
            for m in self.messages
            if m.session_id == session_id and isinstance(m.message, DataReceive) and m.message.data
        ]

    def transfers(self) -> list[int]:
        return [m.message.status for m in self.messages if isinstance(m.message, DataTransferStatus)]


class VirtualAir:
    """Hosts by name on one air; ``range_mm`` by a pair's names (5 m where it is not given)."""

    def __init__(self, *, seed: int = 1, **air: Any) -> None:
        self.loop = VirtualLoop()
        self.ranges_mm: dict[frozenset[str], int | None] = {}
        options: dict[str, Any] = {"jitter_ms": 1.0, "reach": self.range_mm, "clock_s": self.loop.time}
        self.air = Air(self.measure, rng=random.Random(seed), **(options | air))
        self.hosts: dict[str, Host] = {}

    @property
    def now_ms(self) -> int:
        return round(self.loop.time() * 1_000)

    def range_mm(self, one: str, other: str) -> int | None:
        return self.ranges_mm.get(frozenset((one, other)), 5_000)

    def measure(self, observer: str, peer: str, t_s: float) -> Measurement:
        return Measurement(self.range_mm(observer, peer))

    def _within(self, work: Coroutine[Any, Any, None]) -> None:
        self.loop.run_until_complete(work)

    def add(self, name: str, profile: NodeProfile) -> Host:
        host = self.hosts[name] = Host(name, self.air, profile)

        async def boot() -> None:
            host.node.power_on()
            host.device.port_up(self.now_ms)
            host.settle(self.now_ms)

        self._within(boot())
        return host

    def open(self, name: str, *configs: SessionConfig | None) -> None:
        async def work() -> None:
            for config in configs:
                if config is not None:
                    self.hosts[name].device.open_session(config, self.now_ms)
                    self.hosts[name].settle(self.now_ms)

        self._within(work())

    def close_sessions(self, name: str) -> None:
        async def work() -> None:
            host = self.hosts[name]
            for session_id in list(host.device._sessions):
                host.device.close_session(session_id, self.now_ms)
            host.settle(self.now_ms)

        self._within(work())

    def close(self) -> None:
        """Ends all sessions."""

        async def work() -> None:
            for host in self.hosts.values():
                host.node.power_off()
            self.air.close()

        self._within(work())

    def send(self, name: str, session_id: int, data: bytes) -> bool:
        """Whether the node took it."""
        host = self.hosts[name]
        if not host.device.has_credit(session_id):
            return False

        destination = host.device._sessions[session_id].config.app.destination_macs[0]

        async def work() -> None:
            host.device.send_data(session_id, destination, data, self.now_ms)
            host.settle(self.now_ms)

        self._within(work())
        return True

    def run(self, ms: float) -> None:
        async def work() -> None:
            end_s = self.loop.time() + ms / 1_000
            while self.loop.time() < end_s - 1e-6:
                await asyncio.sleep(min(STEP_MS / 1_000, end_s - self.loop.time()))
                for host in self.hosts.values():
                    host.settle(self.now_ms)

        self._within(work())
