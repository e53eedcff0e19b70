"""Signing by REST: keys, and transactions step by step."""

from __future__ import annotations

from base64 import urlsafe_b64decode
from typing import Annotated, Any, Final

from fastapi import APIRouter, Depends, Path, Query, Request
from fastapi.responses import Response

from backend.auth.access import allowed
from backend.auth.person import Person
from backend.context import Context, context_of
from backend.errors import BadRequest, Conflict, Forbidden, LedgerAway, NotFound, TooManyRequests, documented
from backend.responses import Json
from backend.transactions import enrolment, keys, store
from backend.transactions.functions import SIGNING_ROLES
from backend.transactions.schemas import (
    TX_ID,
    BringKey,
    DemoKey,
    EnrolKey,
    Propose,
    Signature,
    SignedTransaction,
    SignedTransactions,
    SigningKey,
    SigningPlace,
    SubmitAgain,
)
from backend.transactions.service import Signing

router = APIRouter(tags=["signing"])
_NOT_FOUND: Final = NotFound("You have no such transaction under way here.")
_SETTLED: Final = Conflict("It was proposed too long ago to be signed now; begin again.")
_BAD_SIGNATURE: Final = BadRequest("The signature is no base64url.", ("body.signature", "not base64url"))
_BAD_ARGUMENT: Final = BadRequest(
    "SuspendUav: reason: at least 1 character", ("body.argument.reason", "at least 1 character")
)
_BAD_KEY: Final = BadRequest(
    "The key does not fit the certificate: the signature is another key's.",
    ("body.signature", "the signature is another key's"),
)
_BAD_REQUEST: Final = BadRequest("The request is no PKCS#10 in PEM.", ("body.request", "no PKCS#10 in PEM"))
NO_STORE = {"Cache-Control": "private, no-store"}
Signer = Annotated[Person, Depends(allowed("admin", "inspector", "pad_operator", "fleet_operator"))]
"""Whoever may have a key at all; the ledger decides what it may do."""
TxId = Annotated[str, Path(pattern=TX_ID)]


def signing_of(context: Context) -> Signing:
    """The service, where this backend has a ledger to sign for. Raises `LedgerAway`."""
    if context.signing is None:
        raise LedgerAway("This server has no ledger of its own: nothing can be signed here.")
    return context.signing


@router.get("/signing-keys", response_model=SigningPlace, responses=documented(Forbidden, LedgerAway))
async def read_signing_place(request: Request, person: Signer) -> Response:
    """One's keys, and what a browser needs to make or bring another one."""
    context = context_of(request)
    signing_of(context)
    assert context.ledger is not None
    content = {
        "channel": context.ledger.channel,
        "chaincode": context.ledger.chaincode,
        "challenge": keys.challenge_of(person),
        "organisations": context.ledger.enrols(context.members.msp_ids),
        "demo_roles": sorted(SIGNING_ROLES) if context.demo_registrar is not None else [],
        "keys": await context.signing_keys.of(person),
    }
    return Json(content, headers=NO_STORE)


@router.post(
    "/signing-keys", response_model=SigningKey, status_code=201, responses=documented(_BAD_KEY, Forbidden, Conflict)
)
async def bring_signing_key(request: Request, body: BringKey, person: Signer) -> Response:
    """Bind a certificate whose key the browser has, by a signature over the challenge."""
    context = context_of(request)
    row = await context.signing_keys.bring(person, body.msp_id, body.certificate, _bytes(body.signature))
    return Json(context.signing_keys.shown(row), 201, headers=NO_STORE)


@router.post(
    "/signing-keys/enrol",
    response_model=SigningKey,
    status_code=201,
    responses=documented(_BAD_REQUEST, Forbidden, Conflict, LedgerAway),
)
async def enrol_signing_key(request: Request, body: EnrolKey, person: Signer) -> Response:
    """Have an organisation's CA certify the browser's key; the secret is passed on, and kept nowhere."""
    context = context_of(request)
    signing_of(context)
    assert context.ledger is not None
    asked = enrolment.read_request(body.request)
    certificate = await enrolment.enrol(context.ledger, body.msp_id, asked, body.secret)
    row = await context.signing_keys.bind_issued(person, body.msp_id, certificate)
    return Json(context.signing_keys.shown(row), 201, headers=NO_STORE)


