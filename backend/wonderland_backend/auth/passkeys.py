"""Passkeys (WebAuthn, discoverable credentials, the user always verified): asked for, checked, kept."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final

import orjson
from sqlalchemy.ext.asyncio import AsyncConnection
from webauthn import (
    generate_authentication_options,
    generate_registration_options,
    options_to_json,
    verify_authentication_response,
    verify_registration_response,
)
from webauthn.helpers import base64url_to_bytes, bytes_to_base64url
from webauthn.helpers.exceptions import WebAuthnException
from webauthn.helpers.structs import (
    AuthenticatorSelectionCriteria,
    PublicKeyCredentialDescriptor,
    ResidentKeyRequirement,
    UserVerificationRequirement,
)

from wonderland.problems import Said, said
from wonderland_backend.auth.site import site_of
from wonderland_backend.auth.store import ceremonies
from wonderland_backend.auth.store import passkeys as store
from wonderland_backend.context import Context
from wonderland_backend.errors import BadRequest, Conflict, SignInRequired

REGISTER: Final = "register"
SIGN_IN: Final = "passkey"
MAX_PASSKEYS: Final = 20
MAX_CREDENTIAL: Final = 1_400
_UNKNOWN: Final = said("passkey_unknown")


async def ask_for_new(
    context: Context,
    connection: AsyncConnection,
    person_id: str,
    name: str,
    *,
    more: Mapping[str, Any] = MappingProxyType({}),
) -> dict[str, Any]:
    """What to hand to ``navigator.credentials.create``, and the ceremony to name with its answer.

    `more` is kept besides: what came with a link, which ends all earlier passkeys. Raises `Conflict` for somebody who
    has `MAX_PASSKEYS`.
    """
    known = await store.ids_of(connection, person_id)
    excluded = [] if more else [PublicKeyCredentialDescriptor(id=base64url_to_bytes(each)) for each in known]
    if len(excluded) >= MAX_PASSKEYS:
        raise Conflict(said("too_many_passkeys", most=MAX_PASSKEYS))
    challenge = context.randomness(32)
    options = generate_registration_options(
        rp_id=site_of(context.settings, "").rp_id,
        rp_name="Wonderland",
        user_id=bytes.fromhex(person_id),
        user_name=name,
        user_display_name=name,
        challenge=challenge,
        exclude_credentials=excluded,
        authenticator_selection=AuthenticatorSelectionCriteria(
            resident_key=ResidentKeyRequirement.REQUIRED, user_verification=UserVerificationRequirement.REQUIRED
        ),
    )
    content = {"challenge": bytes_to_base64url(challenge), "person_id": person_id, **more}
    ceremony = await ceremonies.begin(
        connection, REGISTER, content, now_ms=context.clock(), randomness=context.randomness
    )
    return {"ceremony": ceremony, "options": orjson.loads(options_to_json(options))}


async def asked_for(context: Context, kind: str, ceremony: str) -> dict[str, Any]:
    """What was asked, once: it is over even when the answer turns out to be none. Raises `CeremonyOver`."""
    async with context.database.write() as connection:
        found = await ceremonies.finish(connection, kind, ceremony, context.clock())
    if found is None:
        raise ceremonies.CeremonyOver(said("ceremony_over"))
    return found


async def keep(
    context: Context,
    connection: AsyncConnection,
    asked: dict[str, Any],
    credential: dict[str, Any],
    *,
    name: str,
    host: str,
) -> None:
    """Check a new credential against what was asked, and keep it. Raises `BadRequest`, `Conflict`."""
    site = site_of(context.settings, host)
    try:
        made = verify_registration_response(
            credential=credential,
            expected_challenge=base64url_to_bytes(asked["challenge"]),
            expected_rp_id=site.rp_id,
            expected_origin=site.origin,
            require_user_verification=True,
        )
    except (WebAuthnException, ValueError, KeyError, TypeError, AttributeError) as cause:
        raise BadRequest(said("passkey_malformed", why=_why(cause))) from None
    credential_id = bytes_to_base64url(made.credential_id)
    if len(credential_id) > MAX_CREDENTIAL:
        raise BadRequest(said("passkey_id_too_long"))
    if await store.is_known(connection, credential_id):
        raise Conflict(said("passkey_known"))
    row = {
        "credential_id": credential_id,
        "person_id": asked["person_id"],
        "public_key": bytes_to_base64url(made.credential_public_key),
        "sign_count": made.sign_count,
        "transports": " ".join(_transports(credential)),
        "name": name,
        "created_ms": context.clock(),
        "last_used_ms": None,
    }
    await store.add(connection, row)


async def ask_to_sign_in(
    context: Context,
    connection: AsyncConnection,
    *,
    kind: str = SIGN_IN,
    challenge: bytes | None = None,
    allowed: Sequence[str] = (),
    more: Mapping[str, Any] = MappingProxyType({}),
) -> dict[str, Any]:
    """What to hand to ``navigator.credentials.get``; the authenticator knows whom it can sign in.

    `allowed`: the credentials of who is known already. `more` is kept besides the challenge.
    """
    challenge = challenge or context.randomness(32)
    options = generate_authentication_options(
        rp_id=site_of(context.settings, "").rp_id,
        challenge=challenge,
        allow_credentials=[PublicKeyCredentialDescriptor(id=base64url_to_bytes(each)) for each in allowed] or None,
        user_verification=UserVerificationRequirement.REQUIRED,
    )
    ceremony = await ceremonies.begin(
        connection,
        kind,
        {"challenge": bytes_to_base64url(challenge), **more},
        now_ms=context.clock(),
        randomness=context.randomness,
    )
    return {"ceremony": ceremony, "options": orjson.loads(options_to_json(options))}


async def verify(
    context: Context, connection: AsyncConnection, asked: dict[str, Any], credential: dict[str, Any], *, host: str
) -> str:
    """Whose passkey signed. Raises `SignInRequired`."""
    row = await _known(connection, credential)
    site = site_of(context.settings, host)
    try:
        signed = verify_authentication_response(
            credential=credential,
            expected_challenge=base64url_to_bytes(asked["challenge"]),
            expected_rp_id=site.rp_id,
            expected_origin=site.origin,
            credential_public_key=base64url_to_bytes(row.public_key),
            credential_current_sign_count=row.sign_count,
            require_user_verification=True,
        )
    except (WebAuthnException, ValueError, KeyError, TypeError, AttributeError) as cause:
        raise SignInRequired(said("passkey_refused", why=_why(cause))) from None
    await store.note_use(connection, row.credential_id, signed.new_sign_count, context.clock())
    return str(row.person_id)


async def _known(connection: AsyncConnection, credential: dict[str, Any]) -> Any:
    credential_id = credential.get("id")
    if not isinstance(credential_id, str) or len(credential_id) > MAX_CREDENTIAL or "\x00" in credential_id:
        raise SignInRequired(_UNKNOWN)
    row = await store.of_active_person(connection, credential_id)
    handle = _field(credential, "response", "userHandle")
    # A discoverable credential says whose it is; a wrong answer is a mix-up, or worse.
    if row is None or (handle is not None and handle != bytes_to_base64url(bytes.fromhex(row.person_id))):
        raise SignInRequired(_UNKNOWN)
    return row


def _transports(credential: dict[str, Any]) -> list[str]:
    told = _field(credential, "response", "transports")
    named = told if isinstance(told, list) else []
    return [each for each in named if isinstance(each, str) and each.isalpha() and len(each) < 20][:8]


def _field(document: Any, *path: str) -> Any:
    for name in path:
        document = document.get(name) if isinstance(document, dict) else None
    return document


def _why(cause: Exception) -> str | Said:
    return str(cause).rstrip(".")[:200] if isinstance(cause, WebAuthnException) else said("malformed")
