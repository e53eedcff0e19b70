"""The channel's configuration as block 0 carries it.

The shape is that of configtxgen, so that whoever reads Fabric's config blocks learns the trust roots here, too; the
consensus type says "embedded", and the endorsement policy is written out: AND of the endorsing organisations' peers.
Sources: Fabric ``internal/configtxgen/encoder``, ``common/configtx`` (sequence, versions), ``configtx.proto``.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from fabric_protos.common import common_pb2, configtx_pb2, configuration_pb2, policies_pb2
from fabric_protos.msp import msp_config_pb2, msp_principal_pb2
from fabric_protos.orderer import configuration_pb2 as orderer_pb2

from wonderland.ledger.blocks import BlockHeader, data_hash

if TYPE_CHECKING:
    from collections.abc import Mapping

CONSENSUS_TYPE: Final = "embedded"
METADATA_SLOTS: Final = 5
PREFERRED_MAX_BYTES: Final = 2 << 20
ABSOLUTE_MAX_BYTES: Final = 10 << 20
_ADMINS: Final = "Admins"


@dataclass(frozen=True)
class OrganisationDescription:
    """An organisation as it goes into block 0 (certificates PEM)."""

    msp_id: str
    root_cert: bytes
    tls_root_cert: bytes
    endpoints: tuple[str, ...] = ()
    """Orderer addresses, for the ordering organisation."""


@dataclass(frozen=True)
class ChannelDescription:
    """What block 0 says. `endorsing` names the organisations that must all endorse."""

    channel: str
    applications: tuple[OrganisationDescription, ...]
    orderer: OrganisationDescription
    endorsing: tuple[str, ...]
    batch_ms: int
    batch_count: int


def genesis_block(description: ChannelDescription, timestamp_s: int, nonce: bytes) -> tuple[BlockHeader, bytes]:
    """Block 0: header and ``common.Block`` bytes. `timestamp_s` since the epoch; `nonce` 24 random bytes."""
    channel_header = common_pb2.ChannelHeader(
        type=common_pb2.CONFIG, version=1, channel_id=description.channel, tx_id=hashlib.sha256(nonce).hexdigest()
    )
    channel_header.timestamp.seconds = timestamp_s
    payload = common_pb2.Payload(
        header=common_pb2.Header(
            channel_header=serialise(channel_header),
            signature_header=serialise(common_pb2.SignatureHeader(nonce=nonce)),
        ),
        data=serialise(configtx_pb2.ConfigEnvelope(config=configtx_pb2.Config(channel_group=_channel(description)))),
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


def _channel(description: ChannelDescription) -> configtx_pb2.ConfigGroup:
    return _group(
        values={
            "HashingAlgorithm": configuration_pb2.HashingAlgorithm(name="SHA256"),
            "BlockDataHashingStructure": configuration_pb2.BlockDataHashingStructure(width=0xFFFFFFFF),
            "Capabilities": _capabilities("V3_0"),
        },
        policies=_meta_policies(),
        groups={"Orderer": _orderer(description), "Application": _application(description)},
    )


def _orderer(description: ChannelDescription) -> configtx_pb2.ConfigGroup:
    return _group(
        values={
            "ConsensusType": orderer_pb2.ConsensusType(type=CONSENSUS_TYPE),
            "BatchSize": orderer_pb2.BatchSize(
                max_message_count=description.batch_count,
                absolute_max_bytes=ABSOLUTE_MAX_BYTES,
                preferred_max_bytes=PREFERRED_MAX_BYTES,
            ),
            "BatchTimeout": orderer_pb2.BatchTimeout(timeout=f"{description.batch_ms}ms"),
            "ChannelRestrictions": orderer_pb2.ChannelRestrictions(),
            "Capabilities": _capabilities("V2_0"),
        },
        policies={**_meta_policies(), "BlockValidation": _meta("ANY", "Writers")},
        groups={description.orderer.msp_id: _organisation(description.orderer, orderer=True)},
    )


def _application(description: ChannelDescription) -> configtx_pb2.ConfigGroup:
    endorsement = _signed_by("peer", *description.endorsing)
    return _group(
        values={"Capabilities": _capabilities("V2_5")},
        policies={**_meta_policies(), "Endorsement": endorsement, "LifecycleEndorsement": endorsement},
        groups={each.msp_id: _organisation(each, orderer=False) for each in description.applications},
    )


def _organisation(description: OrganisationDescription, *, orderer: bool) -> configtx_pb2.ConfigGroup:
    name = description.msp_id

    def unit(kind: str) -> msp_config_pb2.FabricOUIdentifier:
        return msp_config_pb2.FabricOUIdentifier(organizational_unit_identifier=kind)

    msp = msp_config_pb2.FabricMSPConfig(
        name=name,
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
    values: dict[str, Any] = {"MSP": msp_config_pb2.MSPConfig(type=0, config=serialise(msp))}
    policies = {
        "Readers": _signed_by("member", name),
        "Writers": _signed_by("member", name),
        _ADMINS: _signed_by("admin", name),
    }
    if orderer:
        values["Endpoints"] = configuration_pb2.OrdererAddresses(addresses=description.endpoints)
    else:
        policies["Endorsement"] = _signed_by("peer", name)
    return _group(values=values, policies=policies)


def _group(
    *,
    values: Mapping[str, Any],
    policies: Mapping[str, policies_pb2.Policy],
    groups: Mapping[str, configtx_pb2.ConfigGroup] | None = None,
) -> configtx_pb2.ConfigGroup:
    group = configtx_pb2.ConfigGroup(mod_policy=_ADMINS)
    for name, value in values.items():
        group.values[name].value = serialise(value)
        group.values[name].mod_policy = _ADMINS
    for name, policy in policies.items():
        group.policies[name].policy.CopyFrom(policy)
        group.policies[name].mod_policy = _ADMINS
    for name, member in (groups or {}).items():
        group.groups[name].CopyFrom(member)
    return group


def _capabilities(name: str) -> configuration_pb2.Capabilities:
    return configuration_pb2.Capabilities(capabilities={name: configuration_pb2.Capability()})


def _meta_policies() -> dict[str, policies_pb2.Policy]:
    return {"Readers": _meta("ANY", "Readers"), "Writers": _meta("ANY", "Writers"), _ADMINS: _meta("MAJORITY", _ADMINS)}


def _meta(rule: str, sub_policy: str) -> policies_pb2.Policy:
    value = policies_pb2.ImplicitMetaPolicy(
        rule=policies_pb2.ImplicitMetaPolicy.Rule.Value(rule), sub_policy=sub_policy
    )
    return policies_pb2.Policy(type=policies_pb2.Policy.IMPLICIT_META, value=serialise(value))


def _signed_by(role: str, *msp_ids: str) -> policies_pb2.Policy:
    """A signature of that role from every one of the organisations."""
    principals = [
        msp_principal_pb2.MSPPrincipal(
            principal_classification=msp_principal_pb2.MSPPrincipal.ROLE,
            principal=serialise(
                msp_principal_pb2.MSPRole(
                    msp_identifier=msp_id, role=msp_principal_pb2.MSPRole.MSPRoleType.Value(role.upper())
                )
            ),
        )
        for msp_id in msp_ids
    ]
    rule = policies_pb2.SignaturePolicy(
        n_out_of=policies_pb2.SignaturePolicy.NOutOf(
            n=len(msp_ids), rules=[policies_pb2.SignaturePolicy(signed_by=index) for index in range(len(msp_ids))]
        )
    )
    envelope = policies_pb2.SignaturePolicyEnvelope(version=0, identities=principals, rule=rule)
    return policies_pb2.Policy(type=policies_pb2.Policy.SIGNATURE, value=serialise(envelope))


def serialise(message: Any) -> bytes:
    """Protocol-buffer bytes with maps in key order, so that equal configurations have equal bytes."""
    return bytes(message.SerializeToString(deterministic=True))
