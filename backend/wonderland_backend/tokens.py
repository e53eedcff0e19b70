"""Access tokens of other systems (JWT): RS256 or ES256 only, our audience, at most an hour, by configured issuers.

Keys come from each issuer's JWKS and are kept through its outages; a key that is not known is looked for, but not more
often than `REFETCH_S`, whoever asks.
"""

from __future__ import annotations

import asyncio
import hmac
import logging
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from http import HTTPStatus
from pathlib import Path
from typing import Any, Final, Self

import httpx
import orjson
from joserfc import jws
from joserfc.errors import InvalidKeyIdError, JoseError
from joserfc.jwk import ECKey, Key, KeySet, RSAKey
from pydantic import BaseModel, ConfigDict, Field, model_validator

from wonderland.problems import Said, said
from wonderland_backend.errors import Problem
from wonderland_backend.http.addresses import ADDRESS
from wonderland_backend.http.transfer import TransferError, ask_object, parse_object

logger = logging.getLogger(__name__)

ALGORITHMS: Final = ("RS256", "ES256")
TYPES: Final = (None, "jwt", "at+jwt", "application/at+jwt")
"""Of access tokens (RFC 9068, and those from before it); what is something else says so, as ``logout+jwt``."""
MAX_TOKEN: Final = 8_192
MAX_LIFETIME_S: Final = 3_600
MAX_SUBJECT: Final = 256
REFRESH_S: Final = 15 * 60
"""Keys older than this are fetched anew; those that are there stay good until that succeeds."""
KEEP_S: Final = 24 * 3_600
"""So long an issuer's keys outlast its outage: a key that was withdrawn meanwhile must not be good for ever."""
REFETCH_S: Final = 30
MAX_JWKS: Final = 256 * 1024
MAX_KEYS: Final = 64
MIN_RSA_BITS: Final = 2_048
THUMBPRINT: Final = "x5t#S256"


