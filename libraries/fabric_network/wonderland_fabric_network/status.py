"""How a network does: what runs, how high its chain is, who leads, which contract, and which certificates end soon."""

from __future__ import annotations

import asyncio
import datetime as dt
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final

from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_network import certificates
from wonderland_fabric_network.leadership import is_leader
from wonderland_fabric_network.processes import listens

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from wonderland_fabric_network.network import Member, Network

TIMEOUT_S: Final = 5.0
_MOMENT: Final = "%Y-%m-%dT%H:%M:%SZ"
SOON: Final = dt.timedelta(days=30)
"""A certificate with less time left is worth renewing now."""


@dataclass(frozen=True)
class ComponentStatus:
    """A process. `pid` None when it does not run; `height` and the rest None where they do not apply or are unknown."""

    name: str
    kind: str
    pid: int | None
    address: str = ""
    height: int | None = None
    state: str = ""
    leader: bool | None = None
    contract: str | None = None
    trouble: str = ""


@dataclass(frozen=True)
class CertificateStatus:
    """A certificate of this network and how long it holds."""

    owner: str
    path: str
    expires: str
    days_left: int

    @property
    def soon(self) -> bool:
        """Whether it is worth renewing now."""
        return self.days_left < SOON.days


@dataclass(frozen=True)
class NetworkStatus:
    """All of it."""

    channel: str
    consensus: str
    elsewhere: bool
    """Whether something else runs the servers, so that there are no process ids here."""
    components: tuple[ComponentStatus, ...]
    certificates: tuple[CertificateStatus, ...]

    @property
    def healthy(self) -> bool:
        """Whether everything runs and answers."""
        return all((self.elsewhere or each.pid is not None) and not each.trouble for each in self.components)

    def exposition(self) -> bytes:
        """The same for Prometheus (text format 0.0.4): what runs, and until when each certificate is valid."""
        lines = [
            "# HELP wonderland_network_component_up 1 while the component runs and answers",
            "# TYPE wonderland_network_component_up gauge",
        ]
        for each in self.components:
            up = int((self.elsewhere or each.pid is not None) and not each.trouble)
            lines.append(f'wonderland_network_component_up{{component="{each.name}",kind="{each.kind}"}} {up}')
        lines += [
            "# HELP wonderland_network_certificate_expiry_timestamp_seconds End of a certificate of this network",
            "# TYPE wonderland_network_certificate_expiry_timestamp_seconds gauge",
        ]
        for one in self.certificates:
            end = dt.datetime.strptime(one.expires, _MOMENT).replace(tzinfo=dt.UTC).timestamp()
            lines.append(f'wonderland_network_certificate_expiry_timestamp_seconds{{owner="{one.owner}"}} {end:.0f}')
        return "\n".join(lines).encode() + b"\n"

    def as_json(self) -> dict[str, Any]:
        """JSON values, as `--json` prints them."""
        return {"healthy": self.healthy, **asdict(self)}


async def network_status(network: Network) -> NetworkStatus:
    """Ask every component that runs. Whatever does not answer is said to be in trouble, not raised."""
    async with asyncio.TaskGroup() as group:
        asked = [
            *(
                group.create_task(_listening(network, f"{msp_id}.ca", "ca", network.ca_address(msp_id)))
                for msp_id in network.msp_ids
            ),
            *(group.create_task(_orderer(network, member)) for member in network.orderers),
            *(group.create_task(_peer(network, member)) for member in network.peers),
            *(
                group.create_task(_listening(network, name, "contract", address))
                for name, address in network.running_contract_servers().items()
            ),
        ]
    return NetworkStatus(
        channel=network.channel,
        consensus=network.description.ordering.consensus,
        elsewhere=network.hosts.each,
        components=tuple(task.result() for task in asked),
        certificates=tuple(sorted(_certificates(network), key=lambda each: each.days_left)),
    )


async def _listening(network: Network, name: str, kind: str, address: str) -> ComponentStatus:
    pid = network.processes.pid(name)
    trouble = ""
    if network.hosts.each:
        host, _, port = address.rpartition(":")
        trouble = "" if await listens(host, int(port)) else "no answer"
    return ComponentStatus(name, kind, pid, address, trouble=trouble)


async def _orderer(network: Network, member: Member) -> ComponentStatus:
    pid = network.processes.pid(member.component)
    address = network.address(member)
    if pid is None and not network.hosts.each:
        return ComponentStatus(member.component, "orderer", None, address)
    try:
        async with asyncio.timeout(TIMEOUT_S), network.orderer_admin(member) as admin:
            part = await admin.status(network.channel)
    except (LedgerError, TimeoutError) as error:
        return ComponentStatus(member.component, "orderer", pid, address, trouble=str(error) or "no answer")
    if part is None:
        return ComponentStatus(
            member.component, "orderer", pid, address, trouble=f"has not joined {network.channel}; run `up` again"
        )
    leader = await is_leader(network.address(member, "operations"), network.channel)
    return ComponentStatus(
        member.component, "orderer", pid, address, part.height, f"{part.status} {part.relation}".strip(), leader
    )


async def _peer(network: Network, member: Member) -> ComponentStatus:
    pid = network.processes.pid(member.component)
    address = network.address(member)
    if pid is None and not network.hosts.each:
        return ComponentStatus(member.component, "peer", None, address)
    try:
        async with asyncio.timeout(TIMEOUT_S), network.peer_admin(member) as peer:
            height = await peer.height(network.channel)
            definition = await peer.definition(network.channel, network.description.contract.name)
    except (LedgerError, TimeoutError) as error:
        return ComponentStatus(member.component, "peer", pid, address, trouble=str(error) or "no answer")
    contract = None if definition is None else f"{definition.version} (sequence {definition.sequence})"
    return ComponentStatus(member.component, "peer", pid, address, height, contract=contract)


def _certificates(network: Network) -> Iterator[CertificateStatus]:
    now = network.now()
    for owner, path in network.certificate_files():
        try:
            end = certificates.load(path).not_valid_after_utc
        except LedgerError:
            continue
        yield CertificateStatus(owner, _relative(path, network), end.strftime(_MOMENT), (end - now).days)


def _relative(path: Path, network: Network) -> str:
    return str(path.relative_to(network.directory.path))
