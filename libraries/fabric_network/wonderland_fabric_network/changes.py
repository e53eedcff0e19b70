"""Changes of a running channel as its members decide on them: what is to be done, and who signed it. Pure.

A file says what is meant, never how the channel's configuration would look: each member computes that by itself, from
the configuration that its own peer has, and signs what it computed. So nobody signs what somebody else wrote.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, Final

from cryptography.hazmat.primitives.serialization import Encoding
from fabric_protos.common import common_pb2, configtx_pb2
from fabric_protos.orderer import configuration_pb2 as orderer_pb2

from wonderland.proofs import encoding
from wonderland.proofs.errors import ProofError, RecordError
from wonderland.proofs.records.schema import Binary, Described, Integer, Items, Record, Text
from wonderland_fabric_gateway.certificates import certificate_of
from wonderland_fabric_gateway.channel_groups import OrganisationDescription, organisation_group, serialise
from wonderland_fabric_gateway.errors import LedgerError, SignatureError
from wonderland_fabric_gateway.identity import Identity
from wonderland_fabric_gateway.protobuf import decode
from wonderland_fabric_gateway.signing import verify
from wonderland_fabric_gateway.verification.channel_trust import APPLICATION, ORDERER, ChannelTrust, signer_of
from wonderland_fabric_network.config_update import compute_update, signature_over
from wonderland_fabric_network.description import CHANNEL_NAME, MSP_ID, Ordering
from wonderland_fabric_network.errors import ChannelUpdateError, DescriptionError
from wonderland_fabric_network.genesis import BFT, bft_options
from wonderland_fabric_network.membership import MemberCard

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from wonderland_fabric_gateway.identity import SigningIdentity
    from wonderland_fabric_network.description import NetworkDescription

MAX_CHANGE_BYTES: Final = 2 << 20
ADMINS: Final = "Admins"


@dataclass(frozen=True, kw_only=True)
class Batching(Record):
    """How transactions become blocks from then on."""

    timeout_ms: Annotated[int, Integer(1, 60_000, "How long a transaction waits at most for others")]
    count: Annotated[int, Integer(1, 10_000, "Transactions that fill a block")]


@dataclass(frozen=True, kw_only=True)
class ChangeSignature(Record):
    """An administrator's signature, as Fabric's ``common.ConfigSignature``."""

    header: Annotated[str, Binary(1, 70_000, "common.SignatureHeader: who signs")]
    signature: Annotated[str, Binary(1, 200, "Over header and update (ECDSA, DER)")]

    def to_protobuf(self) -> Any:
        """``common.ConfigSignature``."""
        return configtx_pb2.ConfigSignature(
            signature_header=encoding.from_base64url(self.header), signature=encoding.from_base64url(self.signature)
        )


@dataclass(frozen=True, kw_only=True)
class ChannelChange(Record):
    """What is to be done with a channel, and who signed it so far. Exactly one of admit, remove and batching."""

    RECORD = "ChannelChange"
    channel: Annotated[str, Text(249, CHANNEL_NAME, "The channel's name", 1)]
    update_sha256: Annotated[str, Text(64, r"[0-9a-f]{64}", "Over the common.ConfigUpdate that the members sign")]
    admit: Annotated[MemberCard | None, Described("An organisation that joins, as its card has it")] = None
    remove: Annotated[str | None, Text(63, MSP_ID, "An organisation that leaves")] = None
    batching: Annotated[Batching | None, Described("Other blocks")] = None
    signatures: Annotated[tuple[ChangeSignature, ...], Items(0, 100, "By administrators")] = ()

    @classmethod
    def read(cls, data: bytes, source: str) -> ChannelChange:
        """A change of a file. Raises `DescriptionError`."""
        try:
            return cls.decode(data, max_bytes=MAX_CHANGE_BYTES)
        except ProofError as cause:
            raise DescriptionError(f"{source}: no change of a channel ({cause})") from cause

    def validate(self, path: str) -> None:
        """One thing at a time, so that people know what they sign."""
        if sum(each is not None for each in (self.admit, self.remove, self.batching)) != 1:
            raise RecordError(path, "should have exactly one of admit, remove, batching")

    @property
    def section(self) -> str:
        """Whose administrators decide: those who use the channel, or those who order its blocks."""
        return APPLICATION if self.batching is None else ORDERER

    def applied(self, description: NetworkDescription) -> NetworkDescription:
        """The description once it is made. Raises `DescriptionError` where that cannot be."""
        if self.admit is not None:
            return description.with_organisation(self.admit.newcomer())
        if self.remove is not None:
            description.organisation(self.remove)
            return description.without_organisation(self.remove)
        assert self.batching is not None
        return description.with_batching(self.batching.timeout_ms, self.batching.count)

    def merged(self, other: ChannelChange) -> ChannelChange:
        """The same change with the signatures of both. Raises `DescriptionError` for another change."""
        if replace(self, signatures=()) != replace(other, signatures=()):
            raise DescriptionError("these files are about different changes")
        return replace(self, signatures=tuple(dict.fromkeys((*self.signatures, *other.signatures))))

    def to_bytes(self) -> bytes:
        """What a file has."""
        return encoding.encode(self.to_json()) + b"\n"


def update_of(change: ChannelChange, trust: ChannelTrust, ordering: Ordering) -> bytes | None:
    """``common.ConfigUpdate`` that makes the change where the channel is as `trust` has it; None: it is made already.

    Raises `ChannelUpdateError` where it would do harm.
    """
    new = configtx_pb2.ConfigGroup()
    new.CopyFrom(trust.root)
    if change.admit is not None:
        _require_own_roots(change.admit, trust)
        _admit(new, change.admit, trust)
    elif change.remove is not None:
        members = new.groups[APPLICATION].groups
        if change.remove in members:
            del members[change.remove]
    else:
        assert change.batching is not None
        _batch(new.groups[ORDERER], change.batching, ordering)
    update = compute_update(trust.channel, trust.root, new)
    return None if update is None else serialise(update)


def require_same(change: ChannelChange, update: bytes) -> None:
    """Raise `ChannelUpdateError` unless the signatures are for that update."""
    if change.update_sha256 != sha256(update):
        raise ChannelUpdateError(
            "the change was proposed when the channel was another one, or it does not say what its signatures are for. "
            "Next: propose it anew"
        )


def signed(
    change: ChannelChange, update: bytes, signers: Sequence[SigningIdentity], random_bytes: Callable[[int], bytes]
) -> ChannelChange:
    """With these administrators' signatures, too; one who signed already does not sign again."""
    there = {_creator(each) for each in change.signatures}
    new = []
    for signer in signers:
        if signer.creator not in there:
            made = signature_over(update, signer, random_bytes)
            new.append(
                ChangeSignature(
                    header=encoding.to_base64url(made.signature_header), signature=encoding.to_base64url(made.signature)
                )
            )
    return replace(change, signatures=(*change.signatures, *new))


