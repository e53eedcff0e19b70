"""Signing by REST: keys, and transactions step by step."""

from __future__ import annotations

from base64 import urlsafe_b64decode
from typing import Annotated, Any, Final

from fastapi import APIRouter, Depends, Path, Query, Request
from fastapi.responses import Response

from wonderland.messages import Language
from wonderland.problems import said
from wonderland_backend.access import allowed
from wonderland_backend.agents.members import MembersDep
from wonderland_backend.auth import step_up
from wonderland_backend.auth.step_up import StepUpRequired
from wonderland_backend.context import ContextDep
from wonderland_backend.errors import BadRequest, Conflict, Forbidden, LedgerAway, NotFound, TooManyRequests, documented
from wonderland_backend.languages import LanguageDep
from wonderland_backend.ledger.access import LedgerDep
from wonderland_backend.person import Person
from wonderland_backend.responses import Json
from wonderland_backend.transactions import enrolment, keys, store
from wonderland_backend.transactions.enrolment import DemoRegistrarDep
from wonderland_backend.transactions.functions import CHANGES, FRESH, RECENT, SIGNING_ROLES
from wonderland_backend.transactions.keys import SigningKeysDep
from wonderland_backend.transactions.schemas import (
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
from wonderland_backend.transactions.service import Signing, SigningDep

router = APIRouter(tags=["signing"])
_NOT_FOUND: Final = NotFound(said("no_such_signing"))
_SETTLED: Final = Conflict(said("signing_expired"))
_BAD_SIGNATURE: Final = BadRequest(
    said("signature_no_base64url"), ("body.signature", said("signature_no_base64url_field"))
)
_BAD_ARGUMENT: Final = BadRequest(
    said("bad_argument", function="SuspendUav", path="reason", why="at least 1 character"),
    ("body.argument.reason", "at least 1 character"),
)
_BAD_KEY: Final = BadRequest(
    said("key_does_not_fit", why="the signature is another key's"),
    ("body.signature", "the signature is another key's"),
)
_BAD_REQUEST: Final = BadRequest(said("bad_csr", why="no PKCS#10 in PEM"), ("body.request", "no PKCS#10 in PEM"))
NO_STORE = {"Cache-Control": "private, no-store"}
Signer = Annotated[Person, Depends(allowed("admin", "inspector", "pad_operator", "fleet_operator"))]
"""Whoever may have a key at all; the ledger decides what it may do."""


async def _proved_for(request: Request, context: ContextDep, person: Signer, body: Propose) -> None:
    change = CHANGES.get(body.function)
    if change is not None and change.step_up == FRESH:
        await step_up.require_fresh(request, context, person)
    elif change is not None and change.step_up == RECENT:
        await step_up.require_recent(request, context, person)


Proved = Annotated[None, Depends(_proved_for)]
"""As fresh an assertion as the function asks for."""
TxId = Annotated[str, Path(pattern=TX_ID)]


@router.get("/signing-keys", response_model=SigningPlace, responses=documented(Forbidden, LedgerAway))
async def read_signing_place(
    person: Signer,
    ledger: LedgerDep,
    members: MembersDep,
    signing_keys: SigningKeysDep,
    demo_registrar: DemoRegistrarDep,
) -> Response:
    """One's keys, and what a browser needs to make or bring another one."""
    content = {
        "channel": ledger.channel,
        "chaincode": ledger.chaincode,
        "challenge": keys.challenge_of(person),
        "organisations": ledger.enrols(members.msp_ids),
        "demo_roles": sorted(SIGNING_ROLES) if demo_registrar is not None else [],
        "keys": await signing_keys.of(person),
    }
    return Json(content, headers=NO_STORE)


@router.post(
    "/signing-keys", response_model=SigningKey, status_code=201, responses=documented(_BAD_KEY, Forbidden, Conflict)
)
async def bring_signing_key(signing_keys: SigningKeysDep, body: BringKey, person: Signer) -> Response:
    """Bind a certificate whose key the browser has, by a signature over the challenge."""
    row = await signing_keys.bring(person, body.msp_id, body.certificate, _bytes(body.signature))
    return Json(signing_keys.key_json(row), 201, headers=NO_STORE)


@router.post(
    "/signing-keys/enrol",
    response_model=SigningKey,
    status_code=201,
    responses=documented(_BAD_REQUEST, Forbidden, Conflict, LedgerAway),
)
async def enrol_signing_key(
    body: EnrolKey, person: Signer, ledger: LedgerDep, signing_keys: SigningKeysDep
) -> Response:
    """Have an organisation's CA certify the browser's key; the secret is passed on, and kept nowhere."""
    asked = enrolment.read_request(body.request)
    certificate = await enrolment.enrol(ledger, body.msp_id, asked, body.secret)
    row = await signing_keys.bind_issued(person, body.msp_id, certificate)
    return Json(signing_keys.key_json(row), 201, headers=NO_STORE)


@router.post(
    "/signing-keys/demo",
    response_model=SigningKey,
    status_code=201,
    responses=documented(
        _BAD_REQUEST,
        Forbidden,
        NotFound(said("no_demo")),
        LedgerAway,
    ),
)
async def enrol_demo_key(
    body: DemoKey,
    person: Signer,
    ledger: LedgerDep,
    signing_keys: SigningKeysDep,
    demo_registrar: DemoRegistrarDep,
) -> Response:
    """In a demo only: a certificate for a role, at a click."""
    if demo_registrar is None:
        raise NotFound(said("no_demo"))
    asked = enrolment.read_request(body.request)
    msp_id, certificate = await enrolment.enrol_in_demo(ledger, demo_registrar, body.role, asked)
    row = await signing_keys.bind_issued(person, msp_id, certificate)
    return Json(signing_keys.key_json(row), 201, headers=NO_STORE)


@router.delete("/signing-keys/{certificate_sha256}", status_code=204, responses=documented(Forbidden, NotFound))
async def end_signing_key(signing_keys: SigningKeysDep, certificate_sha256: TxId, person: Signer) -> Response:
    """Take a key off the account."""
    await signing_keys.end(person, certificate_sha256)
    return Response(status_code=204)


@router.get("/transactions/proposals", response_model=SignedTransactions, responses=documented(Forbidden))
async def list_proposals(
    context: ContextDep, person: Signer, language: LanguageDep, limit: Annotated[int, Query(ge=1, le=500)] = 50
) -> Response:
    """One's own transactions of the last 30 days, newest first."""
    async with context.database.read() as database:
        rows = await store.latest(database, person.person_id, limit)
    return Json({"items": [store.transaction_json(row, language) for row in rows]}, headers=NO_STORE)


@router.post(
    "/transactions/proposals",
    response_model=SignedTransaction,
    status_code=201,
    responses=documented(_BAD_ARGUMENT, Forbidden, StepUpRequired, TooManyRequests, LedgerAway),
    openapi_extra=step_up.DOCUMENTED,
)
async def propose_transaction(
    body: Propose,
    person: Signer,
    _proved: Proved,
    signing: SigningDep,
    signing_keys: SigningKeysDep,
    language: LanguageDep,
) -> Response:
    """Begin a change: the bytes to sign come back in `to_sign`."""
    identity = await signing_keys.usable(person, body.certificate_sha256)
    row, message = await signing.propose(person, body, identity)
    return Json(store.transaction_json(row, language, to_sign=message), 201, headers=NO_STORE)


@router.get(
    "/transactions/proposals/{tx_id}", response_model=SignedTransaction, responses=documented(Forbidden, _NOT_FOUND)
)
async def read_proposal(tx_id: TxId, person: Signer, signing: SigningDep, language: LanguageDep) -> Response:
    """How far it is."""
    return await _shown(signing, person, tx_id, language)


@router.post(
    "/transactions/proposals/{tx_id}/endorse",
    response_model=SignedTransaction,
    responses=documented(_BAD_SIGNATURE, Forbidden, _NOT_FOUND, _SETTLED, LedgerAway),
)
async def endorse_transaction(
    tx_id: TxId, body: Signature, person: Signer, signing: SigningDep, language: LanguageDep
) -> Response:
    """Signed once: peers run it. Endorsed, it has the next bytes in `to_sign`; refused, it says by whom and why."""
    await signing.endorse(person, tx_id, _bytes(body.signature))
    return await _shown(signing, person, tx_id, language)


@router.post(
    "/transactions/proposals/{tx_id}/submit",
    response_model=SignedTransaction,
    status_code=202,
    responses=documented(_BAD_SIGNATURE, Forbidden, _NOT_FOUND, _SETTLED),
)
async def submit_transaction(
    tx_id: TxId, body: SubmitAgain, person: Signer, signing: SigningDep, language: LanguageDep
) -> Response:
    """Signed twice: to the ledger. Ask for its state until that is an outcome; it cannot take effect twice."""
    await signing.submit(person, tx_id, None if body.signature is None else _bytes(body.signature))
    return await _shown(signing, person, tx_id, language, 202)


async def _shown(signing: Signing, person: Person, tx_id: str, language: Language, status: int = 200) -> Response:
    row, to_sign = await signing.own_transaction(person, tx_id)
    content: dict[str, Any] = store.transaction_json(row, language, to_sign=to_sign)
    return Json(content, status, headers=NO_STORE)


def _bytes(text: str) -> bytes:
    try:
        return urlsafe_b64decode(text + "=" * (-len(text) % 4))
    except ValueError:
        raise BadRequest(
            said("signature_no_base64url"), ("body.signature", said("signature_no_base64url_field"))
        ) from None
