"""Agreeing on a contract: each organisation installs and approves, then the channel commits.

Source: Fabric "Fabric chaincode lifecycle". Transactions of _lifecycle go through the Gateway of a peer of the
organisation that acts; each step may be repeated, and what is done already counts as done.
"""

from __future__ import annotations

import asyncio
import re
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import grpc
from fabric_protos.peer.lifecycle import lifecycle_pb2

from wonderland_fabric_gateway.channel_groups import serialise
from wonderland_fabric_gateway.gateway import EndorseError, Gateway, GatewayError, SubmitError
from wonderland_fabric_network.concurrency import together
from wonderland_fabric_network.errors import ComponentError, RefusedError
from wonderland_fabric_network.peers import LIFECYCLE, PeerAdmin

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Sequence

    from wonderland_fabric_gateway.identity import SigningIdentity
    from wonderland_fabric_network.contract import ContractPackage
    from wonderland_fabric_network.network import Network

PROBE: Final = ("ReadPolicy", b'{"action":"land","pad_id":"pad-1"}')
"""What is asked of the contract to see that it is reached."""
RETRY_S: Final = 45.0
_PAUSE_S: Final = 0.05
_PASSING: Final = frozenset(
    {
        # Gossip has not caught up, a peer is a block behind, the orderer has no leader yet.
        grpc.StatusCode.FAILED_PRECONDITION,
        grpc.StatusCode.UNAVAILABLE,
        grpc.StatusCode.ABORTED,
        grpc.StatusCode.NOT_FOUND,
    }
)
_DONE: Final = re.compile(
    r"attempted to redefine (uncommitted sequence .* with unchanged content|the current committed sequence "
    r"(?!.*with different parameters))",
    re.DOTALL,
)
_NOT_APPROVED: Final = (
    "could not fetch approved chaincode definition",
    # Approved, and the peer's ledger was lost with what it had approved: that is private to the organisation.
    "private data matching public hash version is not available",
)
_NEVER: Final = ("access denied", "invalid sequence", "requested sequence", "attempted to redefine")


@dataclass(frozen=True)
class Definition:
    """What the organisations are to agree on."""

    name: str
    sequence: int
    version: str
    validation_parameter: bytes

    def _fields(self) -> dict[str, Any]:
        return {
            "name": self.name,
            "sequence": self.sequence,
            "version": self.version,
            "endorsement_plugin": "escc",
            "validation_plugin": "vscc",
            "validation_parameter": self.validation_parameter,
        }

    def approve_argument(self, package_id: str | None) -> bytes:
        """For ApproveChaincodeDefinitionForMyOrg; without a package an organisation agrees and does not endorse."""
        source = (
            lifecycle_pb2.ChaincodeSource(unavailable=lifecycle_pb2.ChaincodeSource.Unavailable())
            if package_id is None
            else lifecycle_pb2.ChaincodeSource(local_package=lifecycle_pb2.ChaincodeSource.Local(package_id=package_id))
        )
        return serialise(lifecycle_pb2.ApproveChaincodeDefinitionForMyOrgArgs(source=source, **self._fields()))

    def commit_argument(self) -> bytes:
        """For CommitChaincodeDefinition."""
        return serialise(lifecycle_pb2.CommitChaincodeDefinitionArgs(**self._fields()))

    def readiness_argument(self) -> bytes:
        """For CheckCommitReadiness."""
        return serialise(lifecycle_pb2.CheckCommitReadinessArgs(**self._fields()))


async def install(peer: PeerAdmin, package: ContractPackage) -> None:
    """Have a package on a peer. Raises `NetworkError`."""
    if package.package_id in await peer.installed():
        return
    try:
        installed = await peer.install(package.data)
    except RefusedError as error:
        if "already successfully installed" in str(error):
            return
        raise
    if installed != package.package_id:
        raise RefusedError(f"{peer.component}: installed the package as {installed}, not {package.package_id}")


async def approve(peer: PeerAdmin, channel: str, definition: Definition, package_id: str | None) -> None:
    """Have the peer's organisation agree to a definition. Raises `ComponentError`."""
    contract = peer.contract(channel, LIFECYCLE)
    argument = definition.approve_argument(package_id)

    async def attempt() -> None:
        await contract.submit("ApproveChaincodeDefinitionForMyOrg", argument, endorsing_organizations=[peer.msp_id])

    await _persist(peer, f"approving {definition.name} {definition.version}", attempt)


