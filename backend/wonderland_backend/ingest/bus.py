"""Agents that come by a bus of Zenoh: the same as by WebSocket, with TLS of their own within (docs/decisions/0044)."""

from __future__ import annotations

import ssl
from typing import Final

from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding

from wonderland.telemetry import end_point_of
from wonderland_backend.agents.members import Seen
from wonderland_backend.auth.gate import TRY_LATER
from wonderland_backend.auth.store.sign_ins import SignIns
from wonderland_backend.errors import SettingsError, SetUpRequired
from wonderland_backend.ingest.serving import Ingest
from wonderland_backend.settings.bus import BusSettings
from wonderland_bus.backend import Doorway, Listener
from wonderland_bus.channel import Channel
from wonderland_bus.errors import BusSettingsError
from wonderland_bus.settings import Member, Tls

PING_S: Final = 20.0


def member_of(settings: BusSettings) -> Member:
    """How this backend is on the bus. Raises `SettingsError`."""
    member = Member(
        routers=settings.routers, tls=Tls(ca=settings.ca, certificate=settings.certificate, key=settings.key)
    )
    try:
        member.check()
    except BusSettingsError as cause:
        raise SettingsError(f"bus: {cause}") from None
    return member


class BusIngest:
    """Takes agents in for as long as its `listener` runs."""

    def __init__(self, settings: BusSettings, ingest: Ingest, sign_ins: SignIns) -> None:
        """Raises `SettingsError`."""
        self._ingest = ingest
        self._sign_ins = sign_ins
        member = member_of(settings)
        leaf: x509.Certificate = member.tls.own()[0]
        self._seen = frozenset({end_point_of(leaf.public_bytes(Encoding.DER))})
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.minimum_version = ssl.TLSVersion.TLSv1_3
        context.load_cert_chain(settings.certificate, settings.key)
        ingest.members.tls.serve(context)
        limits = ingest.context.settings
        doorway = Doorway(
            member=member,
            context=context,
            max_channels=limits.ingest_max_agents,
            max_frame_bytes=limits.ingest_max_bytes,
            ping_s=PING_S,
        )
        self.listener = Listener(doorway, self._serve)

    async def _serve(self, channel: Channel, shown: bytes) -> None:
        if not await self._sign_ins.is_set_up():
            await channel.close(TRY_LATER, str(SetUpRequired.example))
            return
        await self._ingest.serve(channel, lambda: Seen(self._seen, shown))
