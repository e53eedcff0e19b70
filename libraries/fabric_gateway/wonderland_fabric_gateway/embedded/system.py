"""Queries about the ledger itself, asked like a contract's: Fabric's qscc and cscc, and this ledger's ``_ledger``.

- qscc: GetChainInfo, GetBlockByNumber, GetBlockByHash, GetBlockByTxID, GetTransactionByID (protocol buffers, as Fabric)
- cscc: GetConfigBlock, GetChannels
- _ledger: Describe (JSON: what this is, that it gives no multi-party trust, height and versions);
  RefreshRevocations, by which an organisation's administrator has the ledger read its CA's revocation list anew;
  Enrol, by which a name that was invited gets its certificate: JSON ``{"msp_id", "request", "secret"}`` for
  ``{"certificate"}``, both PEM. The secret decides, not who passes the request on.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Final

from fabric_protos.common import common_pb2, ledger_pb2
from fabric_protos.peer import query_pb2, transaction_pb2

from wonderland_fabric_gateway import __version__
from wonderland_fabric_gateway.ca import AlreadyEnrolledError, CaError, CertificateRequest, NotInvitedError
from wonderland_fabric_gateway.embedded import NOTICE
from wonderland_fabric_gateway.embedded.errors import ContractFailedError

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Mapping, Sequence

    from wonderland_fabric_gateway.embedded.chain import Chain
    from wonderland_fabric_gateway.embedded.contracts import Contract
    from wonderland_fabric_gateway.embedded.msp import Member

LEDGER: Final = "_ledger"
NAMES: Final = frozenset({"qscc", "cscc", LEDGER})
KIND: Final = "embedded"


class SystemQueries:
    """Answers for the names in `NAMES`.

    `refresh` re-reads the revocation lists and gives the config block's number; `enrol` takes an organisation, a
    certificate request and a one-time secret, and gives a certificate (PEM).
    """

    def __init__(
        self,
        chain: Chain,
        contracts: Mapping[str, Contract],
        refresh: Callable[[], Awaitable[int | None]] | None = None,
        enrol: Callable[[str, CertificateRequest, str], Awaitable[bytes]] | None = None,
    ) -> None:
        self._chain = chain
        self._contracts = contracts
        self._refresh = refresh
        self._enrol = enrol

    async def invoke(self, name: str, args: Sequence[bytes], member: Member) -> bytes:
        """Run a query. Raises `ContractFailedError`, as a contract does."""
        function = args[0].decode(errors="replace") if args else ""
        if name == LEDGER:
            return await self._ledger(function, args, member)
        if name == "cscc":
            return self._cscc(function, args)
        return self._qscc(function, args)

    async def _ledger(self, function: str, args: Sequence[bytes], member: Member) -> bytes:
        if function == "Describe":
            chain = self._chain
            return json.dumps(
                {
                    "kind": KIND,
                    "notice": NOTICE,
                    "channel": chain.settings.channel,
                    "height": chain.height,
                    "tip_hash": chain.tip.header_hash.hex(),
                    "config_block": chain.config_block,
                    "batch_ms": chain.settings.limits.time_ms,
                    "trouble": chain.trouble,
                    "verified_from": chain.verified_from,
                    "organisations": sorted(each.msp_id for each in chain.membership.organisations),
                    "contracts": {name: contract.version for name, contract in sorted(self._contracts.items())},
                    "version": __version__,
                }
            ).encode()
        if function == "RefreshRevocations":
            if member.creator.node_ou != "admin":
                raise ContractFailedError(403, "only an organisation's administrator (OU admin) may ask for that")
            if self._refresh is None:
                raise ContractFailedError(422, "this ledger has no certificate authorities to read from")
            block = await self._refresh()
            return json.dumps({"block": block} if block is not None else {}).encode()
        if function == "Enrol":
            return await self._enrolled(args)
        raise ContractFailedError(
            404, f"{LEDGER} has no function {function[:80]!r}; it has Describe, Enrol, RefreshRevocations"
        )

    async def _enrolled(self, args: Sequence[bytes]) -> bytes:
        if self._enrol is None:
            raise ContractFailedError(422, "this ledger has no certificate authorities to enrol with")
        try:
            asked = json.loads(args[1])
            msp_id, pem, secret = (asked[name] for name in ("msp_id", "request", "secret"))
        except (IndexError, ValueError, KeyError, TypeError, RecursionError) as cause:
            raise ContractFailedError(400, "Enrol takes a JSON object with msp_id, request and secret") from cause
        if not all(isinstance(each, str) for each in (msp_id, pem, secret)):
            raise ContractFailedError(400, "Enrol: msp_id, request and secret are texts")
        try:
            certificate = await self._enrol(msp_id, CertificateRequest.parse(pem), secret)
        except NotInvitedError as cause:
            raise ContractFailedError(403, str(cause)) from cause
        except AlreadyEnrolledError as cause:
            raise ContractFailedError(409, str(cause)) from cause
        except CaError as cause:
            raise ContractFailedError(400, str(cause)) from cause
        return json.dumps({"certificate": certificate.decode()}).encode()

    def _cscc(self, function: str, args: Sequence[bytes]) -> bytes:
        chain = self._chain
        if function == "GetChannels":
            channel = query_pb2.ChannelInfo(channel_id=chain.settings.channel)
            return bytes(query_pb2.ChannelQueryResponse(channels=[channel]).SerializeToString())
        if function == "GetConfigBlock":
            self._require_channel(args)
            return self._block(chain.config_block)
        raise ContractFailedError(500, f"Requested function {function[:80]} not found.")

    def _qscc(self, function: str, args: Sequence[bytes]) -> bytes:
        if len(args) < 2 or (function != "GetChainInfo" and len(args) < 3):
            raise ContractFailedError(500, f"Incorrect number of arguments, {len(args)}")
        self._require_channel(args)
        chain = self._chain
        if function == "GetChainInfo":
            tip = self._parsed(chain.tip.number)
            return bytes(
                ledger_pb2.BlockchainInfo(
                    height=chain.height,
                    currentBlockHash=chain.tip.header_hash,
                    previousBlockHash=tip.header.previous_hash,
                ).SerializeToString()
            )
        if function == "GetBlockByNumber":
            return self._block(_number(args[2]))
        if function == "GetBlockByHash":
            number = chain.reader.block_number(args[2])
            if number is None:
                raise ContractFailedError(
                    500, f"Failed to get block hash {args[2].hex()[:80]}, error no such block hash"
                )
            return self._block(number)
        tx_id = args[2].decode(errors="replace")[:80]
        location = chain.reader.transaction(tx_id)
        if function == "GetBlockByTxID":
            if location is None:
                raise ContractFailedError(500, f"Failed to get block for txID {tx_id}, error no such transaction ID")
            return self._block(location.block)
        if function == "GetTransactionByID":
            if location is None:
                raise ContractFailedError(
                    500, f"Failed to get transaction with id {tx_id}, error no such transaction ID"
                )
            envelope = common_pb2.Envelope.FromString(self._parsed(location.block).data.data[location.position])
            return bytes(
                transaction_pb2.ProcessedTransaction(
                    transactionEnvelope=envelope, validationCode=location.code
                ).SerializeToString()
            )
        raise ContractFailedError(500, f"Requested function {function[:80]} not found.")

    def _require_channel(self, args: Sequence[bytes]) -> None:
        if len(args) < 2 or args[1] != self._chain.settings.channel.encode():
            raise ContractFailedError(
                500, f"Invalid chain ID, {args[1].decode(errors='replace')[:80] if args[1:] else ''}"
            )

    def _block(self, number: int) -> bytes:
        raw = self._chain.block(number)
        if raw is None:
            raise ContractFailedError(500, f"Failed to get block number {number}, error no such block number")
        return raw

    def _parsed(self, number: int) -> common_pb2.Block:
        return common_pb2.Block.FromString(self._block(number))


def _number(text: bytes) -> int:
    if not (text.isdigit() and len(text) < 20):
        raise ContractFailedError(500, "Failed to parse block number: it takes decimal digits")
    number = int(text)
    if number >= 1 << 63:
        raise ContractFailedError(500, f"Failed to get block number {number}, error no such block number")
    return number
