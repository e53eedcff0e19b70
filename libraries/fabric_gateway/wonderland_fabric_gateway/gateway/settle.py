"""From an endorsed transaction to its outcome, through whatever fails on the way.

The same transaction may be submitted any number of times: its id lets it take effect once at most, and the outcome
that is asked for is that of the first. So a lost answer is cured by sending it again, and so is an acknowledgement
by an orderer that died before it told the others (Raft's followers acknowledge what they have handed to the leader).
"""

from __future__ import annotations

import asyncio
import math
from typing import TYPE_CHECKING, Final

import grpc

from wonderland_fabric_gateway.gateway.backoff import Backoff
from wonderland_fabric_gateway.gateway.commit import new_commit
from wonderland_fabric_gateway.gateway.errors import CommitStatusError, CommitUnknownError, SubmitError

if TYPE_CHECKING:
    from wonderland_fabric_gateway.gateway.calls import Environment
    from wonderland_fabric_gateway.gateway.commit import CommitStatus
    from wonderland_fabric_gateway.gateway.transaction import Transaction

FIRST_LOOK_S: Final = 0.1
"""How long the outcome is waited for after an answer was lost, before the transaction is sent again; doubled then."""
_WORTH_ASKING_AGAIN: Final = frozenset(
    {
        grpc.StatusCode.UNAVAILABLE,
        grpc.StatusCode.INTERNAL,
        grpc.StatusCode.UNKNOWN,
        grpc.StatusCode.CANCELLED,
    }
)


async def settle(transaction: Transaction, environment: Environment) -> CommitStatus:
    """Submit, wait for the outcome, submit again when there is none.

    The outcome is asked for by the environment's identity, which need not be the transaction's own.

    Raises `SubmitError` when the orderers refuse it, `CommitStatusError` when the question is refused, and
    `CommitUnknownError` when nobody says what became of it within `Deadlines.commit_status_s`.
    """
    loop = asyncio.get_running_loop()
    deadlines = environment.calls.deadlines
    deadline_s = loop.time() + deadlines.commit_status_s
    backoff = Backoff(environment.random_bytes)
    look_s = FIRST_LOOK_S
    lost: SubmitError | None = None
    sent_s = -math.inf
    while True:
        if loop.time() - sent_s >= deadlines.resubmit_s:
            try:
                await transaction.submit()
            except SubmitError as error:
                # Refused once, it may have been taken before; then the outcome is what counts.
                if not error.outcome_unknown and lost is None and sent_s == -math.inf:
                    raise
                lost = error
            else:
                sent_s = loop.time()
        wait_s, look_s = (deadlines.resubmit_s, look_s) if sent_s > -math.inf else (look_s, 2 * look_s)
        left_s = deadline_s - loop.time()
        try:
            commit = new_commit(environment, transaction.channel, transaction.tx_id)
            return await commit.status(timeout_s=max(0.001, min(wait_s, deadlines.resubmit_s, left_s)))
        except CommitStatusError as error:
            if error.status_code in _WORTH_ASKING_AGAIN:
                pause_s = backoff.next_s()
            elif error.status_code is grpc.StatusCode.DEADLINE_EXCEEDED:
                pause_s = 0.0
            else:
                raise
            if loop.time() + pause_s >= deadline_s:
                raise CommitUnknownError(
                    f"no outcome within {deadlines.commit_status_s:g} s; {_said(sent_s, lost)}. Ask again with the "
                    "transaction id; a new proposal may do the same thing twice",
                    tx_id=transaction.tx_id,
                    status_code=error.status_code,
                    details=error.details,
                ) from error
        await asyncio.sleep(pause_s)


def _said(sent_s: float, lost: SubmitError | None) -> str:
    if sent_s > -math.inf:
        return "it was handed over"
    return f"whether it arrived is unknown ({lost.message if lost else 'no answer'})"
