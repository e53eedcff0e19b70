"""All tables recomputed from the chain, and the first row that is another one.

Each block is believed as a stranger would believe it (orderers, senders, endorsers, policies), its codes are those that
the committer gives on the state recomputed so far, and what it writes goes into a temporary store by the committer's
own code. In the end the two stores are compared. That takes far longer than a start should, so that a start does it
only when the seal does not hold, or for a ledger that has none yet.
"""

from __future__ import annotations

import contextlib
import logging
from typing import TYPE_CHECKING, Final

from wonderland_fabric_gateway.channel_config import endorsement_policy
from wonderland_fabric_gateway.embedded.committer import Candidate, validate_block
from wonderland_fabric_gateway.embedded.comparison import Recomputed
from wonderland_fabric_gateway.embedded.config_update import config_data
from wonderland_fabric_gateway.embedded.errors import REMEDY, LedgerCorruptedError, StorageError, TableCorruptedError
from wonderland_fabric_gateway.embedded.integrity import load_block, require_commit_hash
from wonderland_fabric_gateway.embedded.rwset import ReadWriteSet, from_accesses
from wonderland_fabric_gateway.embedded.seal import SEAL, sealed_number
from wonderland_fabric_gateway.embedded.state import LAST_CONFIG, CommittedTx
from wonderland_fabric_gateway.errors import LedgerError, VerificationError
from wonderland_fabric_gateway.transactions import ValidationCode, code_name
from wonderland_fabric_gateway.verification.block_checks import last_config_of
from wonderland_fabric_gateway.verification.channel_trust import ChannelTrust
from wonderland_fabric_gateway.verification.light_client import require_ordered
from wonderland_fabric_gateway.verification.transaction_checks import (
    SignedTransaction,
    check_proposal,
    check_sender,
    counted_endorsers,
)

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from fabric_protos.common.policies_pb2 import SignaturePolicyEnvelope

    from wonderland_fabric_gateway.blocks import Block
    from wonderland_fabric_gateway.embedded.seal import Seal
    from wonderland_fabric_gateway.embedded.state import StateReader
    from wonderland_fabric_gateway.signature_policies import Signer
    from wonderland_fabric_gateway.transactions import Transaction

_BY_STATE: Final = frozenset(
    {
        ValidationCode.VALID,
        ValidationCode.MVCC_READ_CONFLICT,
        ValidationCode.PHANTOM_READ_CONFLICT,
        ValidationCode.DUPLICATE_TXID,
    }
)
"""Codes that follow from the transaction and the state before it. Others tell of the moment of submission, too: which
contracts were installed, who was revoked since."""

_log: Final = logging.getLogger(__name__)


def verify_seal(path: Path, reader: StateReader, seal: Seal, *, adopt: bool) -> None:
    """Read all rows into `seal` and compare with what is stored; `adopt` a ledger that this key has not sealed yet.

    Raises `LedgerCorruptedError`, which names table and key where the chain itself tells.
    """
    seal.begin()
    for table, row in reader.sealed_rows():
        seal.replace(table, None, row)
    seal.keep()
    if adopt:
        if reader.tip().number:
            _log.warning("no seal of this ledger's yet: all is recomputed from its blocks once, which may take a while")
        recompute(path, reader)
        return
    tip, stored = reader.tip(), reader.meta(SEAL) or b""
    broken = seal.broken(stored, tip.number, tip.header_hash)
    if not broken:
        return
    recompute(path, reader)
    # The chain does not tell: what there is fits together, and yet it is not what this ledger left.
    number = sealed_number(stored)
    if not stored:
        what = "the ledger's seal has been removed"
    elif number != tip.number:
        what = f"the chain ends with block {tip.number}, but was sealed after block {number}: its end has been cut off"
    else:
        what = f"rows of {', '.join(broken)} were changed and fit each other, but not the ledger's seal"
    raise TableCorruptedError(
        f"{path.name}: {what}. {REMEDY}", *(("meta", SEAL) if not stored else ("block", str(tip.number)))
    )


