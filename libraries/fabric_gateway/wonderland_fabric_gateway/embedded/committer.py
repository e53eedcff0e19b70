"""Which transactions of a block count: endorsements, repeated ids, read versions, phantoms; Fabric's order and codes.

Each key that a transaction writes needs the signatures that the key's own policy asks for or, without one, the
contract's. Source: Fabric, ``core/common/validation/statebased`` (keys), ``core/ledger/kvledger/txmgmt/validation``
(versions), ``protos.TxValidationCode`` (codes).
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from wonderland_fabric_gateway.embedded.range_reads import summary_of
from wonderland_fabric_gateway.embedded.rwset import ReadWriteSet
from wonderland_fabric_gateway.embedded.state import CommittedTx
from wonderland_fabric_gateway.signature_policies import parse_policy, satisfied
from wonderland_fabric_gateway.transactions import ValidationCode

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from fabric_protos.common.policies_pb2 import SignaturePolicyEnvelope

    from wonderland_fabric_gateway.embedded.range_reads import Version
    from wonderland_fabric_gateway.embedded.rwset import RangeRead, Write
    from wonderland_fabric_gateway.signature_policies import Signer


class CommittedState(Protocol):
    """What validation asks of the store (`wonderland_fabric_gateway.embedded.state.StateWriter`)."""

    def version(self, namespace: str, key: str) -> Version | None:
        """The committed version of a key."""

    def policy(self, namespace: str, key: str) -> bytes | None:
        """The committed endorsement policy of a key, if it has one of its own."""

    def versions(
        self, namespace: str, start: str, end: str, *, end_included: bool = False
    ) -> Iterator[tuple[str, Version]]:
        """The committed versions of a range, ascending."""

    def has_transaction(self, tx_id: str) -> bool:
        """Whether the id is already on the chain."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A transaction as it goes into a block: its envelope's bytes and what was found when it was submitted.

    `code` is VALID, or why the transaction is invalid whatever the state says (no endorsement, a wrong hash…).
    """

    tx_id: str
    envelope: bytes
    creator: bytes
    timestamp_ms: int
    code: int
    config_sequence: int
    """The channel configuration under which the creator was checked."""
    rwset: ReadWriteSet = field(default_factory=ReadWriteSet)
    signers: tuple[Signer, ...] = ()
    """Whose endorsements hold."""


def validate_block(
    state: CommittedState, block_number: int, candidates: Sequence[Candidate], policy: SignaturePolicyEnvelope
) -> list[CommittedTx]:
    """The verdict on each transaction in order; an earlier one in the same block counts as committed.

    `policy` is the contract's endorsement policy.
    """
    updates = _BlockUpdates(block_number)
    endorsements = _Endorsements(state, policy)
    seen: set[str] = set()
    result: list[CommittedTx] = []
    for position, candidate in enumerate(candidates):
        code = candidate.code
        if code == ValidationCode.VALID:
            if state.has_transaction(candidate.tx_id):
                code = ValidationCode.DUPLICATE_TXID
            elif not endorsements.hold(candidate):
                code = ValidationCode.ENDORSEMENT_POLICY_FAILURE
            elif candidate.tx_id in seen:
                code = ValidationCode.DUPLICATE_TXID
            else:
                code = _check_reads(state, updates, candidate.rwset)
                seen.add(candidate.tx_id)
        if code == ValidationCode.VALID:
            writes, policies = candidate.rwset.writes, candidate.rwset.policies
            updates.apply(position, writes)
            result.append(CommittedTx(candidate.tx_id, code, candidate.timestamp_ms, writes, policies))
        else:
            result.append(CommittedTx(candidate.tx_id, code, candidate.timestamp_ms, ()))
    return result


class _Endorsements:
    """Who must sign what, over one block."""

    def __init__(self, state: CommittedState, policy: SignaturePolicyEnvelope) -> None:
        self._state = state
        self._policy = policy
        self._changed: set[tuple[str, str]] = set()
        """Keys whose policy an earlier transaction of the block sets, whether or not it turns out valid in the end."""

    def hold(self, candidate: Candidate) -> bool:
        rwset, signers = candidate.rwset, candidate.signers
        set_anew = {(each.namespace, each.key) for each in rwset.policies}
        places = {(each.namespace, each.key) for each in rwset.writes} | set_anew
        if places & self._changed:
            return False
        own = {self._state.policy(*place) or b"" for place in places} or {b""}
        for data in own:
            policy = parse_policy(data) if data else self._policy
            if policy is None or not satisfied(policy, signers):
                return False
        self._changed |= set_anew
        return True


def _check_reads(state: CommittedState, updates: _BlockUpdates, rwset: ReadWriteSet) -> int:
    for read in rwset.reads:
        if updates.has(read.namespace, read.key) or state.version(read.namespace, read.key) != read.version:
            return ValidationCode.MVCC_READ_CONFLICT
    for item in rwset.ranges:
        now = updates.over(item, state.versions(item.namespace, item.start, item.end, end_included=not item.exhausted))
        if item.summary is not None:
            if summary_of(now) != item.summary:
                return ValidationCode.PHANTOM_READ_CONFLICT
        elif any(found != expected for found, expected in _pairs(now, item.results)):
            return ValidationCode.PHANTOM_READ_CONFLICT
    return ValidationCode.VALID


def _pairs(
    now: Iterator[tuple[str, Version]], then: Sequence[tuple[str, Version]]
) -> Iterator[tuple[tuple[str, Version] | None, tuple[str, Version] | None]]:
    """Both sides in step until both have ended; the shorter one is filled with None."""
    for expected in then:
        yield next(now, None), expected
    yield next(now, None), None


class _BlockUpdates:
    """The writes of the block's earlier valid transactions, laid over the committed state."""

    def __init__(self, block_number: int) -> None:
        self._block = block_number
        self._versions: dict[tuple[str, str], Version | None] = {}
        self._keys: dict[str, list[bytes]] = {}

    def has(self, namespace: str, key: str) -> bool:
        return (namespace, key) in self._versions

    def apply(self, position: int, writes: Sequence[Write]) -> None:
        for write in writes:
            place = write.namespace, write.key
            if place not in self._versions:
                keys = self._keys.setdefault(write.namespace, [])
                key = write.key.encode()
                keys.insert(bisect_left(keys, key), key)
            self._versions[place] = None if write.value is None else (self._block, position)

    def over(self, item: RangeRead, committed: Iterator[tuple[str, Version]]) -> Iterator[tuple[str, Version]]:
        """The range as it would read now: committed keys merged with the block's, deletions left out."""
        keys = self._keys.get(item.namespace)
        if not keys:
            yield from committed
            return
        merged: dict[str, Version | None] = dict(committed)
        end = item.end.encode()
        for index in range(bisect_left(keys, item.start.encode() or b"\x01"), len(keys)):
            key = keys[index]
            if end and (key > end if not item.exhausted else key >= end):
                break
            merged[key.decode()] = self._versions[item.namespace, key.decode()]
        for name in sorted(merged, key=str.encode):
            version = merged[name]
            if version is not None:
                yield name, version