class IssuerSettings(BaseModel):
    """An authorisation server whose tokens are believed."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    issuer: str = Field(min_length=1, max_length=300, description="Its tokens' `iss`, exactly")
    jwks_url: str | None = Field(default=None, pattern=f"^{ADDRESS}$", description="Where it publishes its keys")
    keys_file: Path | None = Field(default=None, description="Its keys in a file instead: JWKS, or one key in PEM")

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        if (self.jwks_url is None) == (self.keys_file is None):
            raise ValueError("give jwks_url or keys_file, one of the two")
        return self


class TokenRefused(Problem):
    """There is no token, or it is not one to believe."""

    status, code = HTTPStatus.UNAUTHORIZED, "invalid-token"
    example = said("token_expired")

    def __init__(self, said: Said, *, described: bool = True) -> None:
        challenge = 'Bearer realm="wonderland"'
        if described:
            challenge += f', error="invalid_token", error_description="{_quoted(str(said))}"'
        super().__init__(said, headers={"WWW-Authenticate": challenge})


class ScopeMissing(Problem):
    """The token is good, but not for this."""

    status, code = HTTPStatus.FORBIDDEN, "insufficient-scope"
    example = said("scope_missing", scopes="rid.display_provider")

    def __init__(self, wanted: Iterable[str]) -> None:
        names = " ".join(sorted(wanted))
        challenge = f'Bearer realm="wonderland", error="insufficient_scope", scope="{_quoted(names)}"'
        super().__init__(said("scope_missing", scopes=names), headers={"WWW-Authenticate": challenge})


@dataclass(frozen=True)
class Caller:
    """Another system, as its token says."""

    subject: str
    issuer: str
    scopes: frozenset[str]
    expires_s: int
    claims: Mapping[str, Any] = field(repr=False)

    def require(self, *scopes: str) -> None:
        """Refuse a caller that has none of these scopes. Raises `ScopeMissing`."""
        if self.scopes.isdisjoint(scopes):
            raise ScopeMissing(scopes)


class TokenVerifier:
    """Says who a bearer token is from."""

    def __init__(
        self,
        issuers: Iterable[IssuerSettings],
        audiences: Iterable[str],
        *,
        clock: Callable[[], int],
        client: httpx.AsyncClient,
        leeway_s: int = 10,
    ) -> None:
        """`clock` gives milliseconds since the Unix epoch. Raises `TransferError` for a keys file that is none."""
        self._keys = {each.issuer: _keys_of(each, client, clock) for each in issuers}
        self._audiences = frozenset(audiences)
        self._clock = clock
        self._leeway_s = leeway_s

    def trust(self, issuer: str, keys: KeySet) -> None:
        """Believe an issuer whose keys are at hand, for example this server itself."""
        self._keys[issuer] = _Held(keys)

    async def verify(self, authorization: str | None, thumbprint: str | None) -> Caller:
        """Who sent a request, by its ``Authorization`` header and its certificate's `thumbprint`, if it has one.

        Raises `TokenRefused`.
        """
        token = _bearer(authorization)
        header, claims = _unverified(token)
        issuer = claims.get("iss")
        keys = self._keys.get(issuer) if isinstance(issuer, str) else None
        if keys is None:
            raise TokenRefused(said("token_issuer"))
        await self._check_signature(token, header, keys)
        caller = self._caller(claims)
        _check_confirmation(claims, thumbprint)
        return caller

    async def _check_signature(self, token: str, header: Mapping[str, Any], keys: _Keys) -> None:
        key = await keys.find_key(header.get("kid"))
        try:
            jws.deserialize_compact(token, key, algorithms=ALGORITHMS)
        except (JoseError, ValueError, RecursionError):
            raise TokenRefused(said("token_signature")) from None

    def _caller(self, claims: Mapping[str, Any]) -> Caller:
        now_s = self._clock() // 1000
        expires = _time(claims, "exp")
        if expires is None:
            raise TokenRefused(said("token_without_expiry"))
        if expires + self._leeway_s <= now_s:
            raise TokenRefused(said("token_expired"))
        if expires > now_s + MAX_LIFETIME_S + self._leeway_s:
            raise TokenRefused(said("token_too_long"))
        for name in ("nbf", "iat"):
            begins = _time(claims, name)
            if begins is not None and begins > now_s + self._leeway_s:
                raise TokenRefused(said("token_of_future", claim=name))
        audience = claims.get("aud")
        named = {audience} if isinstance(audience, str) else _texts(audience)
        if not named & self._audiences:
            raise TokenRefused(said("token_audience"))
        subject = claims.get("sub")
        if not isinstance(subject, str) or not 0 < len(subject) <= MAX_SUBJECT:
            raise TokenRefused(said("token_without_subject"))
        scope = claims.get("scope", "")
        if not isinstance(scope, str):
            raise TokenRefused(said("token_scope_no_text"))
        return Caller(subject, str(claims["iss"]), frozenset(scope.split()), expires, claims)


class _Held:
    """Keys that are at hand."""

    def __init__(self, keys: KeySet) -> None:
        self._keys = keys

    async def find_key(self, kid: object) -> Key:
        """The key of this name; the only one there is, where a token names none. Raises `TokenRefused`."""
        key = _find(self._keys, kid)
        if key is None:
            raise TokenRefused(said("token_key_of_nobody"))
        return key


class _Published:
    """Keys that an issuer publishes."""

    def __init__(self, url: str, client: httpx.AsyncClient, clock: Callable[[], int]) -> None:
        self._url = url
        self._client = client
        self._clock = clock
        self._keys = KeySet([])
        self._fetched_s: float | None = None
        self._tried_s: float | None = None
        self._fetching = asyncio.Lock()

    async def find_key(self, kid: object) -> Key:
        """As `_Held.find`; an unknown key is looked for at the issuer. Raises `TokenRefused`."""
        if self._age_s() > REFRESH_S:
            await self._fetch(self._fetched_s)
        key = self._known(kid)
        if key is None:
            await self._fetch(self._fetched_s)
            key = self._known(kid)
        if key is not None:
            return key
        if self._tried_s != self._fetched_s:
            raise TokenRefused(said("token_key_unknown"))
        raise TokenRefused(said("token_key_of_nobody"))

    def _known(self, kid: object) -> Key | None:
        return _find(self._keys, kid) if self._age_s() <= KEEP_S else None

    def _age_s(self) -> float:
        return float("inf") if self._fetched_s is None else self._clock() / 1000 - self._fetched_s

    async def _fetch(self, seen_s: float | None) -> None:
        """Once for all who wait, and not too often: tokens with made-up keys must not become requests."""
        async with self._fetching:
            now_s = self._clock() / 1000
            if self._fetched_s != seen_s or (self._tried_s is not None and now_s - self._tried_s < REFETCH_S):
                return
            self._tried_s = now_s
            try:
                self._keys = read_keys(await ask_object(self._client, "GET", self._url, max_bytes=MAX_JWKS))
            except TransferError as error:
                logger.warning("keys of a token issuer could not be fetched: %s", error)
            else:
                self._fetched_s = now_s


_Keys = _Held | _Published


def read_keys(document: Mapping[str, Any]) -> KeySet:
    """The public keys of a JWKS that may sign tokens; others are left out. Raises `TransferError` for no JWKS."""
    entries = document.get("keys")
    if not isinstance(entries, list) or len(entries) > MAX_KEYS:
        raise TransferError(f"no JWKS: `keys` is a list of at most {MAX_KEYS} keys")
    return KeySet([key for entry in entries if isinstance(entry, dict) and (key := _read_key(entry)) is not None])


def _read_key(entry: dict[str, Any]) -> Key | None:
    """A key that may sign tokens, its private part left out."""
    if entry.get("use", "sig") != "sig":
        return None
    try:
        if entry.get("kty") == "EC" and entry.get("crv") == "P-256":
            return ECKey.import_key({name: entry[name] for name in ("kty", "crv", "x", "y", "kid") if name in entry})
        if entry.get("kty") == "RSA":
            key = RSAKey.import_key({name: entry[name] for name in ("kty", "n", "e", "kid") if name in entry})
            return key if key.raw_value.key_size >= MIN_RSA_BITS else None
    except (JoseError, ValueError, TypeError, KeyError):
        return None
    return None


def _keys_of(issuer: IssuerSettings, client: httpx.AsyncClient, clock: Callable[[], int]) -> _Keys:
    if issuer.jwks_url is not None:
        return _Published(issuer.jwks_url, client, clock)
    assert issuer.keys_file is not None
    return _Held(_read_file(issuer.keys_file))


def _read_file(path: Path) -> KeySet:
    try:
        text = path.read_bytes()
    except OSError as error:
        raise TransferError(f"{path}: {error.strerror}") from None
    if not text.lstrip().startswith(b"-----"):
        return read_keys(parse_object(text, str(path)))
    for kind in (RSAKey, ECKey):
        try:
            key = kind.import_key(text)
        except (JoseError, ValueError, TypeError):
            continue
        return read_keys({"keys": [key.as_dict(private=False)]})
    raise TransferError(f"{path}: neither JWKS nor an RSA or P-256 key in PEM")


def _find(keys: KeySet, kid: object) -> Key | None:
    if kid is not None and not isinstance(kid, str):
        return None
    try:
        return keys.get_by_kid(kid)
    except InvalidKeyIdError:
        return None


def _check_confirmation(claims: Mapping[str, Any], thumbprint: str | None) -> None:
    """A token that is bound to a certificate is good with that one only (RFC 8705, 3). Raises `TokenRefused`."""
    if "cnf" not in claims:
        return
    bound = claims["cnf"]
    if not isinstance(bound, dict) or set(bound) != {THUMBPRINT} or not isinstance(bound[THUMBPRINT], str):
        raise TokenRefused(said("token_key_binding"))
    if thumbprint is None:
        raise TokenRefused(said("token_without_certificate"))
    if not hmac.compare_digest(bound[THUMBPRINT].encode(), thumbprint.encode()):
        raise TokenRefused(said("token_other_certificate"))


def _bearer(authorization: str | None) -> str:
    if authorization is None:
        raise TokenRefused(said("bearer_token_needed"), described=False)
    scheme, _, token = authorization.partition(" ")
    if scheme.lower() != "bearer":
        raise TokenRefused(said("no_bearer_token"), described=False)
    token = token.strip()
    if not token or len(token) > MAX_TOKEN or not token.isascii():
        raise TokenRefused(said("no_jwt"))
    return token


def _unverified(token: str) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
    """Header and claims of a token before anything is believed: to learn which issuer to ask."""
    try:
        parsed = jws.extract_compact(token.encode())
        claims = orjson.loads(parsed.payload)
        header = parsed.headers()
    except (JoseError, ValueError, RecursionError):
        raise TokenRefused(said("no_jwt")) from None
    if not isinstance(claims, dict) or not isinstance(header, dict):
        raise TokenRefused(said("no_jwt"))
    if header.get("alg") not in ALGORITHMS:
        raise TokenRefused(said("token_algorithm"))
    kind = header.get("typ")
    if (kind.lower() if isinstance(kind, str) else kind) not in TYPES:
        raise TokenRefused(said("token_type"))
    return header, claims


def _time(claims: Mapping[str, Any], name: str) -> int | None:
    value = claims.get(name)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < 2**53:
        raise TokenRefused(said("token_no_time", claim=name))
    return int(value)


def _texts(value: object) -> set[str]:
    return {each for each in value if isinstance(each, str)} if isinstance(value, list) else set()


def _quoted(text: str) -> str:
    """A text for a quoted string of a header: ours, so only what would end it is taken out."""
    return text.replace("\\", "").replace('"', "").replace("’", "'").encode("ascii", "replace").decode()