@router.post(
    "/signing-keys/demo",
    response_model=SigningKey,
    status_code=201,
    responses=documented(
        _BAD_REQUEST,
        Forbidden,
        NotFound("This is no demo: enrol with a secret from your organisation's CA."),
        LedgerAway,
    ),
)
async def enrol_demo_key(request: Request, body: DemoKey, person: Signer) -> Response:
    """In a demo only: a certificate for a role, at a click."""
    context = context_of(request)
    signing_of(context)
    if context.demo_registrar is None or context.ledger is None:
        raise NotFound("This is no demo: enrol with a secret from your organisation's CA.")
    asked = enrolment.read_request(body.request)
    msp_id, certificate = await enrolment.enrol_in_demo(context.ledger, context.demo_registrar, body.role, asked)
    row = await context.signing_keys.bind_issued(person, msp_id, certificate)
    return Json(context.signing_keys.shown(row), 201, headers=NO_STORE)


@router.delete("/signing-keys/{certificate_sha256}", status_code=204, responses=documented(Forbidden, NotFound))
async def end_signing_key(request: Request, certificate_sha256: TxId, person: Signer) -> Response:
    """Take a key off the account."""
    await context_of(request).signing_keys.end(person, certificate_sha256)
    return Response(status_code=204)


@router.get("/transactions/proposals", response_model=SignedTransactions, responses=documented(Forbidden))
async def list_proposals(request: Request, person: Signer, limit: Annotated[int, Query(ge=1, le=500)] = 50) -> Response:
    """One's own transactions of the last 30 days, newest first."""
    async with context_of(request).database.read() as database:
        rows = await store.latest(database, person.person_id, limit)
    return Json({"items": [store.shown(row) for row in rows]}, headers=NO_STORE)


@router.post(
    "/transactions/proposals",
    response_model=SignedTransaction,
    status_code=201,
    responses=documented(_BAD_ARGUMENT, Forbidden, TooManyRequests, LedgerAway),
)
async def propose_transaction(request: Request, body: Propose, person: Signer) -> Response:
    """Begin a change: the bytes to sign come back in `to_sign`."""
    context = context_of(request)
    signing = signing_of(context)
    identity = await context.signing_keys.usable(person, body.certificate_sha256)
    row, message = await signing.propose(person, body, identity)
    return Json(store.shown(row, to_sign=message), 201, headers=NO_STORE)


@router.get(
    "/transactions/proposals/{tx_id}", response_model=SignedTransaction, responses=documented(Forbidden, _NOT_FOUND)
)
async def read_proposal(request: Request, tx_id: TxId, person: Signer) -> Response:
    """How far it is."""
    return await _shown(signing_of(context_of(request)), person, tx_id)


@router.post(
    "/transactions/proposals/{tx_id}/endorse",
    response_model=SignedTransaction,
    responses=documented(_BAD_SIGNATURE, Forbidden, _NOT_FOUND, _SETTLED, LedgerAway),
)
async def endorse_transaction(request: Request, tx_id: TxId, body: Signature, person: Signer) -> Response:
    """Signed once: peers run it. Endorsed, it has the next bytes in `to_sign`; refused, it says by whom and why."""
    signing = signing_of(context_of(request))
    await signing.endorse(person, tx_id, _bytes(body.signature))
    return await _shown(signing, person, tx_id)


@router.post(
    "/transactions/proposals/{tx_id}/submit",
    response_model=SignedTransaction,
    status_code=202,
    responses=documented(_BAD_SIGNATURE, Forbidden, _NOT_FOUND, _SETTLED),
)
async def submit_transaction(request: Request, tx_id: TxId, body: SubmitAgain, person: Signer) -> Response:
    """Signed twice: to the ledger. Ask for its state until that is an outcome; it cannot take effect twice."""
    signing = signing_of(context_of(request))
    await signing.submit(person, tx_id, None if body.signature is None else _bytes(body.signature))
    return await _shown(signing, person, tx_id, 202)


async def _shown(signing: Signing, person: Person, tx_id: str, status: int = 200) -> Response:
    row, to_sign = await signing.look(person, tx_id)
    content: dict[str, Any] = store.shown(row, to_sign=to_sign)
    return Json(content, status, headers=NO_STORE)


def _bytes(text: str) -> bytes:
    try:
        return urlsafe_b64decode(text + "=" * (-len(text) % 4))
    except ValueError:
        raise BadRequest("The signature is no base64url.", ("body.signature", "not base64url")) from None
