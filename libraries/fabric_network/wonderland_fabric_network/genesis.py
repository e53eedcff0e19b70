"""The channel's first block: what configtxgen would make of the same description.

Sources: Fabric ``internal/configtxgen/encoder``, ``orderer/consensus``; times for BFT from measurements (Fabric's own
defaults stall for minutes when a leader dies).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from fabric_protos.common import configtx_pb2, configuration_pb2, policies_pb2
from fabric_protos.msp import identities_pb2, msp_principal_pb2
from fabric_protos.orderer import configuration_pb2 as orderer_pb2
from fabric_protos.orderer.etcdraft import configuration_pb2 as raft_pb2
from fabric_protos.orderer.smartbft import configuration_pb2 as bft_pb2

from wonderland_fabric_gateway.channel_groups import (
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

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wonderland_fabric_network.description import Ordering

ABSOLUTE_MAX_BYTES: Final = 10 << 20
PREFERRED_MAX_BYTES: Final = 2 << 20
RAFT: Final = "etcdraft"
BFT: Final = "BFT"


@dataclass(frozen=True)
class Consenter:
    """An orderer that takes part in consensus. Certificates PEM; `identity` is what it signs blocks with."""

    number: int
    """From 1; BFT blocks name their signers by it."""
    msp_id: str
    host: str
    port: int
    tls_certificate: bytes
    identity: bytes

    @property
    def address(self) -> str:
        """``host:port``."""
        return f"{self.host}:{self.port}"


@dataclass(frozen=True)
class ChannelPlan:
    """All that goes into the first block."""

    channel: str
    applications: tuple[OrganisationDescription, ...]
    orderers: tuple[OrganisationDescription, ...]
    consenters: tuple[Consenter, ...]
    ordering: Ordering


def first_block(plan: ChannelPlan, timestamp_s: int, nonce: bytes) -> bytes:
    """``common.Block`` bytes. `timestamp_s` since the Unix epoch; `nonce` 24 random bytes."""
    endorsement = meta_policy("MAJORITY", "Endorsement")
    root = channel_group(orderer_group(plan), application_group(plan.applications, endorsement))
    return config_block(plan.channel, root, timestamp_s, nonce)[1]


def orderer_group(plan: ChannelPlan) -> configtx_pb2.ConfigGroup:
    """The organisations that order blocks, and how they do it."""
    ordering = plan.ordering
    values: dict[str, Any] = {
        "BatchSize": orderer_pb2.BatchSize(
            max_message_count=ordering.batch_count,
            absolute_max_bytes=ABSOLUTE_MAX_BYTES,
            preferred_max_bytes=PREFERRED_MAX_BYTES,
        ),
        "BatchTimeout": orderer_pb2.BatchTimeout(timeout=f"{ordering.batch_timeout_ms}ms"),
        "ChannelRestrictions": orderer_pb2.ChannelRestrictions(),
        "Capabilities": capabilities("V2_0"),
    }
    policies = {**meta_policies(), "BlockValidation": meta_policy("ANY", "Writers")}
    if ordering.consensus == "bft":
        values["ConsensusType"] = orderer_pb2.ConsensusType(type=BFT, metadata=serialise(bft_options(ordering)))
        values["Orderers"] = configuration_pb2.Orderers(consenter_mapping=[_bft(each) for each in plan.consenters])
        policies["BlockValidation"] = block_validation(plan.consenters)
    else:
        values["ConsensusType"] = orderer_pb2.ConsensusType(
            type=RAFT, metadata=serialise(raft_metadata(plan.consenters))
        )
    organisations = {each.msp_id: organisation_group(each, orderer=True) for each in plan.orderers}
    return group(values=values, policies=policies, groups=organisations)


def raft_metadata(consenters: Sequence[Consenter]) -> raft_pb2.ConfigMetadata:
    """Who takes part in Raft, and how fast it ticks: an election takes 1 s instead of the default's 5 s."""
    return raft_pb2.ConfigMetadata(
        consenters=[
            raft_pb2.Consenter(
                host=each.host,
                port=each.port,
                client_tls_cert=each.tls_certificate,
                server_tls_cert=each.tls_certificate,
            )
            for each in consenters
        ],
        options=raft_pb2.Options(
            tick_interval="100ms",
            election_tick=10,
            heartbeat_tick=1,
            max_inflight_blocks=5,
            snapshot_interval_size=16 << 20,
        ),
    )


def bft_options(ordering: Ordering) -> bft_pb2.Options:
    """SmartBFT's times and sizes. A dead leader is replaced within some 3 s (132 s with the defaults)."""
    return bft_pb2.Options(
        request_batch_max_count=ordering.batch_count,
        request_batch_max_bytes=ABSOLUTE_MAX_BYTES,
        request_batch_max_interval=f"{ordering.batch_timeout_ms}ms",  # this one, not BatchTimeout, holds for BFT
        incoming_message_buffer_size=200,
        request_pool_size=max(400, 2 * ordering.batch_count),
        request_forward_timeout="1s",
        request_complain_timeout="2s",
        request_auto_remove_timeout="3m0s",
        # The default of 10 KiB is less than an evidence-laden transaction with three certificates needs.
        request_max_bytes=ABSOLUTE_MAX_BYTES,
        view_change_resend_interval="1s",
        view_change_timeout="5s",
        leader_heartbeat_timeout="3s",
        leader_heartbeat_count=10,
        collect_timeout="1s",
        sync_on_start=False,
        speed_up_view_change=False,
        # Leader rotation stays unsaid, which means off; Fabric supports nothing else.
    )


def block_validation(consenters: Sequence[Consenter]) -> policies_pb2.Policy:
    """A block counts when a quorum of ⌈(n + f + 1) / 2⌉ of these very consenters signed it."""
    count = len(consenters)
    faulty = (count - 1) // 3
    principals = [
        msp_principal_pb2.MSPPrincipal(
            principal_classification=msp_principal_pb2.MSPPrincipal.IDENTITY,
            principal=serialise(identities_pb2.SerializedIdentity(mspid=each.msp_id, id_bytes=each.identity)),
        )
        for each in consenters
    ]
    rules = [policies_pb2.SignaturePolicy(signed_by=index) for index in range(count)]
    quorum = math.ceil((count + faulty + 1) / 2)
    rule = policies_pb2.SignaturePolicy(n_out_of=policies_pb2.SignaturePolicy.NOutOf(n=quorum, rules=rules))
    return signature_policy(policies_pb2.SignaturePolicyEnvelope(rule=rule, identities=principals))


def _bft(consenter: Consenter) -> configuration_pb2.Consenter:
    return configuration_pb2.Consenter(
        id=consenter.number,
        host=consenter.host,
        port=consenter.port,
        msp_id=consenter.msp_id,
        identity=consenter.identity,
        client_tls_cert=consenter.tls_certificate,
        server_tls_cert=consenter.tls_certificate,
    )
