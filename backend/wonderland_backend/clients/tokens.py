"""Access tokens issued for client credentials (RFC 6749, 4.4; RFC 9068)."""

from __future__ import annotations

import binascii
from base64 import b64decode
from collections.abc import Callable, Mapping
from datetime import datetime
from typing import Any, Final
from urllib.parse import unquote_plus

import orjson
from joserfc import jwt
from joserfc.errors import JoseError
from joserfc.jwk import KeySet

from wonderland.problems import Said, SaidError, said
from wonderland_backend.clients import store
from wonderland_backend.clients.certificates import ShownCertificate
from wonderland_backend.clients.keys import ALGORITHM, TokenKeys
from wonderland_backend.clients.store import Clients
from wonderland_backend.db.tables.clients import ClientRow
from wonderland_backend.errors import BackendError
from wonderland_backend.tokens import THUMBPRINT

TTL_S: Final = 3600
"""ASTM F3411 allows no longer life."""
ASSERTION_ALGORITHMS: Final = ["ES256", "RS256", "PS256"]
ASSERTION_TYPE: Final = "urn:ietf:params:oauth:client-assertion-type:jwt-bearer"
ASSERTION_TTL_S: Final = 300
LEEWAY_S: Final = 30
MAX_TOKEN: Final = 8192


class TokenDenied(SaidError, BackendError):  # noqa: N818 - an answer of the protocol
    """An error of RFC 6749, 5.2: ``code`` for machines, the text for people."""

    def __init__(self, code: str, said: Said) -> None:
        super().__init__(said)
        self.code = code


