"""What transactions cost in blocks: counted on a real channel, and carried on to many proofs."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Iterable

    from wonderland_fabric_gateway.blocks import Block

PROOF: Final = ("RequestProof", "SubmitProof", "CompleteInteraction")
"""The transactions of a proof that ends in a permission that was used."""
REQUEST: Final = PROOF[0]
PROOF_KEYS: Final = tuple(f"\0{kind}\0" for kind in ("session", "verdict", "used-prekey"))
"""Records that a proof leaves in the state."""
PREKEYS: Final = "PublishPrekeys"
MILLION: Final = 1_000_000


@dataclass
class Share:
    """Transactions of one function: how many, and the bytes of their envelopes."""

    count: int = 0
    octets: int = 0

    @property
    def mean(self) -> float:
        """Bytes of one transaction on average; 0.0 where there was none."""
        return self.octets / self.count if self.count else 0.0


@dataclass
class Census:
    """The transactions and bytes of a channel's blocks."""

    blocks: int = 0
    octets: int = 0
    """Of the blocks as they are stored, metadata and signatures included."""
    transactions: int = 0
    invalid: int = 0
    functions: dict[str, Share] = field(default_factory=lambda: defaultdict(Share))
    state: dict[str, int] = field(default_factory=dict)
    """Bytes of key and value by key, as these blocks leave them."""

    def count(self, blocks: Iterable[Block]) -> None:
        """Take blocks in: each transaction's bytes under its function's name."""
        for block in blocks:
            self.blocks += 1
            self.octets += len(block.to_bytes())
            for transaction, envelope in zip(block.transactions, block.envelopes, strict=True):
                self.transactions += 1
                self.invalid += not transaction.is_valid
                if transaction.invocation is not None and transaction.is_valid:
                    share = self.functions[transaction.invocation.function]
                    share.count += 1
                    share.octets += len(envelope)
                    for _, write in transaction.writes:
                        if write.is_delete:
                            self.state.pop(write.key, None)
                        else:
                            self.state[write.key] = len(write.key) + len(write.value)

    def proof(self) -> Proof | None:
        """What a proof costs on this channel; None before the first one."""
        requests = self.functions[REQUEST].count
        if not requests:
            return None
        transactions = octets = 0.0
        for name in (*PROOF, PREKEYS):
            share = self.functions[name]
            # Prekeys are published ten and more at a time; requests that failed have no end.
            per_proof = min(1.0, share.count / requests)
            transactions += per_proof
            octets += per_proof * share.mean
        envelopes = sum(each.octets for each in self.functions.values())
        overhead = (self.octets - envelopes) / max(self.transactions, 1)
        kept = sum(octets for key, octets in self.state.items() if key.startswith(PROOF_KEYS))
        return Proof(transactions, octets, overhead * transactions, kept / requests)

    def as_json(self) -> dict[str, Any]:
        """JSON values, as `--json` prints them."""
        proof = self.proof()
        return {
            "blocks": self.blocks,
            "bytes": self.octets,
            "transactions": self.transactions,
            "invalid": self.invalid,
            "functions": {
                name: {"count": share.count, "mean_bytes": round(share.mean)}
                for name, share in sorted(self.functions.items())
                if share.count
            },
            "proof": None if proof is None else proof.as_json(),
        }


@dataclass(frozen=True)
class Proof:
    """Of one proof: transactions, bytes of their envelopes, of the blocks around them, of the state that it leaves."""

    transactions: float
    octets: float
    overhead: float
    state: float

    @property
    def stored(self) -> float:
        """Bytes that one proof adds to each copy of the chain."""
        return self.octets + self.overhead

    def as_json(self) -> dict[str, float]:
        """JSON values, as `--json` prints them."""
        return {
            "transactions": round(self.transactions, 2),
            "envelope_bytes": round(self.octets),
            "block_bytes": round(self.overhead),
            "stored_bytes": round(self.stored),
            "state_bytes": round(self.state),
            "gb_per_million": round(self.stored * MILLION / 1e9, 2),
        }
