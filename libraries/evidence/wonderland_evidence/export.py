"""Makes the file from any ledger, by the Gateway alone: blocks, the channel's configurations, signed answers.

It fetches what `derive` misses until nothing is missed, so that exporter and verifier agree on what is needed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Final

from wonderland.proofs import encoding
from wonderland.proofs.errors import ProofError
from wonderland.proofs.records.sessions import Session
from wonderland_evidence.bundle import Bundle, BundleBlock, ValidityAnswer
from wonderland_evidence.case import QUERY, QUESTION, SESSION_FUNCTIONS, Case, is_about
from wonderland_evidence.derive import rests_on
from wonderland_evidence.errors import ExportError, MissingBlockError, UnreachedError
from wonderland_evidence.trust import trust_document
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.gateway.errors import GatewayError
from wonderland_fabric_gateway.verification.block_checks import last_config
from wonderland_fabric_gateway.verification.channel_trust import ChannelTrust
from wonderland_fabric_gateway.verification.transaction_checks import counted_endorsers

if TYPE_CHECKING:
    from wonderland_fabric_gateway.gateway.client import Network
    from wonderland_fabric_gateway.transactions import Transaction

MAX_SCANNED: Final = 1_000_000
NO_SUCH_TRANSACTION: Final = "no such transaction ID"
"""Fabric's own words, and the embedded ledger's."""
Progress = Callable[[str], None]


def silent(text: str) -> None:
    """Nobody wants to know."""
    del text


def _failed(what: str, cause: GatewayError) -> ExportError:
    """The error for a call that failed: one that reached nobody is no finding about the ledger."""
    if cause.is_unreached:
        return UnreachedError(
            f"the ledger could not be reached: check its address, the certificates for TLS (connection.json) and this "
            f"machine's clock ({cause})"
        )
    return ExportError(f"{what}: {cause}")


class Ledger:
    """A channel as the exporter asks it; blocks are fetched once. Raises `ExportError`."""

    def __init__(self, network: Network) -> None:
        self.network: Final = network
        self._queries = network.contract(QUERY)
        self._blocks: dict[int, BundleBlock] = {}

    async def block(self, number: int) -> BundleBlock:
        """A block by its number."""
        if number not in self._blocks:
            try:
                raw = await self._queries.evaluate("GetBlockByNumber", self.network.name, str(number))
            except GatewayError as cause:
                raise _failed(f"block {number} cannot be had", cause) from cause
            self._blocks[number] = BundleBlock.of(raw)
        return self._blocks[number]

    async def number_of(self, tx_id: str) -> int:
        """The block of a transaction."""
        try:
            block = BundleBlock.of(await self._queries.evaluate("GetBlockByTxID", self.network.name, tx_id))
        except GatewayError as cause:
            if NO_SUCH_TRANSACTION in str(cause):
                raise ExportError(f"the ledger knows no session {tx_id[:80]}: {cause}") from cause
            raise _failed("the ledger does not say whether it knows the session", cause) from cause
        self._blocks[block.number] = block
        return block.number

    async def configurations(self) -> dict[int, BundleBlock]:
        """All config blocks and the blocks before them, from the newest one back to the first."""
        try:
            newest = BundleBlock.of(await self.network.contract("cscc").evaluate("GetConfigBlock", self.network.name))
        except GatewayError as cause:
            raise _failed("the channel's configuration cannot be had", cause) from cause
        found = {newest.number: newest}
        number = newest.number
        while number:
            before = await self.block(number - 1)
            found.setdefault(before.number, before.without_data())
            number = last_config(before.value) if before.number else 0
            found[number] = await self.block(number)
        return found

    async def answer(self, tx_id: str, organisations: list[str]) -> ValidityAnswer:
        """What peers of these organisations sign of a transaction's validity."""
        proposal = self._queries.propose(
            QUESTION.decode(), self.network.name, tx_id, endorsing_organizations=organisations
        )
        try:
            signed = await proposal.endorse()
        except GatewayError as cause:
            raise _failed(f"peers of {', '.join(organisations)} do not sign their answer", cause) from cause
        invocation = signed.invocation
        return ValidityAnswer(
            channel_header=signed.header.channel_header,
            signature_header=signed.header.signature_header,
            proposal=invocation.proposal_payload,
            response=invocation.response_payload,
            endorsements=tuple((each.endorser.creator, each.signature) for each in invocation.endorsements),
        )


