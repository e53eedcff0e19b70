"""Tokens of other systems, as they come and as they should not; and ours."""

from __future__ import annotations

import base64
import hmac
import json
import time

import httpx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wonderland_backend.http.transfer import TransferError
from wonderland_backend.settings.uspace import USpaceSettings
from wonderland_backend.tokens import REFETCH_S, REFRESH_S, IssuerSettings, ScopeMissing, TokenRefused, TokenVerifier
from wonderland_backend.uspace.token_client import NoToken, TokenClient


def now_ms():
    return time.time_ns() // 1_000_000


@pytest.fixture
async def http():
    async with httpx.AsyncClient(trust_env=False) as client:
        yield client


@pytest.fixture
def new_verifier(authority, http):
    def make(clock=now_ms, **issuer):
        issuer = issuer or {"jwks_url": f"{authority.url}/jwks"}
        settings = IssuerSettings(issuer=authority.url, **issuer)
        return TokenVerifier([settings], ["127.0.0.1"], clock=clock, client=http)

    return make


def bearer(token):
    return f"Bearer {token}"


@pytest.mark.parametrize("key", ["first", "elliptic"])
async def test_a_good_token_says_who_it_is(authority, new_verifier, key):
    caller = await new_verifier().verify(bearer(authority.token(key=key, scope="rid.display_provider other")), None)
    assert (caller.subject, caller.issuer) == ("other-uss", authority.url)
    assert caller.scopes == {"rid.display_provider", "other"}
    caller.require("rid.display_provider", "another")
    with pytest.raises(ScopeMissing) as refused:
        caller.require("rid.service_provider")
    assert 'error="insufficient_scope", scope="rid.service_provider"' in refused.value.headers["WWW-Authenticate"]


@pytest.mark.parametrize("kind", ["JWT", "at+jwt", "application/at+jwt"])
async def test_a_token_may_say_that_it_is_one(authority, new_verifier, kind):
    assert await new_verifier().verify(bearer(authority.token(header={"kid": "first", "typ": kind})), None)


async def test_an_audience_may_be_one_of_several(authority, new_verifier):
    assert await new_verifier().verify(bearer(authority.token(aud=["elsewhere", "127.0.0.1"])), None)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"exp": int(time.time()) - 60}, "expired"),
        ({"without": ("exp",)}, "does not say when it expires"),
        ({"exp": int(time.time()) + 86_400}, "longer than an hour"),
        ({"exp": "soon"}, "exp is no time"),
        ({"exp": True}, "exp is no time"),
        ({"nbf": int(time.time()) + 86_400}, "of the future"),
        ({"iat": int(time.time()) + 86_400}, "of the future"),
        ({"iss": "https://elsewhere.example"}, "issuer"),
        ({"without": ("iss",)}, "issuer"),
        ({"iss": ["a"]}, "issuer"),
        ({"aud": "elsewhere.example"}, "somebody else"),
        ({"without": ("aud",)}, "somebody else"),
        ({"aud": {"127.0.0.1": 1}}, "somebody else"),
        ({"without": ("sub",)}, "whose it is"),
        ({"sub": ""}, "whose it is"),
        ({"scope": ["rid.display_provider"]}, "scope is not a text"),
        ({"key": "second"}, "none of its issuer’s"),
        ({"key": "stranger"}, "signature"),
        ({"header": {"kid": "x"}}, "none of its issuer’s"),
        ({"header": {"kid": None}}, "none of its issuer’s"),
        ({"header": {"typ": "logout+jwt"}}, "no access token"),
    ],
)
async def test_a_token_that_must_not_be_believed(authority, new_verifier, change, words):
    with pytest.raises(TokenRefused, match=words) as refused:
        await new_verifier().verify(bearer(authority.token(**change)), None)
    assert 'error="invalid_token"' in refused.value.headers["WWW-Authenticate"]


def by_hand(header, claims, secret=None):
    """A JWT that no library would make."""
    parts = (base64.urlsafe_b64encode(json.dumps(each).encode()).rstrip(b"=").decode() for each in (header, claims))
    text = ".".join(parts)
    mac = hmac.digest(secret, text.encode(), "sha256") if secret is not None else b""
    return f"{text}.{base64.urlsafe_b64encode(mac).rstrip(b'=').decode()}"


@pytest.mark.parametrize(
    ("bound", "shown", "words"),
    [
        ({"x5t#S256": "A" * 43}, None, "shows none"),
        ({"x5t#S256": "A" * 43}, "B" * 43, "another certificate"),
        ({"x5t#S256": 7}, "A" * 43, "not known here"),
        ({"jkt": "A" * 43}, "A" * 43, "not known here"),
        ({"x5t#S256": "A" * 43, "jkt": "B" * 43}, "A" * 43, "not known here"),
        ({}, "A" * 43, "not known here"),
        (None, "A" * 43, "not known here"),
        ("x5t#S256", "A" * 43, "not known here"),
    ],
)
async def test_a_bound_token_is_good_with_its_certificate_only(authority, new_verifier, bound, shown, words):
    verifier = new_verifier()
    good = bearer(authority.token(cnf={"x5t#S256": "A" * 43}))
    assert (await verifier.verify(good, "A" * 43)).subject == "other-uss"
    with pytest.raises(TokenRefused, match=words):
        await verifier.verify(bearer(authority.token(cnf=bound)), shown)