@dataclass(frozen=True)
class Count:
    """Whose administrators signed, who else may, and whether they are enough."""

    signed: tuple[str, ...]
    missing: tuple[str, ...]
    enough: bool


def count(change: ChannelChange, update: bytes, trust: ChannelTrust, now_ms: int) -> Count:
    """Count the signatures as the orderers will. Raises `ChannelUpdateError` for one that does not hold."""
    signers = []
    for each in change.signatures:
        header, creator = encoding.from_base64url(each.header), _creator(each)
        try:
            member = trust.member(creator, now_ms, change.section)
            who = Identity.from_creator(creator)
            key = who.public_key
        except LedgerError as cause:
            raise ChannelUpdateError(f"a signature of nobody who may sign this: {cause}") from cause
        try:
            verify(key, header + update, encoding.from_base64url(each.signature))
        except SignatureError as cause:
            raise ChannelUpdateError(
                f"the signature of {who.msp_id} is not one over this change ({cause}): the file was altered after it "
                "signed. Next: take the file from who proposed it"
            ) from cause
        if member.creator.node_ou != "admin":
            raise ChannelUpdateError(
                f"{who.common_name} of {who.msp_id} signed, and is no administrator of it ({member.creator.node_ou})"
            )
        signers.append(signer_of(member))
    there = sorted({each.msp_id for each in signers})
    members = sorted(trust.root.groups[change.section].groups)
    return Count(
        tuple(there), tuple(each for each in members if each not in there), trust.holds(change.section, ADMINS, signers)
    )