async def export(network: Network, chaincode: str, session_id: str, progress: Progress = silent) -> Bundle:
    """The evidence of a session. Raises `ExportError`."""
    ledger = Ledger(network)
    progress("the session's transactions")
    transactions = await _transactions(ledger, chaincode, session_id)
    needed = {number: await ledger.block(number) for number in transactions.values()}
    progress("the channel's configurations")
    needed = {**await ledger.configurations(), **needed}
    begun = Case(Bundle(network.name, chaincode, session_id, tuple(needed[number] for number in sorted(needed)), ()))
    endorsers = sorted(
        {msp_id for each, number in transactions.items() for msp_id in _endorsed_by(begun, each, number)}
    )
    progress(f"what peers of {', '.join(endorsers)} say of {len(transactions)} transactions")
    answers = tuple([await ledger.answer(each.tx_id, endorsers) for each in transactions])
    while True:
        bundle = Bundle(
            channel=network.name,
            chaincode=chaincode,
            session_id=session_id,
            blocks=tuple(needed[number] for number in sorted(needed)),
            validity=answers,
        )
        try:
            rests_on(Case(bundle))
        except MissingBlockError as missing:
            progress(str(missing))
            needed[missing.number] = await ledger.block(missing.number)
        except LedgerError as cause:
            raise ExportError(f"a block cannot be read: {cause}") from cause
        else:
            break
    progress("the blocks before and after")
    height = await network.height()
    for number in set(transactions.values()):
        for neighbour in (number - 1, number + 1):
            if neighbour not in needed and neighbour < height:
                needed[neighbour] = (await ledger.block(neighbour)).without_data()
    return Bundle(
        bundle.channel, bundle.chaincode, bundle.session_id, tuple(needed[each] for each in sorted(needed)), answers
    )


def _endorsed_by(case: Case, transaction: Transaction, number: int) -> set[str]:
    """Whose peers endorsed, by the signatures that hold: its sender may have named anybody besides."""
    if transaction.invocation is None:
        return set()
    counted = counted_endorsers(case.trust_before(number), transaction.invocation, transaction.timestamp_ms)
    return {each.msp_id for each in counted}


async def trust(network: Network, timestamp_roots: Sequence[bytes] = ()) -> bytes:
    """The trust file of a channel, with roots of time-stamping services (PEM) to pin. Raises `ExportError`."""
    configurations = await Ledger(network).configurations()
    genesis = configurations[0]
    newest = configurations[max(configurations)]
    first, last = (ChannelTrust.of(each.number, (each.data or ())[0]) for each in (genesis, newest))
    return trust_document(first, last, genesis.header.hash, timestamp_roots)


async def _transactions(ledger: Ledger, chaincode: str, session_id: str) -> dict[Transaction, int]:
    """The session's valid transactions with their blocks, in their order."""
    first = await ledger.number_of(session_id)
    network = ledger.network
    try:
        answer = await network.contract(chaincode).evaluate("ReadSession", encoding.encode({"session_id": session_id}))
        session = Session.decode(answer)
        height = await network.height()
        wanted = 1 + (session.decided_ms is not None) + (session.ended_ms is not None)
        found: dict[Transaction, int] = {}
        steps = 0
        async with network.blocks(start_block=first) as stream:
            async for block in stream:
                for transaction in block.transactions:
                    if transaction.is_valid and _is_of(transaction, chaincode, session_id):
                        found[transaction] = block.number
                        assert transaction.invocation is not None
                        steps += transaction.invocation.function != "WitnessProof"
                if steps >= wanted or block.number + 1 >= height:
                    break
    except GatewayError as cause:
        raise _failed("the session cannot be read", cause) from cause
    except (LedgerError, ProofError) as cause:
        raise ExportError(f"what the ledger says of the session cannot be read: {cause}") from cause
    if steps < wanted:
        raise ExportError(f"the ledger's blocks hold {steps} of {wanted} transactions of session {session_id[:12]}…")
    return found


def _is_of(transaction: Transaction, chaincode: str, session_id: str) -> bool:
    invocation = transaction.invocation
    if invocation is None or invocation.chaincode != chaincode:
        return False
    if transaction.tx_id == session_id:
        return True
    return invocation.function in SESSION_FUNCTIONS and is_about(invocation, session_id)
