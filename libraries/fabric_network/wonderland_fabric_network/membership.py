"""One member's part of a network: what it says of itself on a card, and what it knows of the others by theirs. Pure.

Nothing secret is on a card. All members have the same description and the same cards, and each makes the channel's
first block of them by itself: whoever was given another card has another block. So the block's fingerprint is all that
people have to compare.
"""

from __future__ import annotations

import datetime as dt
import hashlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Annotated, Final

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm

from wonderland.proofs import encoding
from wonderland.proofs.errors import ProofError, RecordError
from wonderland.proofs.records.schema import Binary, Choice, Described, Integer, Items, Record, Text
from wonderland_fabric_gateway.certificates import certificate_of
from wonderland_fabric_network.description import KINDS, MSP_ID, ONE, NetworkDescription, Organisation
from wonderland_fabric_network.errors import DescriptionError

MAX_CARD_BYTES: Final = 256 * 1024
MAX_ROSTER_BYTES: Final = 32 << 20
NONCE_BYTES: Final = 24
_LOCAL: Final = ("hosts", "host", "first_port", "certificates")
"""What of a description is each member's own affair."""
_SHA256: Final = r"[0-9a-f]{64}"
_Pem = Annotated[str, Text(16_000, r"[A-Za-z0-9+/=\n -]*", "A certificate, PEM", 1)]
_Port = Annotated[int, Integer(1, 65_535, "Where it listens")]


@dataclass(frozen=True, kw_only=True)
class PeerCard(Record):
    """A peer, as the others' peers find it."""

    port: _Port


@dataclass(frozen=True, kw_only=True)
class OrdererCard(Record):
    """An orderer, as the channel's configuration names it."""

    port: _Port
    tls_certificate: _Pem
    identity: Annotated[str, Text(16_000, r"[A-Za-z0-9+/=\n -]*", "What it signs blocks with, PEM", 1)]


@dataclass(frozen=True, kw_only=True)
class ContractCard(Record):
    """The contract that is installed there."""

    version: Annotated[str, Text(64, description="Its version", min_length=1)]
    sha256: Annotated[str, Text(64, _SHA256, "Over its source")]