class Tokens:
    """Issues tokens. `issuer` is this server's name in them, `audience` whom they are for."""

    def __init__(
        self,
        keys: TokenKeys,
        clients: Clients,
        *,
        issuer: str,
        audience: str,
        clock: Callable[[], int],
        randomness: Callable[[int], bytes],
    ) -> None:
        self.keys = keys
        self.issuer = issuer
        self.audience = audience
        self._clients = clients
        self._clock = clock
        self._randomness = randomness

    async def issue(
        self, form: Mapping[str, str], authorization: str | None, shown: ShownCertificate | None
    ) -> dict[str, Any]:
        """The answer to a token request over a connection with this certificate. Raises `TokenDenied`."""
        if form.get("grant_type") != "client_credentials":
            raise TokenDenied("unsupported_grant_type", said("oauth_grant"))
        audience = form.get("audience") or form.get("resource")
        if audience is not None and audience not in {self.issuer, self.audience}:
            raise TokenDenied("invalid_target", said("oauth_audience", audience=self.audience))
        client = await self._authenticated(form, authorization, shown)
        allowed = client.scopes.split()
        wanted = form.get("scope", "").split() or allowed
        beyond = [scope for scope in wanted if scope not in allowed]
        if beyond:
            raise TokenDenied("invalid_scope", said("oauth_scope", scopes=" ".join(beyond)[:200]))
        now_s = self._clock() // 1000
        scope = " ".join(dict.fromkeys(wanted))
        claims = {
            "iss": self.issuer,
            "sub": client.client_id,
            "client_id": client.client_id,
            "aud": self.audience,
            "iat": now_s,
            "exp": now_s + TTL_S,
            "jti": self._randomness(16).hex(),
            "scope": scope,
        }
        if shown is not None:
            # Stolen, it is worth nothing to whoever does not have the certificate's key (RFC 8705, 3).
            claims["cnf"] = {THUMBPRINT: shown.thumbprint}
        key = self.keys.signing
        header = {"alg": ALGORITHM, "typ": "at+jwt", "kid": key.kid}
        token = jwt.encode(header, claims, key, algorithms=[ALGORITHM])
        await self._clients.used(client)
        return {"access_token": token, "token_type": "Bearer", "expires_in": TTL_S, "scope": scope}

    async def _authenticated(
        self, form: Mapping[str, str], authorization: str | None, shown: ShownCertificate | None
    ) -> ClientRow:
        if "client_assertion" in form:
            return await self._by_assertion(form)
        if authorization is None and "client_id" in form:
            return await self._by_certificate(form["client_id"], shown)
        client_id, secret = _basic(authorization)
        client = await self._clients.find_client(client_id)
        # The same work for a client that is not there: its absence shows in no time.
        fits = store.is_secret_of(client or _NOBODY, secret)
        if client is None or client.revoked_ms is not None or not fits:
            raise TokenDenied("invalid_client", said("oauth_secret"))
        return client

    async def _by_certificate(self, client_id: str, shown: ShownCertificate | None) -> ClientRow:
        if shown is None:
            raise TokenDenied("invalid_client", said("oauth_no_certificate"))
        client = await self._clients.find_client(client_id[:64])
        if client is None or client.revoked_ms is not None or not store.is_certificate_of(client, shown):
            raise TokenDenied("invalid_client", said("oauth_certificate"))
        now_ms = self._clock()
        if not _at(shown.certificate.not_valid_before_utc) <= now_ms <= _at(shown.certificate.not_valid_after_utc):
            raise TokenDenied("invalid_client", said("oauth_certificate_time"))
        return client

    async def _by_assertion(self, form: Mapping[str, str]) -> ClientRow:
        if form.get("client_assertion_type") != ASSERTION_TYPE:
            raise TokenDenied("invalid_request", said("oauth_assertion_type", type=ASSERTION_TYPE))
        assertion = form["client_assertion"]
        client_id = str(_unverified(assertion, 1).get("sub", ""))[:64]
        client = await self._clients.find_client(client_id)
        if client is None or client.revoked_ms is not None or client.jwks is None or len(assertion) > MAX_TOKEN:
            raise TokenDenied("invalid_client", said("oauth_no_key"))
        now_s = self._clock() // 1000
        try:
            keys = KeySet.import_key_set(orjson.loads(client.jwks))
            decoded = jwt.decode(assertion, keys, algorithms=ASSERTION_ALGORITHMS)
            jwt.JWTClaimsRegistry(
                now=now_s,
                leeway=LEEWAY_S,
                iss={"essential": True, "value": client_id},
                sub={"essential": True, "value": client_id},
                aud={"essential": True, "values": [self.issuer, f"{self.issuer}/oauth/token"]},
                exp={"essential": True},
                jti={"essential": True},
            ).validate(decoded.claims)
        except (JoseError, ValueError) as cause:
            raise TokenDenied("invalid_client", said("oauth_assertion", why=_words(cause))) from None
        expires_s, jti = int(decoded.claims["exp"]), str(decoded.claims["jti"])
        if expires_s > now_s + ASSERTION_TTL_S + LEEWAY_S:
            raise TokenDenied("invalid_client", said("oauth_assertion_long", most=ASSERTION_TTL_S))
        if not await self._clients.spend(client_id, jti, (expires_s + LEEWAY_S) * 1000):
            raise TokenDenied("invalid_client", said("oauth_assertion_used"))
        return client


_NOBODY: Final = ClientRow(secret_sha256="0" * 64)


def _basic(authorization: str | None) -> tuple[str, str]:
    """The two parts of HTTP Basic, each form-encoded as RFC 6749, 2.3.1 asks. Raises `TokenDenied`."""
    scheme, _, text = (authorization or "").partition(" ")
    try:
        decoded = b64decode(text, validate=True).decode()
    except (binascii.Error, ValueError):
        decoded = ""
    client_id, separator, secret = decoded.partition(":")
    if scheme.lower() != "basic" or not separator or len(decoded) > 512:
        raise TokenDenied("invalid_client", said("oauth_how"))
    return unquote_plus(client_id), unquote_plus(secret)


def _at(time: datetime) -> int:
    return int(time.timestamp() * 1000)


def _unverified(token: str, part: int) -> Mapping[str, Any]:
    """A part of a JWT before anything is checked: only to find out whose keys would check it."""
    parts = token.split(".")
    if len(token) > MAX_TOKEN or len(parts) != 3:
        return {}
    try:
        found = orjson.loads(b64decode(parts[part] + "=" * (-len(parts[part]) % 4), altchars=b"-_"))
    except (binascii.Error, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _words(cause: Exception) -> str:
    return str(cause).strip() or type(cause).__name__
