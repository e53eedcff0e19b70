"""Whom a channel trusts, from one config block to the next: organisations, orderers, and its policies.

Sources: ``common/configtx.proto``, ``common/policies.proto``; Fabric ``common/policies`` (ImplicitMeta) and
``common/cauthdsl`` (signature policies).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

from fabric_protos.common import common_pb2, configtx_pb2, configuration_pb2, policies_pb2
from fabric_protos.msp import identities_pb2
from fabric_protos.orderer import configuration_pb2 as orderer_pb2

from wonderland_fabric_gateway.channel_config import parse_channel_config
from wonderland_fabric_gateway.embedded.config_update import trust_of
from wonderland_fabric_gateway.embedded.msp import ChannelMembership
from wonderland_fabric_gateway.errors import BlockError, LedgerError, VerificationError
from wonderland_fabric_gateway.identity import Identity
from wonderland_fabric_gateway.protobuf import decode
from wonderland_fabric_gateway.signature_policies import Signer, parse_policy, satisfied

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from wonderland_fabric_gateway.channel_config import ChannelConfig
    from wonderland_fabric_gateway.embedded.msp import Member

APPLICATION: Final = "Application"
ORDERER: Final = "Orderer"
BFT: Final = "BFT"
SKEW_MS: Final = 15 * 60 * 1000
"""How far a sender's clock may be from the ledger's; also how far outside of its time a certificate may seem."""
_MAX_DEPTH: Final = 16


@dataclass(frozen=True)
class ChannelTrust:
    """What one config block says. `number` is that block's; `root` its channel group (``common.ConfigGroup``)."""

    number: int
    channel: str
    config: ChannelConfig
    root: Any = field(repr=False)
    consensus: str
    consenters: Mapping[int, Identity]
    """BFT orderers by the number that they sign with."""
    membership: ChannelMembership = field(repr=False)
    envelope: bytes = field(repr=False)
    """The transaction that brought it."""
    at_ms: int
    """When, by the clock of whoever sent it."""

    @classmethod
    def of(cls, number: int, envelope: bytes) -> ChannelTrust:
        """The trust that a CONFIG transaction (``common.Envelope``) brings. Raises `BlockError`, `LedgerError`."""
        payload = decode(
            common_pb2.Payload,
            decode(common_pb2.Envelope, envelope, "config transaction", BlockError).payload,
            "config transaction",
            BlockError,
        )
        header = decode(common_pb2.ChannelHeader, payload.header.channel_header, "channel header", BlockError)
        if header.type != common_pb2.CONFIG:
            raise BlockError(f"block {number}: header type {header.type} is not that of a configuration")
        config = parse_channel_config(payload.data)
        root = decode(configtx_pb2.ConfigEnvelope, payload.data, "config transaction", BlockError).config.channel_group
        if ORDERER not in root.groups or APPLICATION not in root.groups:
            raise BlockError(f"block {number}: a configuration without orderers or without members")
        return cls(
            number=number,
            channel=header.channel_id,
            config=config,
            root=root,
            consensus=_value(root.groups[ORDERER], "ConsensusType", orderer_pb2.ConsensusType).type,
            consenters=_consenters(root.groups[ORDERER]),
            membership=ChannelMembership(trust_of(config), sequence=config.sequence),
            envelope=envelope,
            at_ms=header.timestamp.ToMilliseconds(),
        )

    def member(self, creator: bytes, at_ms: int, section: str) -> Member:
        """The member of an organisation of that section, at a time that a sender's clock said.

        Raises `VerificationError`.
        """
        member = self._member(creator, at_ms)
        if section not in self.config.organisations[member.creator.msp_id].sections:
            raise VerificationError(f"{member.creator.msp_id} is no organisation of the section {section}")
        return member

    def _member(self, creator: bytes, at_ms: int) -> Member:
        try:
            for now_ms in (at_ms, at_ms + SKEW_MS):
                with suppress(LedgerError):
                    return self.membership.member(creator, now_ms)
            return self.membership.member(creator, at_ms - SKEW_MS)
        except LedgerError as cause:
            raise VerificationError(str(cause)) from cause

    def holds(self, section: str, name: str, signers: Sequence[Signer]) -> bool:
        """Whether these signatures meet a policy of that section; one identity counts once. Raises `BlockError`."""
        once = {each.creator or (each.msp_id, each.role): each for each in signers}
        group = self.root.groups[section]
        if name not in group.policies:
            raise BlockError(f"config block {self.number}: {section} has no policy {name}")
        return _holds(group, group.policies[name].policy, tuple(once.values()), 0)

    def holds_at(self, path: str, signers: Sequence[Signer]) -> bool:
        """The same for a path as policies refer to one another: ``/Channel/Application/Endorsement``."""
        parts = path.strip("/").split("/")
        if parts[0] == "Channel":
            del parts[0]
        if len(parts) != 2 or parts[0] not in self.root.groups:
            raise BlockError(f"config block {self.number}: no policy {path!r}")
        return self.holds(parts[0], parts[1], signers)


def signer_of(member: Member) -> Signer:
    """A member that gave a signature, as policies count it."""
    return Signer(member.creator.msp_id, member.creator.node_ou.upper(), member.identity.creator)


def _holds(group: Any, policy: Any, signers: tuple[Signer, ...], depth: int) -> bool:
    if depth > _MAX_DEPTH:
        return False
    if policy.type == policies_pb2.Policy.SIGNATURE:
        envelope = parse_policy(policy.value)
        return envelope is not None and satisfied(envelope, signers)
    if policy.type != policies_pb2.Policy.IMPLICIT_META:
        return False
    meta = decode(policies_pb2.ImplicitMetaPolicy, policy.value, "policy", BlockError)
    below = [
        meta.sub_policy in each.policies and _holds(each, each.policies[meta.sub_policy].policy, signers, depth + 1)
        for each in group.groups.values()
    ]
    needed = {
        policies_pb2.ImplicitMetaPolicy.ANY: 1,
        policies_pb2.ImplicitMetaPolicy.ALL: len(below),
        policies_pb2.ImplicitMetaPolicy.MAJORITY: len(below) // 2 + 1,
    }[meta.rule]
    return bool(below) and sum(below) >= needed


def _value(group: Any, name: str, kind: Any) -> Any:
    if name not in group.values:
        raise BlockError(f"config: the orderers' section has no {name}")
    return decode(kind, group.values[name].value, f"config: {name}", BlockError)


def _consenters(group: Any) -> dict[int, Identity]:
    if "Orderers" not in group.values:
        return {}
    mapping = _value(group, "Orderers", configuration_pb2.Orderers).consenter_mapping
    return {
        int(each.id): Identity.from_creator(
            identities_pb2.SerializedIdentity(mspid=each.msp_id, id_bytes=each.identity).SerializeToString()
        )
        for each in mapping
    }
