"""The orderers' signatures of a block, by the configuration that was in force before it.

On Raft one member of an ordering organisation suffices, on BFT ⌈(n + f + 1) / 2⌉ of the consenters by number; both are
what the channel's policy BlockValidation asks for. A signature that does not hold is an error, though others might
suffice: whoever passes blocks on has no reason to carry one. Source: Fabric ``common/deliverclient``, ``protoutil``.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from fabric_protos.common import common_pb2

from wonderland_fabric_gateway.errors import BlockError, SignatureError, VerificationError
from wonderland_fabric_gateway.protobuf import decode
from wonderland_fabric_gateway.signing import verify
from wonderland_fabric_gateway.verification.channel_trust import BFT, ORDERER, ChannelTrust, signer_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wonderland_fabric_gateway.blocks import Block, BlockSignature
    from wonderland_fabric_gateway.signature_policies import Signer


def orderers(trust: ChannelTrust, signatures: Sequence[BlockSignature], at_ms: int) -> tuple[Signer, ...]:
    """Who ordered a block: every signature verified, every signer an orderer. Raises `VerificationError`."""
    found: list[Signer] = []
    for each in signatures:
        signer = each.signer
        if signer is None:
            signer = trust.consenters.get(each.consenter_id or 0)
            if signer is None:
                raise VerificationError(
                    f"consenter {each.consenter_id} signed, and the channel has none of that number"
                )
        member = trust.member(signer.creator, at_ms, ORDERER)
        try:
            verify(signer.public_key, each.message, each.signature)
        except SignatureError as cause:
            raise VerificationError(f"a signature of {member.creator.common_name}: {cause}") from cause
        found.append(signer_of(member))
    return tuple(found)


def require_orderers(trust: ChannelTrust, signers: Sequence[Signer]) -> str:
    """What was asked for, in words, where it is met. Raises `VerificationError` for too few."""
    different = {each.creator for each in signers}
    if trust.consensus == BFT:
        count = len(trust.consenters)
        quorum = math.ceil((count + (count - 1) // 3 + 1) / 2)
        if len(different) < quorum:
            raise VerificationError(f"{len(different)} of {count} BFT orderers signed; {quorum} are needed")
    if not trust.holds(ORDERER, "BlockValidation", signers):
        raise VerificationError(f"{len(different)} signatures do not meet the channel's policy BlockValidation")
    return f"{len(different)} of {len(trust.consenters) or 'the channel’s'} orderers"


def last_config(value: bytes) -> int:
    """Which config block the orderers say was in force: the signed value's ``last_config``. Raises `BlockError`."""
    return int(decode(common_pb2.OrdererBlockMetadata, value, "orderers' metadata", BlockError).last_config.index)


def last_config_of(block: Block) -> int:
    """The same of a whole block. Raises `BlockError`."""
    what = f"block {block.number}: orderers' metadata"
    slot = block.metadata[common_pb2.SIGNATURES] if block.metadata else b""
    return last_config(decode(common_pb2.Metadata, slot, what, BlockError).value)