@dataclass(frozen=True, kw_only=True)
class MemberCard(Record):
    """What an organisation tells the others of itself. Nothing in it is secret."""

    RECORD = "MemberCard"
    msp_id: Annotated[str, Text(63, MSP_ID, "The organisation's name on the channel")]
    network_sha256: Annotated[
        str, Text(64, _SHA256, "Over the description that it agreed to; a newcomer's: over the channel's first block")
    ]
    contract: Annotated[ContractCard, Described("The contract that is installed there")]
    t_s: Annotated[int, Integer(0, 1 << 40, "When the card was made: seconds since 1970")]
    host: Annotated[str, Text(253, r"[A-Za-z0-9]([A-Za-z0-9.:-]*[A-Za-z0-9])?", "Where its servers are", 1)]
    root: _Pem
    tls_root: _Pem
    kind: Annotated[str | None, Choice(KINDS, "What it does; on the card of one that is no member yet")] = None
    peers: Annotated[tuple[PeerCard, ...], Items(0, 20, "Its peers")] = ()
    orderers: Annotated[tuple[OrdererCard, ...], Items(0, 20, "Its orderers")] = ()

    @classmethod
    def read(cls, data: bytes, source: str) -> MemberCard:
        """A card of a file. Raises `DescriptionError`."""
        try:
            card = cls.decode(data, max_bytes=MAX_CARD_BYTES)
        except ProofError as cause:
            raise DescriptionError(f"{source}: no card of a member ({cause})") from cause
        return card

    def validate(self, path: str) -> None:
        """Certificates are certificates, and its servers' were issued by its own CAs."""
        prefix = f"{path}." if path else ""
        root, tls_root = _certificate(self.root, f"{prefix}root"), _certificate(self.tls_root, f"{prefix}tls_root")
        for index, orderer in enumerate(self.orderers):
            place = f"{prefix}orderers[{index}]"
            _issued(orderer.identity, root, f"{place}.identity")
            _issued(orderer.tls_certificate, tls_root, f"{place}.tls_certificate")

    def to_bytes(self) -> bytes:
        """Canonical JSON: the same bytes for everybody."""
        return encoding.encode(self.to_json())

    @property
    def fingerprint(self) -> str:
        """What people read to each other, to know that it is the same card."""
        return fingerprint(self.to_bytes())

    def newcomer(self) -> Organisation:
        """The organisation that would join. Raises `DescriptionError` where it is no newcomer's card."""
        if self.kind is None or not self.peers:
            raise DescriptionError(
                f"the card of {self.msp_id} does not say what it will do (kind), or has no peers: it is not a "
                "newcomer's. Next: there, `wonderland network card --roster FILE --kind …`"
            )
        if self.orderers:
            raise DescriptionError(f"the card of {self.msp_id} has orderers; those join with the founders only")
        return Organisation(msp_id=self.msp_id, kind=self.kind, peers=len(self.peers))

    def require_for(self, block: bytes) -> None:
        """Raise `DescriptionError` unless this newcomer means the channel that begins with that block."""
        if self.network_sha256 != hashlib.sha256(block).hexdigest():
            raise DescriptionError(
                f"the card of {self.msp_id} is for another channel than the one that begins with {fingerprint(block)}. "
                "Next: give it this network's roster (`wonderland network roster`), and take its new card"
            )

    def require_fits(self, description: NetworkDescription) -> None:
        """Raise `DescriptionError` unless it is the card of a member of that network, as described."""
        if self.network_sha256 != shared_sha256(description):
            raise DescriptionError(
                f"the card of {self.msp_id} is for another description: somebody changed network.yaml. Next: compare "
                "the files, then each member begins anew with the same one"
            )
        peers = {each.msp_id: each.peers for each in description.organisations}.get(self.msp_id, 0)
        orderers = {each.msp_id: each.orderers for each in description.ordering.organisations}.get(self.msp_id, 0)
        if peers + orderers == 0:
            raise DescriptionError(f"the card of {self.msp_id}: network.yaml has no such organisation")
        if (len(self.peers), len(self.orderers)) != (peers, orderers):
            raise DescriptionError(
                f"the card of {self.msp_id} has {len(self.peers)} peers and {len(self.orderers)} orderers; "
                f"network.yaml has {peers} and {orderers}"
            )


@dataclass(frozen=True, kw_only=True)
class Roster(Record):
    """A network that was founded, as a newcomer is told of it. Nothing in it is secret.

    What counts is the first block, whose fingerprint people compare; all else is checked against what the channel says
    once the newcomer hears it.
    """

    RECORD = "NetworkRoster"
    description: Annotated[NetworkDescription, Described("The network as it is now")]
    contract: Annotated[ContractCard, Described("The contract that its members agreed on")]
    first_block: Annotated[str, Binary(1, 1 << 20, "The channel's first block")]
    cards: Annotated[tuple[MemberCard, ...], Items(1, 100, "Of all members")]

    @classmethod
    def read(cls, data: bytes, source: str) -> Roster:
        """A roster of a file. Raises `DescriptionError`."""
        try:
            return cls.decode(data, max_bytes=MAX_ROSTER_BYTES)
        except ProofError as cause:
            raise DescriptionError(f"{source}: no roster of a network ({cause})") from cause

    def validate(self, path: str) -> None:
        """Each organisation has its card."""
        prefix = f"{path}." if path else ""
        names = tuple(card.msp_id for card in self.cards)
        if sorted(names) != sorted(all_msp_ids(self.description)):
            raise RecordError(f"{prefix}cards", f"are of {', '.join(names)}, which is not the description's list")

    @property
    def block(self) -> bytes:
        """The channel's first block."""
        return encoding.from_base64url(self.first_block)


