"""New certificates before the old ones end, one server at a time, so that the network goes on.

An orderer keeps its key: the channel's configuration names its certificates, and Fabric compares their keys. Everything
else gets a new key. Contract servers take the new files by themselves, peers and orderers are restarted. Former
certificates are not revoked; they end by themselves.
"""

from __future__ import annotations

import asyncio
import datetime as dt
import json
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from wonderland_fabric_gateway.certificates import revocation_list_of
from wonderland_fabric_gateway.files import write_atomic
from wonderland_fabric_network import certificates, settings
from wonderland_fabric_network.errors import NetworkError, UnreachableError
from wonderland_fabric_network.hosts import CONTRACT
from wonderland_fabric_network.layout import REGISTRAR
from wonderland_fabric_network.leadership import wait_leader
from wonderland_fabric_network.network import Member, Network

if TYPE_CHECKING:
    from pathlib import Path

    from wonderland_fabric_network.authorities import Authority
    from wonderland_fabric_network.binaries import Binaries
    from wonderland_fabric_network.bringing_up import Report
    from wonderland_fabric_network.layout import NodeDirectory
    from wonderland_fabric_network.processes import Launch

DEFAULT_DAYS: Final = 30
SETTLE_S: Final = 30.0
_POLL_S: Final = 0.1


@dataclass(frozen=True)
class Wanted:
    """Which certificates to renew: those of one name, or those that end within `days`; `everything` renews all."""

    days: int = DEFAULT_DAYS
    everything: bool = False
    name: str = ""

    def chooses(self, name: str, path: Path, now: dt.datetime) -> bool:
        """Whether a certificate is meant."""
        if not path.exists():
            return False
        if self.name:
            return name == self.name
        return self.everything or certificates.load(path).not_valid_after_utc - now < dt.timedelta(days=self.days)


async def renew(
    network: Network, binaries: Binaries, wanted: Wanted, report: Report, *, msp_id: str | None = None
) -> list[str]:
    """Renew what is wanted, and restart the servers that it concerns and that run. Raises `LedgerError`.

    Returns whose certificates are new. CAs that do not run are started for it, and stay.
    """
    done: list[str] = []
    for each in network.msp_ids:
        if msp_id in {None, each}:
            done += await _Renewal(network, binaries, wanted, report, each).run()
    return done


