"""The building blocks of a channel's configuration, and block 0 that carries it; for every kind of ledger here.

All of it has the shape that configtxgen gives: each element's `mod_policy` is "Admins". Sources: Fabric
``internal/configtxgen/encoder``, ``common/configtx`` (versions), ``configtx.proto``, ``msp_config.proto``.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from fabric_protos.common import common_pb2, configtx_pb2, configuration_pb2, policies_pb2
from fabric_protos.msp import msp_config_pb2
from fabric_protos.peer import configuration_pb2 as peer_pb2

from wonderland_fabric_gateway.blocks import BlockHeader, data_hash
from wonderland_fabric_gateway.signature_policies import one_of_each

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

METADATA_SLOTS: Final = 5
ADMINS: Final = "Admins"


@dataclass(frozen=True)
class OrganisationDescription:
    """An organisation as it goes into a channel's configuration (certificates PEM)."""

    msp_id: str
    root_cert: bytes
    tls_root_cert: bytes
    endpoints: tuple[str, ...] = ()
    """``host:port`` of its orderers, for an ordering organisation."""
    anchor_peers: tuple[tuple[str, int], ...] = ()
    """Host and port of the peers that other organisations' peers may ask, for an organisation with peers."""


def config_block(
    channel: str, root: configtx_pb2.ConfigGroup, timestamp_s: int, nonce: bytes
) -> tuple[BlockHeader, bytes]:
    """Block 0 with that channel group: header and ``common.Block`` bytes.

    `timestamp_s` since the Unix epoch; `nonce` 24 random bytes.
    """
    channel_header = common_pb2.ChannelHeader(
        type=common_pb2.CONFIG, version=1, channel_id=channel, tx_id=hashlib.sha256(nonce).hexdigest()
    )
    channel_header.timestamp.seconds = timestamp_s
    payload = common_pb2.Payload(
        header=common_pb2.Header(
            channel_header=serialise(channel_header),
            signature_header=serialise(common_pb2.SignatureHeader(nonce=nonce)),
        ),
        data=serialise(configtx_pb2.ConfigEnvelope(config=configtx_pb2.Config(channel_group=root))),
    )
    envelope = serialise(common_pb2.Envelope(payload=serialise(payload)))
    header = BlockHeader(0, b"", data_hash([envelope]))
    metadata = [b""] * METADATA_SLOTS
    last_config = common_pb2.LastConfig(index=0)
    metadata[common_pb2.SIGNATURES] = serialise(
        common_pb2.Metadata(value=serialise(common_pb2.OrdererBlockMetadata(last_config=last_config)))
    )
    metadata[common_pb2.LAST_CONFIG] = serialise(common_pb2.Metadata(value=serialise(last_config)))
    metadata[common_pb2.TRANSACTIONS_FILTER] = b"\x00"
    block = common_pb2.Block(
        header=common_pb2.BlockHeader(number=0, data_hash=header.data_hash),
        data=common_pb2.BlockData(data=[envelope]),
        metadata=common_pb2.BlockMetadata(metadata=metadata),
    )
    return header, serialise(block)


def channel_group(orderer: configtx_pb2.ConfigGroup, application: configtx_pb2.ConfigGroup) -> configtx_pb2.ConfigGroup:
    """The root of a channel's configuration (capability V3_0)."""
    return group(
        values={
            "HashingAlgorithm": configuration_pb2.HashingAlgorithm(name="SHA256"),
            "BlockDataHashingStructure": configuration_pb2.BlockDataHashingStructure(width=0xFFFFFFFF),
            "Capabilities": capabilities("V3_0"),
        },
        policies=meta_policies(),
        groups={"Orderer": orderer, "Application": application},
    )


def application_group(
    organisations: Sequence[OrganisationDescription], endorsement: policies_pb2.Policy
) -> configtx_pb2.ConfigGroup:
    """The organisations that use the channel (capability V2_5), and who must endorse and agree on a contract."""
    return group(
        values={"Capabilities": capabilities("V2_5")},
        policies={**meta_policies(), "Endorsement": endorsement, "LifecycleEndorsement": endorsement},
        groups={each.msp_id: organisation_group(each, orderer=False) for each in organisations},
    )