async def test_algorithm_none_and_hs256_with_the_public_key(authority, new_verifier, keys):
    claims = {"iss": authority.url, "sub": "a", "aud": "127.0.0.1", "exp": int(time.time()) + 60}
    with pytest.raises(TokenRefused, match="RS256 or ES256"):
        await new_verifier().verify(bearer(by_hand({"alg": "none"}, claims)), None)
    forged = by_hand({"alg": "HS256", "kid": "first"}, claims, keys["first"].as_pem(private=False))
    with pytest.raises(TokenRefused, match="RS256 or ES256"):
        await new_verifier().verify(bearer(forged), None)


@pytest.mark.parametrize(
    "text", [None, "", "Basic YTpi", "Bearer", "Bearer a.b", "Bearer a.b.c", "Bearer " + "x" * 9000]
)
async def test_what_is_no_token(new_verifier, text):
    with pytest.raises(TokenRefused):
        await new_verifier().verify(text, None)


async def test_json_that_is_nested_without_end(authority, new_verifier):
    deep = base64.urlsafe_b64encode(b"[" * 3_000).rstrip(b"=").decode()
    head = base64.urlsafe_b64encode(json.dumps({"alg": "RS256"}).encode()).rstrip(b"=").decode()
    for token in (f"{deep}.{deep}.x", f"{head}.{deep}.x"):
        with pytest.raises(TokenRefused):
            await new_verifier().verify(bearer(token), None)


@given(st.text(max_size=200))
async def test_any_text_is_refused_in_words(text):
    verifier = TokenVerifier([], [], clock=now_ms, client=None)
    for authorization in (text, f"Bearer {text}", f"Bearer a.{text}.b"):
        with pytest.raises(TokenRefused) as refused:
            await verifier.verify(authorization, None)
        assert refused.value.headers["WWW-Authenticate"].isascii()


async def test_keys_outlast_an_outage_and_unknown_ones_do_not_pass_in_it(authority, new_verifier, clock):
    verifier = new_verifier(clock)

    def token(**more):
        return bearer(authority.token(now_s=clock() // 1000, **more))

    assert await verifier.verify(token(), None)
    authority.is_down = True
    clock.pass_s(REFRESH_S + 1)
    assert await verifier.verify(token(), None)
    with pytest.raises(TokenRefused, match="cannot be fetched just now"):
        await verifier.verify(token(key="second"), None)
    clock.pass_s(25 * 3600)
    with pytest.raises(TokenRefused, match="cannot be fetched just now"):
        await verifier.verify(token(), None)


async def test_a_new_key_is_found_and_made_up_ones_are_not_looked_for_all_the_time(authority, new_verifier, clock):
    verifier = new_verifier(clock)

    def token(**more):
        return bearer(authority.token(now_s=clock() // 1000, **more))

    assert await verifier.verify(token(), None)
    for _ in range(20):
        with pytest.raises(TokenRefused):
            await verifier.verify(token(header={"kid": "made-up"}), None)
    assert authority.jwks_asked == 1
    authority.published = ["second"]
    clock.pass_s(REFETCH_S + 1)
    assert await verifier.verify(token(key="second"), None)
    assert authority.jwks_asked == 2
    with pytest.raises(TokenRefused, match="none of its issuer’s"):
        await verifier.verify(token(key="first"), None)


async def test_keys_from_files(authority, new_verifier, keys, tmp_path):
    pem, jwks = tmp_path / "key.pem", tmp_path / "keys.json"
    pem.write_bytes(keys["first"].as_pem(private=False))
    jwks.write_text(json.dumps({"keys": [keys["elliptic"].as_dict(private=False)]}))
    assert await new_verifier(keys_file=pem).verify(bearer(authority.token(header={"kid": None})), None)
    assert await new_verifier(keys_file=jwks).verify(bearer(authority.token(key="elliptic")), None)
    for text in (b"", b"{}", b'{"keys": 1}', b"-----BEGIN PUBLIC KEY-----\nAAAA\n-----END PUBLIC KEY-----"):
        pem.write_bytes(text)
        with pytest.raises(TransferError):
            new_verifier(keys_file=pem)


async def test_our_tokens_are_kept_per_host_and_scope(authority, http, clock):
    settings = USpaceSettings(token_url=f"{authority.url}/token", client_id="us", client_secret=authority.secret)
    tokens = TokenClient(settings, clock=clock, client=http)
    first = await tokens.token("a.example", "rid.service_provider")
    assert await tokens.token("a.example", "rid.service_provider") == first
    assert await tokens.token("b.example", "rid.service_provider") != first
    assert [each["audience"] for each in authority.tokens_asked] == ["a.example", "b.example"]
    clock.pass_s(3600 - 59)
    assert await tokens.token("a.example", "rid.service_provider") != first


async def test_without_a_token_server_nobody_waits_in_line(authority, http, clock):
    settings = USpaceSettings(token_url=f"{authority.url}/token", client_id="us", client_secret=authority.secret)
    tokens = TokenClient(settings, clock=clock, client=http)
    authority.is_down = True
    for _ in range(5):
        with pytest.raises(NoToken, match="answered 503"):
            await tokens.token("a.example", "rid.service_provider")
    assert len(authority.tokens_asked) == 1
    authority.is_down = False
    clock.pass_s(6)
    assert await tokens.token("a.example", "rid.service_provider")


async def test_the_test_server_of_interuss(authority, http, clock):
    settings = USpaceSettings(token_url=f"{authority.url}/token", client_id="us", token_request="interuss-dummy")
    assert await TokenClient(settings, clock=clock, client=http).token("a.example", "rid.service_provider")