async def approvals(peer: PeerAdmin, channel: str, definition: Definition) -> dict[str, bool]:
    """Which organisations have agreed to a definition that is not committed yet. Raises `NetworkError`."""
    data = await peer.call(channel, LIFECYCLE, "CheckCommitReadiness", definition.readiness_argument())
    return dict(lifecycle_pb2.CheckCommitReadinessResult.FromString(data).approvals)


async def approved_package(peer: PeerAdmin, channel: str, name: str, sequence: int) -> str | None:
    """The package that the peer's organisation approved for a sequence; "" for none, None when it did not approve."""
    argument = serialise(lifecycle_pb2.QueryApprovedChaincodeDefinitionArgs(name=name, sequence=sequence))
    try:
        data = await peer.call(channel, LIFECYCLE, "QueryApprovedChaincodeDefinition", argument)
    except RefusedError as error:
        if any(sign in str(error) for sign in _NOT_APPROVED):
            return None
        raise
    source = lifecycle_pb2.QueryApprovedChaincodeDefinitionResult.FromString(data).source
    return str(source.local_package.package_id) if source.WhichOneof("Type") == "local_package" else ""


async def commit(peer: PeerAdmin, channel: str, definition: Definition, organisations: Sequence[str]) -> None:
    """Have the channel agree. `organisations` endorse it. Raises `ComponentError`."""
    contract = peer.contract(channel, LIFECYCLE)
    argument = definition.commit_argument()

    async def attempt() -> None:
        await contract.submit("CommitChaincodeDefinition", argument, endorsing_organizations=list(organisations))

    await _persist(peer, f"committing {definition.name} {definition.version}", attempt)


async def agree(network: Network, peers: Sequence[PeerAdmin], definition: Definition, package: ContractPackage) -> None:
    """Install, approve by every organisation, commit. `peers` are all of the network's. Raises `NetworkError`."""
    endorsing = [peer for peer in peers if peer.msp_id in network.endorsers]
    await together(install(peer, package) for peer in endorsing)
    first = {peer.msp_id: peer for peer in reversed(peers)}
    await together(
        approve(peer, network.channel, definition, package.package_id if msp_id in network.endorsers else None)
        for msp_id, peer in first.items()
    )
    await commit(peers[0], network.channel, definition, list(first))


def is_stranger(error: RefusedError) -> bool:
    """Whether a peer does not know who asks: before it has the block that admits its own organisation."""
    return "creator org unknown" in str(error) or "access denied" in str(error)


async def wait_definition(peer: PeerAdmin, channel: str, name: str, sequence: int) -> None:
    """Wait until a peer knows that the channel agreed on a sequence. Raises `ComponentError`."""
    deadline = time.monotonic() + RETRY_S
    while True:
        try:
            definition = await peer.definition(channel, name)
        except RefusedError as error:
            if not is_stranger(error):
                raise
            definition = None
        if definition is not None and definition.sequence >= sequence:
            return
        if time.monotonic() > deadline:
            raise ComponentError(peer.component, f"does not know {name}, sequence {sequence}, after {RETRY_S:g} s")
        await asyncio.sleep(_PAUSE_S)


async def wait_answering(
    peer: PeerAdmin, identity: SigningIdentity, channel: str, name: str, probe: tuple[str, bytes]
) -> None:
    """Wait until, through this peer, a contract's endorsement policy can be met. Nothing is submitted.

    `identity` asks, `probe` is a function and its argument. An answer of the contract itself, also a refusal, shows
    that it is reached. Raises `ComponentError`.
    """
    gateway = Gateway(peer.channel, identity.identity, identity.sign)
    contract = gateway.network(channel).contract(name)

    async def attempt() -> None:
        try:
            await contract.propose(*probe).endorse()
        except EndorseError as error:
            if error.chaincode_response is None:
                raise

    await _persist(peer, f"waiting for the contract {name}", attempt)


async def _persist(peer: PeerAdmin, what: str, attempt: Callable[[], Awaitable[None]]) -> None:
    deadline = time.monotonic() + RETRY_S
    while True:
        try:
            await attempt()
        except (EndorseError, SubmitError) as error:
            text = str(error)
            if _DONE.search(text):
                return
            passing = error.status_code in _PASSING and not any(sign in text.lower() for sign in _NEVER)
            if not passing or time.monotonic() > deadline:
                raise ComponentError(peer.component, f"{what}: {error}") from error
        except GatewayError as error:
            raise ComponentError(peer.component, f"{what}: {error}") from error
        else:
            return
        await asyncio.sleep(_PAUSE_S)