def recompute(path: Path, reader: StateReader) -> None:
    """Raise `LedgerCorruptedError` unless every table is what follows from the blocks."""
    number = 0
    results: Sequence[CommittedTx]
    try:
        with contextlib.closing(Recomputed()) as store:
            previous = load_block(reader, 0)
            trust = ChannelTrust.of(0, previous.envelopes[0])
            policy = endorsement_policy(config_data(previous.envelopes[0]))
            _store(store, previous, _as_recorded(previous), trust)
            for number in range(1, reader.tip().number + 1):
                block = load_block(reader, number)
                block.require_follows(previous.header)
                require_commit_hash(previous, block)
                brings = block.config is not None
                require_ordered(trust, block)
                if last_config_of(block) != (number if brings else trust.number):
                    raise VerificationError(f"its orderer names config block {last_config_of(block)}")
                if brings:
                    trust = _next_trust(trust, block)
                    policy = endorsement_policy(config_data(block.envelopes[0]))
                    results = _as_recorded(block)
                else:
                    results = _validated(store, trust, block, policy)
                _store(store, block, results, trust)
                previous = block
            difference = store.first_difference(path)
    except StorageError:  # no room for a temporary file
        raise
    except LedgerCorruptedError as cause:  # says already which block
        raise TableCorruptedError(f"{cause}. {REMEDY}", "block", str(number)) from cause
    except LedgerError as cause:
        raise TableCorruptedError(f"stored block {number}: {cause}. {REMEDY}", "block", str(number)) from cause
    if difference is not None:
        table, key, what = difference
        raise TableCorruptedError(f"table {table}, {key}: {what}. {REMEDY}", table, key)


def _validated(
    store: Recomputed, trust: ChannelTrust, block: Block, policy: SignaturePolicyEnvelope
) -> Sequence[CommittedTx]:
    """What the committer makes of a block on the state before it. Raises `LedgerError`."""
    candidates = [
        _candidate(trust, each, envelope) for each, envelope in zip(block.transactions, block.envelopes, strict=True)
    ]
    results = validate_block(store, block.number, candidates, policy)
    for transaction, result in zip(block.transactions, results, strict=True):
        if transaction.validation_code != result.code:
            raise VerificationError(
                f"its metadata says {transaction.validation_name} of transaction {transaction.tx_id}, which is "
                f"{code_name(result.code)} by the state before it"
            )
    return results


def _candidate(trust: ChannelTrust, transaction: Transaction, envelope: bytes) -> Candidate:
    """A transaction as it was submitted, as far as the chain tells. Raises `VerificationError` for a forged one."""
    code, rwset = transaction.validation_code, ReadWriteSet()
    signers: tuple[Signer, ...] = ()
    if code in _BY_STATE:
        whole = SignedTransaction.of(transaction, envelope)
        check_sender(trust, whole)
        check_proposal(whole)
        code, rwset = int(ValidationCode.VALID), from_accesses(whole.invocation.accesses)
        signers = counted_endorsers(trust, whole.invocation, transaction.timestamp_ms)
    return Candidate(
        tx_id=transaction.tx_id,
        envelope=envelope,
        creator=b"",
        timestamp_ms=transaction.timestamp_ms,
        code=code,
        config_sequence=trust.config.sequence,
        rwset=rwset,
        signers=signers,
    )


def _next_trust(trust: ChannelTrust, block: Block) -> ChannelTrust:
    found = ChannelTrust.of(block.number, block.envelopes[0])
    if len(block.envelopes) != 1 or found.channel != trust.channel:
        raise VerificationError(f"a configuration of {found.channel!r} in a block of {len(block.envelopes)}")
    if found.config.sequence != trust.config.sequence + 1:
        raise VerificationError(f"configuration {found.config.sequence} after {trust.config.sequence}")
    return found


def _as_recorded(block: Block) -> list[CommittedTx]:
    return [CommittedTx(each.tx_id, each.validation_code, each.timestamp_ms, ()) for each in block.transactions]


def _store(store: Recomputed, block: Block, results: Sequence[CommittedTx], trust: ChannelTrust) -> None:
    meta = {LAST_CONFIG: str(trust.number).encode()} if trust.number == block.number else {}
    store.stage_block(block.number, block.header.hash, b"", results, meta)
    store.commit(block.number)
