"""Peers as their administrator uses them: joining a channel, installing contracts, asking what is there.

System contracts cscc, qscc and _lifecycle, by ``protos.Endorser/ProcessProposal``. What only queries or concerns one
peer ends there; what changes the channel goes on through the Gateway (see `lifecycle`).
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Self

import grpc
from fabric_protos.common import common_pb2, configtx_pb2, ledger_pb2
from fabric_protos.peer import proposal_pb2, proposal_response_pb2, query_pb2
from fabric_protos.peer.lifecycle import lifecycle_pb2

from wonderland_fabric_gateway.channel_groups import serialise
from wonderland_fabric_gateway.connection import CHANNEL_OPTIONS, ClientTls
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_fabric_gateway.gateways import Gateways
from wonderland_fabric_gateway.protobuf import decode
from wonderland_fabric_gateway.verification.channel_trust import ChannelTrust
from wonderland_fabric_network.errors import RefusedError, UnreachableError

if TYPE_CHECKING:
    from collections.abc import Callable

    from wonderland_fabric_gateway.gateway import Contract
    from wonderland_fabric_gateway.identity import SigningIdentity
    from wonderland_fabric_network.layout import IdentityPaths

TIMEOUT_S: Final = 30.0
LIFECYCLE: Final = "_lifecycle"
_OK: Final = 200


@dataclass(frozen=True)
class CommittedDefinition:
    """What a channel has agreed on for a contract."""

    sequence: int
    version: str
    validation_parameter: bytes
    approvals: dict[str, bool]


@dataclass(frozen=True)
class ChannelState:
    """A channel's configuration as a peer has it: number of its block, and ``common.Config``."""

    block_number: int
    block: bytes
    config: Any


