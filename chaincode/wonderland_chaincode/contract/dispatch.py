"""From a function's name and one JSON object to a transaction, its answer and its event."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from typing import Any, Final

from wonderland.proofs import encoding
from wonderland.proofs.errors import ProofError
from wonderland.proofs.records.transactions import TRANSACTIONS
from wonderland_chaincode.contract import (
    access,
    assets,
    audit,
    calibrations,
    changes,
    closures,
    landings,
    pads,
    policies,
    queueing,
    reservations,
    sessions,
    uavs,
    witnesses,
)
from wonderland_chaincode.contract.call import Answer, Call
from wonderland_chaincode.contract.errors import bad_input, not_there
from wonderland_chaincode.stub import Stub

Handler = Callable[[Call, Any], Awaitable[Answer]]

HANDLERS: Final[Mapping[str, Handler]] = {
    "RegisterPad": pads.register,
    "UpdatePad": pads.update,
    "RetirePad": pads.retire,
    "CommissionPad": pads.commission,
    "SetSitePlan": pads.set_site_plan,
    "PublishPrekeys": pads.publish_prekeys,
    "ReadPad": pads.read,
    "ListPrekeys": pads.list_prekeys,
    "RegisterUav": uavs.register,
    "SetUavStatus": uavs.set_status,
    "RecordMaintenance": uavs.record_maintenance,
    "CalibrateUav": calibrations.register,
    "WithdrawCalibration": calibrations.withdraw,
    "GrantAuthorisation": uavs.grant,
    "RevokeAuthorisation": uavs.revoke,
    "ReadUav": uavs.read,
    "ProposePolicy": changes.propose_policy,
    "ProposeReinstatement": changes.propose_reinstatement,
    "ApproveChange": changes.approve,
    "WithdrawChange": changes.withdraw,
    "ReadChange": changes.read,
    "ReadPolicy": policies.read,
    "SetClosures": closures.set_closures,
    "ReadClosures": closures.read,
    "RequestProof": sessions.request,
    "WitnessProof": witnesses.testify,
    "SubmitProof": sessions.submit,
    "CompleteInteraction": sessions.complete,
    "ReportLanding": landings.report,
    "CancelProof": sessions.cancel,
    "GivePrecedence": queueing.give_precedence,
    "RecordDeparture": queueing.record_departure,
    "ReservePad": reservations.reserve,
    "CancelReservation": reservations.cancel,
    "ReadReservations": reservations.read,
    "ReadSession": sessions.read,
    "ReadVerdict": sessions.read_verdict,
    "ReadTestimony": witnesses.read,
    "CreateAsset": assets.create,
    "UpdateAsset": assets.update,
    "DeleteAsset": assets.delete,
    "ReadAsset": assets.read,
    "AssetHistory": assets.history,
    "AnchorAuditLog": audit.anchor,
    "ListAuditHeads": audit.heads,
}


class Contract:
    """The proof-of-location contract. It holds no state of its own: one object serves any number of transactions."""

    name: Final = "pol"
    version: Final = "1.0"
    functions: Final = frozenset(HANDLERS)
    """Names of its transactions and queries."""

    async def invoke(self, stub: Stub, function: str, args: list[bytes]) -> bytes:
        """Run one transaction or query; the result is canonical JSON. Raises ContractError, and writes nothing then.

        ``args`` holds one JSON object: the argument that ``records.transactions`` gives for the function.
        """
        transaction = TRANSACTIONS.get(function)
        handler = HANDLERS.get(function)
        if transaction is None or handler is None:
            raise not_there(
                "FUNCTION_UNKNOWN", f"no function {function[:40]!r}; there are {', '.join(sorted(TRANSACTIONS))}"
            )
        if len(args) != 1:
            raise bad_input("ONE_ARGUMENT", f"{function} takes one argument, a JSON object; {len(args)} came")
        access.require_role(stub.creator, transaction.roles, function)
        try:
            argument = transaction.argument.decode(args[0])
        except ProofError as error:
            raise bad_input("BAD_ARGUMENT", str(error)) from None
        answer = await handler(Call(stub, self.version), argument)
        if transaction.event:
            payload = {
                "kind": transaction.event,
                "tx_id": stub.tx_id,
                "t_ms": stub.timestamp_ms,
                "record": answer.event or {},
            }
            stub.set_event(transaction.event, encoding.encode(payload))
        return encoding.encode(answer.result)


CONTRACT: Final = Contract()
