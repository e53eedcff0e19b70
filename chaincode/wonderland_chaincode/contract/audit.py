"""Heads of audit logs. Each stands under the name of who anchored it, so that nobody can be in another's way.

They are numbered without a gap and never change: a log that was cut, dated anew or swapped contradicts them. One name
has one log: whoever has the database could else begin another, which the server would anchor in good faith.
"""

from __future__ import annotations

from wonderland.proofs.records import keys
from wonderland.proofs.records.audit import AnchorAuditLog, AuditHead, AuditHeadsOf
from wonderland_chaincode.contract import access
from wonderland_chaincode.contract.call import Answer, Call, stored
from wonderland_chaincode.contract.errors import refused


async def anchor(call: Call, argument: AnchorAuditLog) -> Answer:
    """AnchorAuditLog."""
    name = access.name_of(call.who)
    newest = keys.composite(keys.AUDIT_LOG, name)
    last = await call.find_record(newest, AuditHead)
    if last is not None and argument.log != last.log:
        raise refused(
            "AUDIT_LOG_OTHER",
            f"{name!r} anchors the log {last.log}, not {argument.log}; another installation or a new database needs "
            "an identity of its own",
        )
    if last is not None and argument.seq <= last.seq:
        raise refused(
            "AUDIT_LOG_SHORTER",
            f"the log of {name!r} had {last.seq} rows already when it was anchored; a log only grows. Check it with "
            "`wonderland backend audit verify`",
        )
    if last is not None and call.now_ms < last.anchored_ms:
        raise refused("AUDIT_HEAD_EARLIER", "the head before is later than this one; set the clock")
    head = AuditHead(
        anchored_by=name,
        log=argument.log,
        number=1 if last is None else last.number + 1,
        seq=argument.seq,
        sha256=argument.sha256,
        anchored_ms=call.now_ms,
        tx_id=call.stub.tx_id,
    )
    await call.store(_key(name, head.number), head)
    await call.store(newest, head)
    return Answer.of(head)


async def heads(call: Call, argument: AuditHeadsOf) -> Answer:
    """ListAuditHeads: oldest first; fewer than ``limit`` where there are no more."""
    numbers = range(argument.after + 1, argument.after + argument.limit + 1)
    values = await call.stub.get_many([_key(argument.anchored_by, number) for number in numbers])
    found = [stored(value, AuditHead).to_json() for value in values if value is not None]
    return Answer({"heads": found})


def _key(anchored_by: str, number: int) -> str:
    return keys.composite(keys.AUDIT_HEAD, anchored_by, f"{number:016d}")
