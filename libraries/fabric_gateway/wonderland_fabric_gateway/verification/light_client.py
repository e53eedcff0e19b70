"""A channel followed block by block as one believes it who trusts no single peer.

What is kept from block to block: whom the channel trusts, the contract's endorsement policy, and the policies that
records have of their own. A block that does not hold under them is a `VerificationError`, and nothing of it is kept.
What nobody signs (a transaction's validity) is believed of no peer alone: another organisation's is to be asked.
"""

from __future__ import annotations

import hashlib
from collections.abc import MutableMapping
from typing import TYPE_CHECKING, Final

from fabric_protos.peer.lifecycle import chaincode_definition_pb2, db_pb2

from wonderland_fabric_gateway.blocks import block_signatures
from wonderland_fabric_gateway.errors import BlockError, LedgerError, VerificationError
from wonderland_fabric_gateway.protobuf import decode
from wonderland_fabric_gateway.signature_policies import VALIDATION_PARAMETER, parse_policy, satisfied
from wonderland_fabric_gateway.transactions import TransactionType
from wonderland_fabric_gateway.verification.block_checks import last_config_of, orderers, require_orderers
from wonderland_fabric_gateway.verification.channel_trust import ChannelTrust
from wonderland_fabric_gateway.verification.transaction_checks import (
    SignedTransaction,
    check_proposal,
    check_sender,
    counted_endorsers,
    policy_holds,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from wonderland_fabric_gateway.blocks import Block
    from wonderland_fabric_gateway.signature_policies import Signer
    from wonderland_fabric_gateway.transactions import Invocation, Transaction, Write

CONTRACT_POLICY: Final = "/Channel/Application/Endorsement"
"""Of a contract for which the channel has agreed on no other; an embedded ledger's have none."""
LIFECYCLE_POLICY: Final = "/Channel/Application/LifecycleEndorsement"
LIFECYCLE: Final = "_lifecycle"
MOST_TIMES: Final = 4


Policies = MutableMapping[bytes, bytes]
"""Endorsement policies by `policy_key`: of records that have one of their own, and of contracts."""
Endorsers = tuple["tuple[Signer, ...] | None", ...]
"""For each transaction of a block who endorsed it; None for those that changed nothing."""


class LightClient:
    """``trust`` is in force for the block after ``number``; ``policies`` are those that hold after it."""

    def __init__(self, number: int, trust: ChannelTrust, policies: Policies) -> None:
        self.number = number
        self.trust = trust
        self.policies = policies
        self._shared: dict[bytes, bytes] = {each: each for each in policies.values()}

    @classmethod
    def begin(cls, genesis: Block, pinned: bytes | None = None) -> LightClient:
        """From a channel's first block, the hash of whose header may be ``pinned``. Raises `VerificationError`."""
        if genesis.number != 0 or (pinned is not None and genesis.header.hash != pinned):
            raise VerificationError(f"the channel's first block is {genesis.header.hash.hex()}, not the pinned one")
        if genesis.config is not None and not genesis.transactions[0].is_valid:
            name = genesis.transactions[0].validation_name
            raise VerificationError(f"the channel's first block is {name}, says the peer; no channel begins so")
        trust = _brought(genesis)
        if trust is None:
            raise VerificationError("the channel's first block carries no configuration")
        return cls(0, trust, {})

    def take(self, block: Block, endorsed: Endorsers | None = None, now_ms: int = 0) -> None:
        """Check the next block and follow it. Raises `VerificationError`, which says block and transaction.

        ``endorsed``: what `signed` found under this very trust, where another process did that part.
        """
        if block.number != self.number + 1:
            raise VerificationError(f"block {block.number} came after {self.number}")
        try:
            found = signed(self.trust, block, now_ms) if endorsed is None else endorsed
            brought = _brought(block)
            self._require_last_config(block, brought)
            for transaction, signers in zip(block.transactions, found, strict=True):
                if signers is not None:
                    self._endorsed(transaction, signers)
            for transaction in block.transactions:
                if transaction.is_valid and transaction.invocation is not None:
                    self._remember(transaction.invocation)
        except LedgerError as cause:
            raise VerificationError(f"block {block.number}: {cause}") from cause
        self.number = block.number
        self.trust = brought or self.trust

    def _require_last_config(self, block: Block, brought: ChannelTrust | None) -> None:
        if brought is not None and (
            brought.channel != self.trust.channel or brought.config.sequence != self.trust.config.sequence + 1
        ):
            raise VerificationError(
                f"a configuration {brought.config.sequence} of {brought.channel!r} after {self.trust.config.sequence}"
            )
        named, expected = last_config_of(block), block.number if brought else self.trust.number
        if named != expected:
            raise VerificationError(f"its orderers name config block {named}; {expected} is in force")

    def _endorsed(self, transaction: Transaction, signers: Sequence[Signer]) -> None:
        """Those who endorsed were those who had to. Raises `VerificationError`."""
        invocation = transaction.invocation
        assert invocation is not None  # `signed` endorses no other
        names = ", ".join(sorted({each.msp_id for each in signers})) or "nobody"
        for access in invocation.accesses:
            if access.namespace == LIFECYCLE:
                # Approvals are written to their organisation's own collection, which a block shows as hashes.
                if access.writes and not self.trust.holds_at(LIFECYCLE_POLICY, signers):
                    raise VerificationError(f"{_name(transaction)}: a contract's definition, agreed on by {names}")
                continue
            written = {each.key for each in access.writes} | {each.key for each in access.metadata_writes}
            if not written and access.namespace != invocation.chaincode:
                continue  # what is only read binds nobody
            own = [self.policies.get(policy_key(access.namespace, key)) for key in sorted(written)]
            for each in filter(None, own):
                policy = parse_policy(each)
                if policy is None or not satisfied(policy, signers):
                    raise VerificationError(
                        f"{_name(transaction)}: endorsed by {names}, which a record's own policy does not accept"
                    )
            if (None in own or not own) and not self._contract_accepts(access.namespace, signers):
                raise VerificationError(
                    f"{_name(transaction)}: endorsed by {names}, which the contract's policy does not accept"
                )

    def _remember(self, invocation: Invocation) -> None:
        for key, policy in policy_changes(invocation):
            if policy is None:
                self.policies.pop(key, None)
            else:  # most records have one of a few, and share its bytes
                self.policies[key] = self._shared.setdefault(policy, policy)

    def _contract_accepts(self, contract: str, signers: Sequence[Signer]) -> bool:
        policy = self.policies.get(policy_key(LIFECYCLE, contract))
        if policy is None:
            return self.trust.holds_at(CONTRACT_POLICY, signers)
        return policy_holds(self.trust, policy, signers)


def policy_key(namespace: str, key: str) -> bytes:
    """What a policy is kept by: SHA-256 of a record's namespace and key; a contract is a key of ``_lifecycle``."""
    return hashlib.sha256(f"{namespace}\0{key}".encode()).digest()


def signed(trust: ChannelTrust, block: Block, now_ms: int = 0) -> Endorsers:
    """Every signature of a block that changes something: orderers, senders, endorsers. Raises `VerificationError`.

    It needs nothing but the configuration in force, so that several blocks can be looked at side by side.
    """
    require_ordered(trust, block, now_ms)
    found: list[tuple[Signer, ...] | None] = []
    for transaction, envelope in zip(block.transactions, block.envelopes, strict=True):
        if not transaction.is_valid or transaction.type is TransactionType.CONFIG:
            found.append(None)
            continue
        try:
            whole = SignedTransaction.of(transaction, envelope)
            check_sender(trust, whole)
            check_proposal(whole)
            found.append(counted_endorsers(trust, whole.invocation, transaction.timestamp_ms))
        except LedgerError as cause:
            raise VerificationError(f"{_name(transaction)}: {cause}") from cause
    return tuple(found)


def require_ordered(trust: ChannelTrust, block: Block, now_ms: int = 0) -> None:
    """Enough orderers signed a block. Raises `VerificationError`.

    A block has no time of its own. Peers endorse within a quarter of an hour of their own clocks, but anybody may have
    a transaction ordered that they refuse, and say any time in it: so the orderers' certificates have to be valid at
    one of the times that the block says, at the configuration's, or ``now_ms``.
    """
    said_ms = sorted({each.timestamp_ms for each in block.transactions}, reverse=True)
    signatures = block_signatures(block)
    problem: VerificationError | None = None
    for at_ms in (*said_ms[:MOST_TIMES], trust.at_ms, now_ms):
        try:
            require_orderers(trust, orderers(trust, signatures, at_ms))
        except VerificationError as error:
            problem = problem or error
        else:
            return
    assert problem is not None
    raise problem


def policy_changes(invocation: Invocation) -> Iterator[tuple[bytes, bytes | None]]:
    """Which policies a valid transaction sets, and which it takes away (None); raises `LedgerError` for odd ones."""
    for access in invocation.accesses:
        if access.namespace == LIFECYCLE:
            yield from ((policy_key(LIFECYCLE, contract), policy) for contract, policy in _defined(access.writes))
            continue
        for write in access.writes:
            if write.is_delete:
                yield policy_key(access.namespace, write.key), None
        for each in access.metadata_writes:
            yield policy_key(access.namespace, each.key), dict(each.entries).get(VALIDATION_PARAMETER) or None


def _defined(writes: Sequence[Write]) -> list[tuple[str, bytes]]:
    """Contracts and the endorsement policies (``peer.ApplicationPolicy``) that a definition gives them."""
    found: list[tuple[str, bytes]] = []
    for write in writes:
        *where, contract, field = write.key.split("/")
        if where != ["namespaces", "fields"] or field != "ValidationInfo":
            continue
        data = decode(db_pb2.StateData, write.value, "contract definition", BlockError)
        info = decode(chaincode_definition_pb2.ChaincodeValidationInfo, data.Bytes, "contract definition", BlockError)
        if info.validation_plugin != "vscc":
            raise VerificationError(f"{contract} is validated by {info.validation_plugin!r}, which nobody here knows")
        found.append((contract, info.validation_parameter))
    return found


def _brought(block: Block) -> ChannelTrust | None:
    """The trust that a block brings; a configuration stands alone in its block."""
    if not any(each.is_valid and each.type is TransactionType.CONFIG for each in block.transactions):
        return None
    if len(block.transactions) != 1:
        raise VerificationError("a configuration among other transactions")
    return ChannelTrust.of(block.number, block.envelopes[0])


def _name(transaction: Transaction) -> str:
    return f"transaction {transaction.tx_id[:16] or transaction.index}"