def require_true_cards(cards: Iterable[MemberCard], trust: ChannelTrust) -> None:
    """Raise `DescriptionError` where a card shows other roots than the channel has for that organisation."""
    for card in cards:
        there = trust.config.organisations.get(card.msp_id)
        if there is None:
            continue
        for pem, roots in ((card.root, there.root_certs), (card.tls_root, there.tls_root_certs)):
            if _der(pem) not in {_der(each.decode()) for each in roots}:
                raise DescriptionError(
                    f"the card of {card.msp_id} shows a root that is not the one on the channel: who gave it to you "
                    "gave you a false one. Next: `wonderland network destroy`, begin with another member's roster"
                )


def sha256(update: bytes) -> str:
    """Its digest, lower-case hex."""
    return hashlib.sha256(update).hexdigest()


def _creator(signature: ChangeSignature) -> bytes:
    header = encoding.from_base64url(signature.header)
    return bytes(decode(common_pb2.SignatureHeader, header, "a signature's header", ChannelUpdateError).creator)


def _admit(root: Any, card: MemberCard, trust: ChannelTrust) -> None:
    there = trust.config.organisations.get(card.msp_id)
    if there is not None:
        if [_der(pem.decode()) for pem in there.root_certs] != [_der(card.root)]:
            raise ChannelUpdateError(f"{card.msp_id} takes part already, with another root than the one on the card")
        return
    root.groups[APPLICATION].groups[card.msp_id].CopyFrom(
        organisation_group(
            OrganisationDescription(
                card.msp_id,
                card.root.encode(),
                card.tls_root.encode(),
                anchor_peers=tuple((card.host, each.port) for each in card.peers[:1]),
            ),
            orderer=False,
        )
    )


def _require_own_roots(card: MemberCard, trust: ChannelTrust) -> None:
    """Who shows another one's roots would have the other one's people count as its own."""
    roots = {_der(pem) for pem in (card.root, card.tls_root)}
    for msp_id, organisation in trust.config.organisations.items():
        theirs = {_der(pem.decode()) for pem in (*organisation.root_certs, *organisation.tls_root_certs)}
        if msp_id != card.msp_id and roots & theirs:
            raise ChannelUpdateError(f"the card of {card.msp_id} shows a root of {msp_id}")


def _der(pem: str) -> bytes:
    return certificate_of(pem.encode()).public_bytes(Encoding.DER)


def _batch(orderer: Any, batching: Batching, ordering: Ordering) -> None:
    size = decode(
        orderer_pb2.BatchSize, orderer.values["BatchSize"].value, "the channel's BatchSize", ChannelUpdateError
    )
    size.max_message_count = batching.count
    orderer.values["BatchSize"].value = serialise(size)
    orderer.values["BatchTimeout"].value = serialise(orderer_pb2.BatchTimeout(timeout=f"{batching.timeout_ms}ms"))
    kind = decode(
        orderer_pb2.ConsensusType,
        orderer.values["ConsensusType"].value,
        "the channel's ConsensusType",
        ChannelUpdateError,
    )
    if kind.type == BFT:  # which has both in its own options
        new = replace(ordering, batch_timeout_ms=batching.timeout_ms, batch_count=batching.count)
        kind.metadata = serialise(bft_options(new))
        orderer.values["ConsensusType"].value = serialise(kind)