@dataclass(frozen=True)
class Membership:
    """Whose keys are here, and all cards that are known, the own ones among them."""

    mine: tuple[str, ...]
    cards: Mapping[str, MemberCard] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def hosts(self) -> Mapping[str, str]:
        """Where the others' servers are."""
        return {msp_id: card.host for msp_id, card in self.cards.items() if msp_id not in self.mine}

    @property
    def ports(self) -> dict[str, int]:
        """Where the others' servers listen, by the names of ports.json."""
        found: dict[str, int] = {}
        for msp_id, card in self.cards.items():
            if msp_id not in self.mine:
                found |= {f"{msp_id}/peer{index}/listen": each.port for index, each in enumerate(card.peers)}
                found |= {f"{msp_id}/orderer{index}/listen": each.port for index, each in enumerate(card.orderers)}
        return found

    def missing(self, description: NetworkDescription) -> tuple[str, ...]:
        """Of whom there is no card yet."""
        return tuple(each for each in all_msp_ids(description) if each not in self.cards)

    def with_cards(self, cards: Collection[MemberCard], description: NetworkDescription) -> Membership:
        """With these, too. Raises `DescriptionError` for one that does not fit, or is another than is known."""
        known = dict(self.cards)
        for card in cards:
            card.require_fits(description)
            if known.get(card.msp_id, card) != card:
                whose = "this directory's own" if card.msp_id in self.mine else "the one that is known"
                raise DescriptionError(f"the card of {card.msp_id} is another than {whose}; ask them which one holds")
            for other in known.values():
                if other.msp_id != card.msp_id and other.contract != card.contract:
                    raise DescriptionError(
                        f"{card.msp_id} has contract {card.contract.version} (source {card.contract.sha256[:12]}), "
                        f"{other.msp_id} has {other.contract.version} (source {other.contract.sha256[:12]}). Next: all "
                        "install the same version, and begin anew"
                    )
            known[card.msp_id] = card
        return Membership(self.mine, MappingProxyType(known))

    def with_newcomer(self, card: MemberCard) -> Membership:
        """With one whom the members admitted."""
        return Membership(self.mine, MappingProxyType({**self.cards, card.msp_id: card}))

    def without(self, msp_id: str) -> Membership:
        """Without one that left."""
        return Membership(self.mine, MappingProxyType({k: v for k, v in self.cards.items() if k != msp_id}))

    def founding(self) -> tuple[int, bytes]:
        """The first block's time (s since 1970) and nonce, the same for all who have the same cards."""
        digests = [hashlib.sha256(self.cards[msp_id].to_bytes()).digest() for msp_id in sorted(self.cards)]
        return max(card.t_s for card in self.cards.values()), hashlib.sha256(b"".join(digests)).digest()[:NONCE_BYTES]


def all_msp_ids(description: NetworkDescription) -> tuple[str, ...]:
    """Every organisation of a network, also those that only order."""
    ordering = (each.msp_id for each in description.ordering.organisations)
    return (*(each.msp_id for each in description.organisations), *ordering)


def require_members(mine: Collection[str], description: NetworkDescription) -> None:
    """Raise `DescriptionError` unless these are organisations of a network that members can make together."""
    there = all_msp_ids(description)
    unknown = [each for each in mine if each not in there]
    if unknown:
        raise DescriptionError(f"{unknown[0]} is no organisation of network.yaml; there are {', '.join(there)}")
    if description.hosts != ONE:
        raise DescriptionError(
            "hosts: each member has all its servers on one machine (hosts: one, which is the default)"
        )


def shared_sha256(description: NetworkDescription) -> str:
    """Of what all members must have agreed on."""
    document = {name: value for name, value in description.to_json().items() if name not in _LOCAL}
    return hashlib.sha256(encoding.encode(document)).hexdigest()


def public_part(description: NetworkDescription) -> NetworkDescription:
    """The description without what is each member's own affair."""
    own = NetworkDescription()
    return replace(description, **{name: getattr(own, name) for name in _LOCAL})


def fingerprint(data: bytes) -> str:
    """What people read to each other, of a block or a card: 128 bits of its SHA-256."""
    digest = hashlib.sha256(data).hexdigest()[:32]
    return "-".join(digest[i : i + 4] for i in range(0, 32, 4))


def _certificate(pem: str, path: str) -> x509.Certificate:
    try:
        return certificate_of(pem.encode())
    except ValueError as cause:
        raise RecordError(path, f"no PEM certificate ({cause})") from None


def _issued(pem: str, root: x509.Certificate, path: str) -> None:
    try:
        _certificate(pem, path).verify_directly_issued_by(root)
    except (ValueError, TypeError, InvalidSignature, UnsupportedAlgorithm):
        raise RecordError(path, "was not issued by the root on the same card") from None


def moment(card: MemberCard) -> str:
    """When it was made, for people."""
    return f"{dt.datetime.fromtimestamp(card.t_s, dt.UTC):%Y-%m-%d %H:%M} UTC"
