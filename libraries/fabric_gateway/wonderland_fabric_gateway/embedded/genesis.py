"""The channel's configuration as block 0 carries it.

The shape is that of configtxgen, so that whoever reads Fabric's config blocks learns the trust roots here, too; the
consensus type says "embedded", and the endorsement policy is written out: AND of the endorsing organisations' peers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from fabric_protos.orderer import configuration_pb2 as orderer_pb2

from wonderland_fabric_gateway.channel_groups import (
    METADATA_SLOTS,
    OrganisationDescription,
    application_group,
    capabilities,
    channel_group,
    config_block,
    group,
    meta_policies,
    meta_policy,
    organisation_group,
    serialise,
    signature_policy,
)
from wonderland_fabric_gateway.signature_policies import one_of_each

if TYPE_CHECKING:
    from fabric_protos.common import configtx_pb2

    from wonderland_fabric_gateway.blocks import BlockHeader

__all__ = [
    "ABSOLUTE_MAX_BYTES",
    "CONSENSUS_TYPE",
    "METADATA_SLOTS",
    "PREFERRED_MAX_BYTES",
    "ChannelDescription",
    "OrganisationDescription",
    "genesis_block",
    "serialise",
]

CONSENSUS_TYPE: Final = "embedded"
PREFERRED_MAX_BYTES: Final = 2 << 20
ABSOLUTE_MAX_BYTES: Final = 10 << 20


@dataclass(frozen=True)
class ChannelDescription:
    """What block 0 says. One organisation of each group in `endorsing` must endorse."""

    channel: str
    applications: tuple[OrganisationDescription, ...]
    orderer: OrganisationDescription
    endorsing: tuple[tuple[str, ...], ...]
    batch_ms: int
    batch_count: int


def genesis_block(description: ChannelDescription, timestamp_s: int, nonce: bytes) -> tuple[BlockHeader, bytes]:
    """Block 0: header and ``common.Block`` bytes. `timestamp_s` since the epoch; `nonce` 24 random bytes."""
    application = application_group(
        description.applications, signature_policy(one_of_each("peer", *description.endorsing))
    )
    root = channel_group(_orderer(description), application)
    return config_block(description.channel, root, timestamp_s, nonce)


def _orderer(description: ChannelDescription) -> configtx_pb2.ConfigGroup:
    return group(
        values={
            "ConsensusType": orderer_pb2.ConsensusType(type=CONSENSUS_TYPE),
            "BatchSize": orderer_pb2.BatchSize(
                max_message_count=description.batch_count,
                absolute_max_bytes=ABSOLUTE_MAX_BYTES,
                preferred_max_bytes=PREFERRED_MAX_BYTES,
            ),
            "BatchTimeout": orderer_pb2.BatchTimeout(timeout=f"{description.batch_ms}ms"),
            "ChannelRestrictions": orderer_pb2.ChannelRestrictions(),
            "Capabilities": capabilities("V2_0"),
        },
        policies={**meta_policies(), "BlockValidation": meta_policy("ANY", "Writers")},
        groups={description.orderer.msp_id: organisation_group(description.orderer, orderer=True)},
    )
