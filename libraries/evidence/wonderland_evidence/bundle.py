"""The file: ``wonderland-evidence/1``, canonical JSON (docs/reference/evidence-format.md). It has one encoding only."""

from __future__ import annotations

import itertools
from collections.abc import Hashable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from fabric_protos.common import common_pb2
from fabric_protos.msp import identities_pb2
from fabric_protos.peer import chaincode_pb2, proposal_pb2
from google.protobuf.message import DecodeError

from wonderland.proofs import encoding
from wonderland.proofs.errors import EncodingError
from wonderland_evidence.errors import UnreadableError
from wonderland_evidence.fields import Fields
from wonderland_fabric_gateway.blocks import BlockHeader, BlockSignature, block_signature

FORMAT: Final = "wonderland-evidence/1"
MAX_BYTES: Final = 64 << 20
HASH_BYTES: Final = 32
MAX_TIMESTAMPS: Final = 16


@dataclass(frozen=True)
class OrdererSignature:
    """One orderer's: `header` is a ``common.SignatureHeader`` or, where `by_number`, a ``common.IdentifierHeader``."""

    header: bytes
    signature: bytes
    by_number: bool


@dataclass(frozen=True)
class BundleBlock:
    """A block without what nobody signs. `data` is None where only the header is there; block 0 is not signed."""

    header: BlockHeader
    data: tuple[bytes, ...] | None
    value: bytes
    signatures: tuple[OrdererSignature, ...]

    @property
    def number(self) -> int:
        """Its number."""
        return self.header.number

    def block_signatures(self) -> tuple[BlockSignature, ...]:
        """The orderers' signatures with what each is over. Raises `BlockError`."""
        return tuple(
            block_signature(
                common_pb2.MetadataSignature(
                    **{"identifier_header" if each.by_number else "signature_header": each.header},
                    signature=each.signature,
                ),
                self.value,
                self.header.der,
                f"block {self.number}: signatures",
            )
            for each in self.signatures
        )

    def without_data(self) -> BundleBlock:
        """The block as a neighbour: header and signatures."""
        return BundleBlock(self.header, None, self.value, self.signatures)

    @classmethod
    def of(cls, raw: bytes) -> BundleBlock:
        """What of a ``common.Block`` goes into a bundle."""
        block = common_pb2.Block.FromString(raw)
        header = BlockHeader(block.header.number, block.header.previous_hash, block.header.data_hash)
        metadata = common_pb2.Metadata.FromString(block.metadata.metadata[common_pb2.SIGNATURES])
        signatures = tuple(
            OrdererSignature(each.identifier_header, each.signature, by_number=True)
            if each.identifier_header
            else OrdererSignature(each.signature_header, each.signature, by_number=False)
            for each in metadata.signatures
        )
        if not header.number:
            return cls(header, tuple(block.data.data), b"", ())
        return cls(header, tuple(block.data.data), metadata.value, signatures)


@dataclass(frozen=True)
class ValidityAnswer:
    """What peers signed when they were asked what became of a transaction (``qscc`` GetTransactionByID).

    The question is a proposal in its three parts; `response` a ``ProposalResponsePayload``.
    """

    channel_header: bytes
    signature_header: bytes
    proposal: bytes
    response: bytes
    endorsements: tuple[tuple[bytes, bytes], ...]
    """Each peer's serialised identity and signature."""


@dataclass(frozen=True)
class TimeStamp:
    """An RFC 3161 time-stamp (``TimeStampToken``, DER) over the SHA-256 header hash of a block."""

    block: int
    token: bytes


@dataclass(frozen=True)
class Bundle:
    """The whole file."""

    channel: str
    chaincode: str
    session_id: str
    blocks: tuple[BundleBlock, ...]
    validity: tuple[ValidityAnswer, ...]
    timestamps: tuple[TimeStamp, ...] = ()

    def encode(self) -> bytes:
        """The file's bytes; the same bundle always has the same."""
        return encoding.encode(
            {
                "format": FORMAT,
                "channel": self.channel,
                "chaincode": self.chaincode,
                "session_id": self.session_id,
                "blocks": [_block_json(each) for each in self.blocks],
                "validity": [_answer_json(each) for each in self.validity],
                "timestamps": [{"block": each.block, "token": _text(each.token)} for each in self.timestamps],
            }
        )

    @classmethod
    def decode(cls, data: bytes) -> Bundle:
        """Read a file's bytes. Raises `UnreadableError` for everything but the one encoding of a bundle."""
        value = canonical_json(data)
        fields = Fields(value, "")
        require_format(fields, FORMAT)
        bundle = cls(
            channel=fields.text("channel"),
            chaincode=fields.text("chaincode"),
            session_id=fields.text("session_id"),
            blocks=fields.each("blocks", _block),
            validity=fields.each("validity", _answer),
            timestamps=fields.each("timestamps", lambda each: TimeStamp(each.number("block"), each.octets("token"))),
        )
        fields.end()
        numbers = [each.number for each in bundle.blocks]
        if not numbers or any(after <= before for before, after in itertools.pairwise(numbers)):
            raise fields.wrong("blocks", "are none, or not in ascending order")
        if len(bundle.timestamps) > MAX_TIMESTAMPS:
            raise fields.wrong("timestamps", f"are more than {MAX_TIMESTAMPS}")
        _require_once("timestamps", bundle.timestamps)
        _require_once("validity", (_question(each.proposal) for each in bundle.validity))
        return bundle


