"""The last step: CommissionPad on the ledger, as the pad's operator."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wonderland.proof_contract import AwayError, ProofContract, RefusedError
from wonderland.proofs import encoding
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.pads import Commissioning
from wonderland_edge_agent.commissioning.errors import PublishError
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.gateway import Gateway

_NOT_THERE = 404


@dataclass(frozen=True, kw_only=True)
class Operator:
    """Who publishes, and how a pad that the ledger does not know yet is to be called (empty: refuse)."""

    connection: Path
    identity: str = "pad_operator"
    register_as: str = ""
    operator_id: str = ""


async def publish(operator: Operator, pad_id: str, record: Commissioning) -> dict[str, Any]:
    """Commit the commissioning; ``{"tx_id", "block", "commissioning_sha256"}``. Raises PublishError.

    What is committed already is not committed again, so that it can be repeated after a lost answer.
    """
    try:
        connection = Connection.load(operator.connection)
        identity, signer = connection.identity(operator.identity), connection.signer(operator.identity)
        async with connection.open_channel() as channel:
            network = Gateway(channel, identity, signer).network(connection.channel)
            return await _publish(ProofContract(network, connection.chaincode), operator, pad_id, record)
    except AwayError as error:
        raise PublishError(f"the ledger cannot be reached: {error}; all steps are kept, publish again later") from error
    except RefusedError as error:
        raise PublishError(f"the ledger refuses: {error}") from error
    except LedgerError as error:
        raise PublishError(str(error)) from error


async def _publish(contract: ProofContract, operator: Operator, pad_id: str, record: Commissioning) -> dict[str, Any]:
    digest = encoding.digest(record.to_json()).hex()
    try:
        pad = await contract.read_pad(pad_id)
    except RefusedError as error:
        if error.status != _NOT_THERE:
            raise
        if not operator.register_as:
            raise PublishError(
                f"the ledger does not know pad {pad_id}; register it first, or give --register NAME --operator-id ID"
            ) from error
        frame = record.frame
        pad, _ = await contract.register_pad(
            tx.RegisterPad(
                pad_id=pad_id,
                name=operator.register_as,
                operator_id=operator.operator_id,
                lat_e7=frame.lat_e7,
                lon_e7=frame.lon_e7,
                height_mm=frame.height_mm,
            )
        )
    if pad.commissioning_sha256 == digest:
        return {"commissioning_sha256": digest, "tx_id": "", "block": -1}
    pad, done = await contract.commission_pad(pad_id, record)
    if pad.commissioning_sha256 != digest:
        raise PublishError(f"pad {pad_id}: the ledger keeps another commissioning than the one that was sent")
    return {"commissioning_sha256": digest, "tx_id": done.tx_id, "block": done.block_number}