class PeerAdmin:
    """One peer, used by its organisation's administrator. Use as an asynchronous context."""

    def __init__(
        self,
        component: str,
        address: str,
        tls_root: bytes,
        administrator: SigningIdentity,
        *,
        client: IdentityPaths,
        random_bytes: Callable[[int], bytes] = os.urandom,
    ) -> None:
        self.component: Final = component
        self.address: Final = address
        self.administrator: Final = administrator
        shown = ClientTls(client.certificate, client.key)
        credentials = grpc.ssl_channel_credentials(tls_root, shown.key_pem(), shown.certificate_pem())
        self.channel: Final = grpc.aio.secure_channel(address, credentials, options=list(CHANNEL_OPTIONS))
        gateways = Gateways([(address, self.channel)], tls_certificate_sha256=shown.sha256())
        self._gateway = Gateway(gateways, administrator.identity, administrator.sign, random_bytes=random_bytes)

    @property
    def msp_id(self) -> str:
        """MSP id of the organisation whose administrator asks."""
        return self.administrator.identity.msp_id

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *error: object) -> None:
        await self.channel.close()

    def contract(self, channel: str, chaincode: str) -> Contract:
        """A contract on a channel, by this peer's Gateway."""
        return self._gateway.network(channel).contract(chaincode)

    async def channels(self) -> tuple[str, ...]:
        """The channels that this peer has joined. Raises `UnreachableError`, `RefusedError`."""
        answer = self._decode(query_pb2.ChannelQueryResponse, await self.call("", "cscc", "GetChannels"))
        return tuple(each.channel_id for each in answer.channels)

    async def join(self, block: bytes) -> None:
        """Join the channel whose first block this is. Raises `UnreachableError`, `RefusedError`."""
        try:
            await self.call("", "cscc", "JoinChain", block)
        except RefusedError as error:
            if "already exists" not in str(error):
                raise

    async def height(self, channel: str) -> int:
        """How many blocks it has. Raises `UnreachableError`, `RefusedError`."""
        data = await self.call(channel, "qscc", "GetChainInfo", channel.encode())
        return int(self._decode(ledger_pb2.BlockchainInfo, data).height)

    async def channel_state(self, channel: str) -> ChannelState:
        """The channel's configuration. Raises `UnreachableError`, `RefusedError`."""
        data = await self.call(channel, "cscc", "GetConfigBlock", channel.encode())
        block = self._decode(common_pb2.Block, data)
        envelope = self._decode(common_pb2.Envelope, block.data.data[0])
        payload = self._decode(common_pb2.Payload, envelope.payload)
        config = self._decode(configtx_pb2.ConfigEnvelope, payload.data).config
        return ChannelState(int(block.header.number), data, config)

    async def trust(self, channel: str) -> ChannelTrust:
        """Whom the channel trusts now. Raises `UnreachableError`, `RefusedError`, `BlockError`."""
        state = await self.channel_state(channel)
        block = self._decode(common_pb2.Block, state.block)
        return ChannelTrust.of(state.block_number, block.data.data[0])

    async def installed(self) -> dict[str, str]:
        """Label by package id of the contracts that are installed. Raises `UnreachableError`, `RefusedError`."""
        argument = serialise(lifecycle_pb2.QueryInstalledChaincodesArgs())
        data = await self.call("", LIFECYCLE, "QueryInstalledChaincodes", argument)
        answer = self._decode(lifecycle_pb2.QueryInstalledChaincodesResult, data)
        return {each.package_id: each.label for each in answer.installed_chaincodes}

    async def install(self, package: bytes) -> str:
        """Install a package; its id. Raises `UnreachableError`, `RefusedError`."""
        argument = serialise(lifecycle_pb2.InstallChaincodeArgs(chaincode_install_package=package))
        data = await self.call("", LIFECYCLE, "InstallChaincode", argument)
        return str(self._decode(lifecycle_pb2.InstallChaincodeResult, data).package_id)

    async def definition(self, channel: str, name: str) -> CommittedDefinition | None:
        """What the channel has agreed on for a contract, or None. Raises `UnreachableError`, `RefusedError`."""
        argument = serialise(lifecycle_pb2.QueryChaincodeDefinitionArgs(name=name))
        try:
            data = await self.call(channel, LIFECYCLE, "QueryChaincodeDefinition", argument)
        except RefusedError as error:
            if "is not defined" in str(error):
                return None
            raise
        answer = self._decode(lifecycle_pb2.QueryChaincodeDefinitionResult, data)
        return CommittedDefinition(
            int(answer.sequence), answer.version, answer.validation_parameter, dict(answer.approvals)
        )

    async def call(self, channel: str, chaincode: str, function: str, *arguments: bytes) -> bytes:
        """Run a function of a system contract on this peer. Raises `UnreachableError`, `RefusedError`."""
        proposal = self._gateway.network(channel).contract(chaincode).propose(function, *arguments)
        signed = proposal_pb2.SignedProposal(
            proposal_bytes=proposal.message, signature=self.administrator.sign(proposal.message)
        )
        method: grpc.aio.UnaryUnaryMultiCallable[bytes, bytes] = self.channel.unary_unary(
            "/protos.Endorser/ProcessProposal"
        )
        try:
            data = await method(serialise(signed), timeout=TIMEOUT_S, wait_for_ready=True)
        except grpc.aio.AioRpcError as cause:
            text = f"{self.component}: {function}: {cause.code().name}: {cause.details()}"
            if cause.code() in {grpc.StatusCode.UNAVAILABLE, grpc.StatusCode.DEADLINE_EXCEEDED}:
                raise UnreachableError(text) from cause
            raise RefusedError(text) from cause
        answer = self._decode(proposal_response_pb2.ProposalResponse, data)
        if answer.response.status != _OK:
            raise RefusedError(
                f"{self.component}: {function}: {answer.response.status} {answer.response.message}",
                answer.response.status,
            )
        return bytes(answer.response.payload)

    def _decode(self, message_type: Any, data: bytes) -> Any:
        return decode(message_type, data, f"{self.component}: answer", UnreachableError)