def read_file(path: Path, limit: int = MAX_BYTES) -> bytes:
    """A file's bytes, never more than `limit` of them. Raises `UnreadableError`."""
    try:
        with path.open("rb") as file:
            data = file.read(limit + 1)
    except OSError as cause:
        raise UnreadableError("no_file", f"{path} cannot be read ({cause.strerror or cause})") from cause
    if len(data) > limit:
        raise UnreadableError("too_large", f"{path} is larger than the {limit >> 20} MiB that are read")
    return data


def canonical_json(data: bytes) -> Any:
    """The value of a canonical JSON text. Raises `UnreadableError`, saying how it is none."""
    try:
        value = encoding.decode(data, max_bytes=MAX_BYTES)
    except EncodingError as cause:
        text = str(cause)
        if text.startswith("not JSON: Extra data"):
            raise UnreadableError("concatenated", "something follows the end of the file's content") from cause
        if text.startswith("not JSON") and not data.rstrip().endswith(b"}"):
            raise UnreadableError("cut", f"the file is cut off ({text})") from cause
        raise UnreadableError("not_json", text) from cause
    if encoding.encode(value) != data:
        raise UnreadableError("not_canonical", "the file is not in its canonical encoding: somebody re-wrote it")
    return value


def require_format(fields: Fields, expected: str) -> None:
    """Raise `UnreadableError` for a file of another kind or version."""
    found = fields.text("format")
    if found != expected:
        raise UnreadableError("unknown_version", f"the format is {found[:60]!r}; this verifier reads {expected}")


def _block(fields: Fields) -> BundleBlock:
    header = BlockHeader(fields.number("number"), fields.octets("previous_hash"), fields.octets("data_hash"))
    if len(header.data_hash) != HASH_BYTES or len(header.previous_hash) != (HASH_BYTES if header.number else 0):
        raise fields.wrong("data_hash", "or previous_hash has not the length of a hash")
    data = fields.octets_list("data") if fields.has("data") else None
    if not header.number:
        return BundleBlock(header, data, b"", ())
    orderers = fields.fields("orderers")
    block = BundleBlock(header, data, orderers.octets("value"), orderers.each("signatures", _signature))
    orderers.end()
    _require_once(f"block {header.number}: signatures", (_signer(each) for each in block.signatures))
    return block


def _signature(fields: Fields) -> OrdererSignature:
    by_number = fields.has("identifier")
    header = fields.octets("identifier" if by_number else "header")
    return OrdererSignature(header, fields.octets("signature"), by_number)


def _answer(fields: Fields) -> ValidityAnswer:
    answer = ValidityAnswer(
        channel_header=fields.octets("channel_header"),
        signature_header=fields.octets("signature_header"),
        proposal=fields.octets("proposal"),
        response=fields.octets("response"),
        endorsements=fields.each("endorsements", lambda each: (each.octets("endorser"), each.octets("signature"))),
    )
    _require_once("validity: endorsements", (_organisation(endorser) for endorser, _ in answer.endorsements))
    return answer


def _require_once(where: str, items: Iterable[Hashable]) -> None:
    """Raise `UnreadableError` where something stands twice: only the first counts, so that one file would be many."""
    seen: set[Hashable] = set()
    for each in items:
        if each in seen:
            raise UnreadableError("not_canonical", f"{where}: the same stands there twice; somebody re-wrote the file")
        seen.add(each)


def _question(proposal: bytes) -> Hashable:
    """Which transaction peers were asked about; of what is no such question, its bytes: step 11 says more."""
    try:
        payload = proposal_pb2.ChaincodeProposalPayload.FromString(proposal)
        return tuple(chaincode_pb2.ChaincodeInvocationSpec.FromString(payload.input).chaincode_spec.input.args)
    except DecodeError:
        return proposal


def _organisation(endorser: bytes) -> Hashable:
    """Whose peer signed; of what is no identity, its bytes: step 11 says more."""
    try:
        return str(identities_pb2.SerializedIdentity.FromString(endorser).mspid)
    except DecodeError:
        return endorser


def _signer(signature: OrdererSignature) -> Hashable:
    """Which orderer signed; of what is no header, its bytes: step 4 says more."""
    try:
        if signature.by_number:
            return int(common_pb2.IdentifierHeader.FromString(signature.header).identifier)
        return bytes(common_pb2.SignatureHeader.FromString(signature.header).creator)
    except DecodeError:
        return signature.header


def _block_json(block: BundleBlock) -> dict[str, Any]:
    found: dict[str, Any] = {
        "number": block.number,
        "previous_hash": _text(block.header.previous_hash),
        "data_hash": _text(block.header.data_hash),
    }
    if block.data is not None:
        found["data"] = [_text(each) for each in block.data]
    if block.number:
        found["orderers"] = {
            "value": _text(block.value),
            "signatures": [
                {"identifier" if each.by_number else "header": _text(each.header), "signature": _text(each.signature)}
                for each in block.signatures
            ],
        }
    return found


def _answer_json(answer: ValidityAnswer) -> dict[str, Any]:
    return {
        "channel_header": _text(answer.channel_header),
        "signature_header": _text(answer.signature_header),
        "proposal": _text(answer.proposal),
        "response": _text(answer.response),
        "endorsements": [
            {"endorser": _text(endorser), "signature": _text(signature)} for endorser, signature in answer.endorsements
        ],
    }


def _text(data: bytes) -> str:
    return encoding.to_base64url(data)
