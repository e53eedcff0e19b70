"""Signing in by an OpenID provider: authorization code with PKCE, state and nonce (OpenID Connect Core 1.0).

The provider's description and keys are read at each sign-in: these are rare, and nothing can be stale.
"""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final
from urllib.parse import urlencode, urlsplit

import httpx
import orjson
from joserfc import jws
from joserfc.errors import JoseError
from joserfc.jwt import JWTClaimsRegistry

from wonderland.proofs.encoding import to_base64url
from wonderland_backend.auth.secret import new_secret
from wonderland_backend.http.transfer import TransferError, ask_object
from wonderland_backend.settings.oidc import OidcSettings
from wonderland_backend.tokens import ALGORITHMS, read_keys

LEEWAY_S: Final = 60
MAX_AGE_S: Final = 600
"""How long ago an ID token may have been issued: it was asked for just now."""
MAX_SUBJECT: Final = 255
"""Characters (OpenID Connect Core 1.0, 2)."""
MAX_DOCUMENT: Final = 256 * 1024
MAX_TOKEN: Final = 16 * 1024


class OidcError(Exception):
    """The provider could not be asked, or its answer is not to be believed; the text is for the server's log."""


@dataclass(frozen=True)
class Identity:
    """Whom the provider vouches for."""

    issuer: str
    subject: str
    email: str | None
    """In lower case; only when the provider has verified it."""
    name: str
    claims: dict[str, Any]