class _Renewal:
    """One organisation's."""

    def __init__(self, network: Network, binaries: Binaries, wanted: Wanted, report: Report, msp_id: str) -> None:
        self._network = network
        self._binaries = binaries
        self._wanted = wanted
        self._report = report
        self._msp_id = msp_id
        self._organisation = network.directory.organisation(msp_id)
        self._done: list[str] = []

    async def run(self) -> list[str]:
        authority = self._network.authority(self._msp_id)
        await self._server(authority)
        async with authority:
            if self._chooses(REGISTRAR, self._organisation.identity(REGISTRAR).certificate):
                await authority.renew_registrars()
                self._note(REGISTRAR)
            await self._identities(authority)
            for member in self._network.orderers:
                if member.msp_id == self._msp_id:
                    await self._orderer(authority, member)
            for member in self._network.peers:
                if member.msp_id == self._msp_id:
                    await self._peer(authority, member)
            await self._contract(authority)
        return self._done

    async def _server(self, authority: Authority) -> None:
        """The CA's own TLS certificate: it makes a new one when there is none at its start."""
        tls = self._organisation.ca_home / "tls-cert.pem"
        if self._chooses("ca", tls):
            await self._network.processes.stop(authority.component)
            tls.unlink()
            self._note("ca")
        authority.configure()
        await authority.start(self._network.processes, self._binaries.ca_server)

    async def _identities(self, authority: Authority) -> None:
        crl = revocation_list_of(await authority.ca.revocation_list(await authority.registrar()))
        revoked = {entry.serial_number for entry in crl}
        for file in sorted(self._organisation.identity("x").certificate.parent.glob("*.pem")):
            name, is_tls = file.stem.removesuffix(".tls"), file.stem.endswith(".tls")
            if name == REGISTRAR or not self._chooses(name, file):
                continue
            if certificates.load(file).serial_number in revoked:
                self._report("certificates", f"{self._msp_id}/{name} is revoked and stays as it is")
                continue
            if is_tls:
                await authority.renew_tls(name, self._organisation.tls_identity(name))
            else:
                await authority.renew(name, self._organisation.identity(name))
            self._note(file.stem)

    async def _orderer(self, authority: Authority, member: Member) -> None:
        if await self._node(authority, member, keep_key=True):
            await self._restart(member.component, self._configured_orderer(member))
            await self._caught_up(member)

    async def _caught_up(self, member: Member) -> None:
        """Wait until an orderer takes part again: two away at a time could be one too many."""
        deadline = time.monotonic() + SETTLE_S
        while self._network.processes.pid(member.component) is not None:
            heights = [await self._height(each) for each in self._network.orderers]
            own = heights[self._network.orderers.index(member)]
            if own and own >= max(heights):
                await wait_leader(self._network)
                return
            if time.monotonic() > deadline:
                raise self._network.processes.failure(
                    member.component, f"has {own} blocks of {max(heights)}, {SETTLE_S:g} s after it was restarted"
                )
            await asyncio.sleep(_POLL_S)

    async def _height(self, member: Member) -> int:
        """An orderer's blocks; 0 when it does not run or does not take part."""
        try:
            async with self._network.orderer_admin(member) as admin:
                part = await admin.status(self._network.channel)
        except UnreachableError:
            return 0
        return part.height if part is not None and part.status == "active" else 0

    async def _peer(self, authority: Authority, member: Member) -> None:
        if await self._node(authority, member, keep_key=False):
            node = self._network.node(member)
            for file in (node.data / "externalbuilder").glob("builds/*/release/chaincode/server/connection.json"):
                _renew_connection(file, node)
            await self._restart(member.component, self._configured_peer(member))

    async def _node(self, authority: Authority, member: Member, *, keep_key: bool) -> bool:
        node = self._network.node(member)
        identity, tls = (self._chooses(member.name, each.certificate) for each in (node.identity, node.tls))
        if identity:
            await authority.renew(member.name, node.identity, keep_key=keep_key)
            self._note(member.name)
        if tls:
            await authority.renew_tls(member.name, node.tls, keep_key=keep_key)
            self._note(f"{member.name} TLS")
        return identity or tls

    async def _contract(self, authority: Authority) -> None:
        node = self._organisation.node(CONTRACT)
        if not self._chooses(CONTRACT, node.tls.certificate):
            return
        await authority.renew_tls(CONTRACT, node.tls)  # the server sees that the files changed
        self._note(f"{CONTRACT} TLS")

    def _configured_orderer(self, member: Member) -> Launch:
        self._network.configure_orderer(member)
        return self._network.launch_orderer(member, self._binaries)

    def _configured_peer(self, member: Member) -> Launch:
        self._network.configure_peer(member)
        return self._network.launch_peer(member, self._binaries)

    async def _restart(self, component: str, launch: Launch) -> None:
        if await self._network.processes.stop(component):
            self._network.processes.start(launch)
            await self._network.processes.wait_ready(launch)
            self._report("certificates", f"{component} restarted")
        elif self._network.hosts.each:
            self._report("certificates", f"restart {component}: it takes its new certificates when it starts")

    def _chooses(self, name: str, path: Path) -> bool:
        return self._wanted.chooses(name, path, self._network.now())

    def _note(self, name: str) -> None:
        self._done.append(f"{self._msp_id}/{name}")
        self._report("certificates", f"{self._msp_id}/{name} renewed")


def _renew_connection(file: Path, node: NodeDirectory) -> None:
    """A peer keeps the keys by which it reaches contract servers where its builder put them."""
    fresh: dict[str, Any] = json.loads(
        settings.builder_configuration(
            ("", ""), node.tls.certificate.read_bytes(), node.tls.key.read_bytes(), node.tls_root.read_bytes()
        )
    )
    try:
        connection = json.loads(file.read_bytes())
        connection.update({name: fresh[name] for name in ("client_cert", "client_key", "root_cert")})
    except (OSError, ValueError, AttributeError) as cause:
        raise NetworkError(f"{file}: cannot be renewed ({cause}); install the contract anew") from cause
    write_atomic(file, json.dumps(connection).encode())