def organisation_group(description: OrganisationDescription, *, orderer: bool) -> configtx_pb2.ConfigGroup:
    """One organisation: its MSP with node OUs, its policies, and where its orderers or anchor peers are."""
    name = description.msp_id
    values: dict[str, Any] = {"MSP": msp_config(description)}
    policies = {
        "Readers": signed_by("member", name),
        "Writers": signed_by("member", name),
        ADMINS: signed_by("admin", name),
    }
    if orderer:
        values["Endpoints"] = configuration_pb2.OrdererAddresses(addresses=description.endpoints)
    else:
        policies["Endorsement"] = signed_by("peer", name)
        if description.anchor_peers:
            anchors = [peer_pb2.AnchorPeer(host=host, port=port) for host, port in description.anchor_peers]
            values["AnchorPeers"] = peer_pb2.AnchorPeers(anchor_peers=anchors)
    return group(values=values, policies=policies)


def msp_config(description: OrganisationDescription) -> msp_config_pb2.MSPConfig:
    """An X.509 MSP whose members are told apart by the OUs client, peer, admin and orderer."""

    def unit(kind: str) -> msp_config_pb2.FabricOUIdentifier:
        return msp_config_pb2.FabricOUIdentifier(organizational_unit_identifier=kind)

    msp = msp_config_pb2.FabricMSPConfig(
        name=description.msp_id,
        root_certs=[description.root_cert],
        tls_root_certs=[description.tls_root_cert],
        crypto_config=msp_config_pb2.FabricCryptoConfig(
            signature_hash_family="SHA2", identity_identifier_hash_function="SHA256"
        ),
        fabric_node_ous=msp_config_pb2.FabricNodeOUs(
            enable=True,
            client_ou_identifier=unit("client"),
            peer_ou_identifier=unit("peer"),
            admin_ou_identifier=unit("admin"),
            orderer_ou_identifier=unit("orderer"),
        ),
    )
    return msp_config_pb2.MSPConfig(type=0, config=serialise(msp))


def group(
    *,
    values: Mapping[str, Any],
    policies: Mapping[str, policies_pb2.Policy],
    groups: Mapping[str, configtx_pb2.ConfigGroup] | None = None,
) -> configtx_pb2.ConfigGroup:
    """A group whose every element the group's admins may change."""
    made = configtx_pb2.ConfigGroup(mod_policy=ADMINS)
    for name, value in values.items():
        made.values[name].value = serialise(value)
        made.values[name].mod_policy = ADMINS
    for name, policy in policies.items():
        made.policies[name].policy.CopyFrom(policy)
        made.policies[name].mod_policy = ADMINS
    for name, member in (groups or {}).items():
        made.groups[name].CopyFrom(member)
    return made


def capabilities(name: str) -> configuration_pb2.Capabilities:
    """A set of one capability."""
    return configuration_pb2.Capabilities(capabilities={name: configuration_pb2.Capability()})


def meta_policies() -> dict[str, policies_pb2.Policy]:
    """Any member group may read and write; the majority of the admins may change."""
    return {
        "Readers": meta_policy("ANY", "Readers"),
        "Writers": meta_policy("ANY", "Writers"),
        ADMINS: meta_policy("MAJORITY", ADMINS),
    }


def meta_policy(rule: str, sub_policy: str) -> policies_pb2.Policy:
    """ANY, ALL or MAJORITY of the same-named policies of the groups below."""
    value = policies_pb2.ImplicitMetaPolicy(
        rule=policies_pb2.ImplicitMetaPolicy.Rule.Value(rule), sub_policy=sub_policy
    )
    return policies_pb2.Policy(type=policies_pb2.Policy.IMPLICIT_META, value=serialise(value))


def signed_by(role: str, *msp_ids: str) -> policies_pb2.Policy:
    """A signature of that role (member, admin, client, peer, orderer) from every one of the organisations."""
    return signature_policy(one_of_each(role, *((msp_id,) for msp_id in msp_ids)))


def signature_policy(envelope: policies_pb2.SignaturePolicyEnvelope) -> policies_pb2.Policy:
    """A policy that counts signatures."""
    return policies_pb2.Policy(type=policies_pb2.Policy.SIGNATURE, value=serialise(envelope))


def serialise(message: Any) -> bytes:
    """Protocol-buffer bytes with maps in key order, so that equal configurations have equal bytes."""
    return bytes(message.SerializeToString(deterministic=True))