class Provider:
    """One OpenID provider."""

    def __init__(
        self,
        settings: OidcSettings,
        client: httpx.AsyncClient,
        *,
        clock: Callable[[], int],
        randomness: Callable[[int], bytes],
    ) -> None:
        self.settings = settings
        self._client = client
        self._clock = clock
        self._randomness = randomness

    async def ask(self, redirect_uri: str) -> tuple[str, dict[str, Any]]:
        """Where to send the browser, and what to keep until it is back. Raises `OidcError`."""
        metadata = await self._metadata()
        kept = {name: new_secret(self._randomness) for name in ("state", "nonce", "verifier")}
        question = {
            "response_type": "code",
            "client_id": self.settings.client_id,
            "redirect_uri": redirect_uri,
            "scope": self.settings.scopes,
            "state": kept["state"],
            "nonce": kept["nonce"],
            "code_challenge": to_base64url(hashlib.sha256(kept["verifier"].encode()).digest()),
            "code_challenge_method": "S256",
        }
        if self.settings.acr:
            question["acr_values"] = " ".join(self.settings.acr)
        endpoint = _address(metadata, "authorization_endpoint")
        return f"{endpoint}{'&' if urlsplit(endpoint).query else '?'}{urlencode(question)}", kept

    async def answer(self, kept: dict[str, Any], query: dict[str, str], redirect_uri: str) -> Identity:
        """Who came back. Raises `OidcError`."""
        if not hmac.compare_digest(query.get("state", "").encode(), str(kept["state"]).encode()):
            raise OidcError("the state is not that of this browser")
        if query.get("iss", self.settings.issuer) != self.settings.issuer:
            raise OidcError("another issuer answered (RFC 9207)")
        metadata = await self._metadata()
        form = {
            "grant_type": "authorization_code",
            "code": query.get("code", ""),
            "redirect_uri": redirect_uri,
            "code_verifier": kept["verifier"],
            "client_id": self.settings.client_id,
        }
        secret = self.settings.secret()
        auth = None
        if secret is not None:
            del form["client_id"]
            auth = httpx.BasicAuth(_form_encoded(self.settings.client_id), _form_encoded(secret))
        try:
            granted = await ask_object(
                self._client,
                "POST",
                _address(metadata, "token_endpoint"),
                data=form,
                auth=auth,
                max_bytes=MAX_DOCUMENT,
            )
            keys = read_keys(
                await ask_object(self._client, "GET", _address(metadata, "jwks_uri"), max_bytes=MAX_DOCUMENT)
            )
        except TransferError as error:
            raise OidcError(str(error)) from None
        claims = self._claims(granted.get("id_token"), keys)
        self._check(claims, str(kept["nonce"]))
        return self._identity(await self._more(claims, metadata, granted.get("access_token")))

    async def _metadata(self) -> dict[str, Any]:
        assert self.settings.issuer is not None
        url = f"{self.settings.issuer.rstrip('/')}/.well-known/openid-configuration"
        try:
            found = await ask_object(self._client, "GET", url, max_bytes=MAX_DOCUMENT)
        except TransferError as error:
            raise OidcError(str(error)) from None
        if found.get("issuer") != self.settings.issuer:
            raise OidcError("the provider describes itself as another issuer")
        return found

    @staticmethod
    def _claims(token: object, keys: Any) -> dict[str, Any]:
        if not isinstance(token, str) or len(token) > MAX_TOKEN:
            raise OidcError("the provider gave no ID token")
        try:
            signed = jws.deserialize_compact(token, keys, algorithms=list(ALGORITHMS))
            claims = orjson.loads(signed.payload)
        except (JoseError, ValueError, RecursionError) as error:
            raise OidcError(f"the ID token's signature is not the provider's ({type(error).__name__})") from None
        if not isinstance(claims, dict):
            raise OidcError("the ID token has no claims")
        return claims

    async def _more(self, claims: dict[str, Any], metadata: dict[str, Any], token: object) -> dict[str, Any]:
        """The claims that were asked for by scope: many providers tell them only where one asks with the token."""
        if "userinfo_endpoint" not in metadata or not isinstance(token, str):
            return claims
        headers = {"Authorization": f"Bearer {token}"}
        try:
            told = await ask_object(
                self._client, "GET", _address(metadata, "userinfo_endpoint"), headers=headers, max_bytes=MAX_DOCUMENT
            )
        except (TransferError, OidcError) as error:
            raise OidcError(f"the provider's claims: {error}") from None
        if told.get("sub") != claims["sub"]:
            raise OidcError("the provider's claims are about somebody else")
        return {**told, **claims}

    def _check(self, claims: dict[str, Any], nonce: str) -> None:
        """OpenID Connect Core 1.0, 3.1.3.7."""
        settings, now_s = self.settings, self._clock() // 1000
        assert settings.issuer is not None
        wanted = JWTClaimsRegistry(
            now_s,
            LEEWAY_S,
            iss={"essential": True, "value": settings.issuer},
            aud={"essential": True, "value": settings.client_id},
            azp={"value": settings.client_id},
            exp={"essential": True},
            iat={"essential": True},
            nonce={"essential": True, "value": nonce},
            sub={"essential": True},
        )
        try:
            wanted.validate(claims)
        except JoseError as error:
            raise OidcError(f"the ID token is not for this sign-in: {error.description or error}") from None
        if settings.acr and claims.get("acr") not in settings.acr:
            raise OidcError("the ID token does not say that somebody signed in as strongly as is asked for (acr)")
        if claims["iat"] < now_s - MAX_AGE_S:
            raise OidcError("the ID token is not for this sign-in: its iat is long ago")
        if len(claims["sub"]) > MAX_SUBJECT:
            raise OidcError("the ID token is not for this sign-in: its sub is too long")

    def _identity(self, claims: dict[str, Any]) -> Identity:
        email = claims.get("email")
        verified = isinstance(email, str) and claims.get("email_verified") is True and len(email) <= 254
        name = claims.get("name")
        return Identity(
            issuer=str(self.settings.issuer),
            subject=str(claims["sub"]),
            email=email.lower() if verified and isinstance(email, str) else None,
            name=name[:100] if isinstance(name, str) else "",
            claims=claims,
        )


def _address(metadata: dict[str, Any], name: str) -> str:
    value = metadata.get(name)
    if not isinstance(value, str):
        raise OidcError(f"the provider does not say its {name}")
    parts = urlsplit(value)
    if parts.scheme != "https" and not (parts.scheme == "http" and parts.hostname in {"localhost", "127.0.0.1"}):
        raise OidcError(f"the provider's {name} is not https")
    return value


def _form_encoded(text: str) -> str:
    """RFC 6749, 2.3.1: both parts are form-encoded before HTTP's own encoding."""
    return urlencode({"": text})[1:]
