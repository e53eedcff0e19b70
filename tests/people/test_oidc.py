"""Signing in by OpenID Connect, against a real provider (npm oidc-provider) and against one that lies."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import hmac
import html
import json
import re
import time
from urllib.parse import parse_qs, urljoin, urlsplit

import httpx
import pytest
from joserfc import jws
from joserfc.jwk import ECKey, RSAKey
from kit.openid_provider import SECRET, command

from wonderland_backend.auth.oidc import OidcError, Provider
from wonderland_backend.settings.oidc import OidcSettings


@contextlib.asynccontextmanager
async def provider(redirect_uri):
    """A real provider; its issuer."""
    process = await asyncio.create_subprocess_exec(
        *command(redirect_uri),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.DEVNULL,
    )
    try:
        line = await asyncio.wait_for(process.stdout.readline(), 30)
        yield json.loads(line)["issuer"]
    finally:
        process.terminate()
        await process.wait()


class NowClock:
    def __call__(self):
        return time.time_ns() // 1_000_000


@pytest.fixture
async def linked(new_backend, serve_at, free_port, request):
    """A backend that knows a real provider."""
    more = getattr(request, "param", {})
    async with provider(f"http://localhost:{free_port}/api/v1/sign-in/oidc/callback") as issuer:
        oidc = OidcSettings(issuer=issuer, client_id="wonderland", client_secret=SECRET, name="Example", **more)
        backend = new_backend(allowed_hosts=frozenset({"127.0.0.1", "localhost"}), oidc=oidc, clock=NowClock())
        async with serve_at(backend, free_port) as server:
            yield server


class Browser:
    """Follows links and fills forms as a browser does, with a cookie jar for each of the two hosts."""

    def __init__(self, visitor):
        self.visitor = visitor
        self.url = str(visitor.http.headers["Origin"])
        self.there = httpx.AsyncClient(trust_env=False)

    async def start(self, **body):
        return (await self.visitor.call("POST", "/sign-in/oidc", body))["url"]

    async def log_in(self, url, login):
        """From the provider's first page to the address that it sends the browser back to."""
        answer = await self.there.get(url)
        for _ in range(12):
            if answer.is_redirect:
                target = urljoin(str(answer.url), answer.headers["location"])
                if target.startswith(self.url):
                    return target
                answer = await self.there.get(target)
                continue
            form = re.search(r'<form[^>]* action="([^"]+)"', answer.text)
            assert form, answer.text
            fields = dict(re.findall(r'name="([^"]+)" value="([^"]*)"', answer.text))
            if "login" in answer.text and "password" in answer.text:
                fields |= {"login": login, "password": "any"}
            answer = await self.there.post(urljoin(str(answer.url), html.unescape(form[1])), data=fields)
        raise AssertionError("the provider never sent the browser back")

    async def back(self, target):
        """Where the console is opened after the way back."""
        answer = await self.visitor.http.get(target.removeprefix(self.url))
        assert answer.status_code == 303, answer.text
        return answer.headers["location"]

    async def sign_in(self, login, **body):
        return await self.back(await self.log_in(await self.start(**body), login))


@contextlib.asynccontextmanager
async def browser(server):
    async with server.visitor() as visitor:
        found = Browser(visitor)
        try:
            yield found
        finally:
            await found.there.aclose()


async def test_the_first_administrator_may_come_by_the_provider(linked):
    async with browser(linked) as ada:
        assert (await ada.visitor.call("GET", "/sign-in"))["oidc"] == "Example"
        token = await linked.set_up_token()
        assert await ada.sign_in("ada", token=token, name="Ada L.") == "/"
        me = await ada.visitor.call("GET", "/session")
        assert (me["name"], me["roles"], me["method"]) == ("Ada L.", ["admin"], "oidc")
        await ada.visitor.call("DELETE", "/session", status=204)
        assert await ada.sign_in("ada") == "/"
        assert (await ada.visitor.call("GET", "/me"))["person"]["oidc"] is True
        await ada.visitor.call("POST", "/sign-in/link", {"token": token}, status=401)


async def test_an_invited_person_is_known_by_the_verified_address_and_then_by_the_subject(linked):
    async with linked.administrator() as admin, browser(linked) as grace, browser(linked) as mallory:
        body = {"name": "Grace", "email": "grace@example.org", "roles": ["inspector"]}
        made = await admin.call("POST", "/people", body, status=201)
        assert await mallory.sign_in("mallory") == "/#refused=unknown", "an address that nobody has verified"
        assert await mallory.sign_in("nobody") == "/#refused=unknown"
        assert await grace.sign_in("grace") == "/"
        assert (await grace.visitor.call("GET", "/session"))["roles"] == ["inspector"]
        path = f"/people/{made['person']['person_id']}"
        person = (await admin.call("GET", path))["person"]
        assert (person["state"], person["oidc"]) == ("active", True)
        change = {"revision": person["revision"], "email": "other@example.org"}
        await admin.call("PATCH", path, change)
        assert await grace.sign_in("grace") == "/", "by the subject, whatever the address"
        person = (await admin.call("GET", path))["person"]
        await admin.call("PATCH", path, {"revision": person["revision"], "state": "suspended"})
        assert await grace.sign_in("grace") == "/#refused=suspended"
        failed = (await admin.call("GET", "/audit?act=sign_in_failed"))["items"]
        assert [each["detail"]["why"] for each in failed] == ["suspended", "unknown", "unknown"]


@pytest.mark.parametrize(
    "linked", [{"roles": {"officers": "inspector"}, "scopes": "openid email groups"}], indirect=True
)
async def test_the_providers_groups_say_which_roles(linked):
    async with linked.administrator() as admin, browser(linked) as grace, browser(linked) as nobody:
        body = {"name": "Grace", "email": "grace@example.org", "roles": ["viewer", "admin"]}
        await admin.call("POST", "/people", body, status=201)
        assert await grace.sign_in("grace") == "/"
        assert (await grace.visitor.call("GET", "/session"))["roles"] == ["inspector"]
        made = await admin.call("POST", "/people", {"name": "N", "roles": ["viewer"]}, status=201)
        assert await nobody.sign_in("nobody", token=made["token"]) == "/", "the invitation itself counts once"
        assert await nobody.sign_in("nobody") == "/#refused=no_role"


async def test_the_way_back_is_for_the_browser_that_began_and_counts_once(linked):
    async with linked.administrator(), browser(linked) as grace, browser(linked) as eve:
        target = await grace.log_in(await grace.start(), "grace")
        assert await eve.back(target) == "/#refused=over", "another browser has not begun"
        await eve.start()
        assert await eve.back(target) == "/#refused=failed", "began something else: the state differs"
        assert await grace.back(target) == "/#refused=unknown"
        assert await grace.back(target) == "/#refused=over"
        await grace.start()
        denied = f"{grace.url}/api/v1/sign-in/oidc/callback?error=access_denied&state=x"
        assert await grace.back(denied) == "/#refused=denied"


async def test_an_identity_is_one_persons(linked):
    async with linked.administrator() as admin, browser(linked) as first, browser(linked) as second:
        links = []
        for name in ("One", "Two"):
            made = await admin.call("POST", "/people", {"name": name, "roles": ["viewer"]}, status=201)
            links.append(made["token"])
        assert await first.sign_in("ada", token=links[0]) == "/"
        assert await second.sign_in("ada", token=links[1]) == "/#refused=failed"
        await second.visitor.call("POST", "/sign-in/link", {"token": links[1]})


async def test_what_the_browser_is_sent_with(linked):
    async with linked.administrator(), browser(linked) as ada:
        query = parse_qs(urlsplit(await ada.start()).query)
        assert query["code_challenge_method"] == ["S256"]
        assert query["response_type"] == ["code"]
        assert {"state", "nonce", "code_challenge"} <= query.keys()
        cookie = next(each for each in ada.visitor.http.cookies.jar if each.name.endswith("_oidc"))
        assert cookie.has_nonstandard_attr("HttpOnly")
        assert cookie.get_nonstandard_attr("SameSite").lower() == "lax"


class Liar:
    """A provider whose answers a test makes up."""

    def __init__(self):
        self.issuer = "https://liar.example"
        self.key = ECKey.generate_key("P-256", {"kid": "1"})
        self.header = {"alg": "ES256", "kid": "1"}
        self.sign_with = self.key
        self.claims = {}
        self.metadata = {}
        self.userinfo = None
        self.confused = False

    def answer(self, request):
        return httpx.Response(200, stream=httpx.ByteStream(json.dumps(self.told(request)).encode()))

    def told(self, request):
        path = request.url.path
        if path.endswith("openid-configuration"):
            found = {
                "issuer": self.issuer,
                "authorization_endpoint": f"{self.issuer}/authorize",
                "token_endpoint": f"{self.issuer}/token",
                "jwks_uri": f"{self.issuer}/keys",
            }
            if self.userinfo is not None:
                found["userinfo_endpoint"] = f"{self.issuer}/userinfo"
            return found | self.metadata
        if path == "/keys":
            return {"keys": [self.key.as_dict(private=False)]}
        if path == "/userinfo":
            return self.userinfo
        if self.confused:
            return {"id_token": self.by_public_key()}
        token = jws.serialize_compact(
            self.header, json.dumps(self.claims), self.sign_with, algorithms=["ES256", "RS256", "RS512"]
        )
        return {"id_token": token, "access_token": "x", "token_type": "Bearer"}

    def by_public_key(self):
        """The oldest trick: signed by HMAC with the public key as if that were a shared secret."""
        parts = [json.dumps(each).encode() for each in ({"alg": "HS256", "kid": "1"}, self.claims)]
        text = b".".join(base64.urlsafe_b64encode(each).rstrip(b"=") for each in parts)
        signature = hmac.digest(self.key.as_pem(private=False), text, "sha256")
        return f"{text.decode()}.{base64.urlsafe_b64encode(signature).rstrip(b'=').decode()}"


NOW_S = 1_800_000_000


async def answered(liar, change=None, query=None, **options):
    """What becomes of a sign-in at this provider."""
    settings = OidcSettings(issuer="https://liar.example", client_id="wonderland", **options)
    transport = httpx.MockTransport(liar.answer)
    async with httpx.AsyncClient(transport=transport) as client:
        asking = Provider(settings, client, clock=lambda: NOW_S * 1000, randomness=lambda size: b"r" * size)
        url, kept = await asking.ask("https://here.example/callback")
        assert parse_qs(urlsplit(url).query).get("acr_values", []) == ([" ".join(settings.acr)] if settings.acr else [])
        liar.claims = {
            "iss": "https://liar.example",
            "sub": "1",
            "aud": "wonderland",
            "exp": NOW_S + 60,
            "iat": NOW_S,
            "nonce": kept["nonce"],
            "email": "A@example.org",
            "email_verified": True,
        } | (change or {})
        state = {"code": "c", "state": kept["state"]} | (query or {})
        return await asking.answer(kept, state, "https://here.example/callback")


async def test_an_honest_answer_of_a_provider():
    found = await answered(Liar())
    assert (found.subject, found.email) == ("1", "a@example.org")
    assert (await answered(Liar(), {"email_verified": "true"})).email is None
    assert (await answered(Liar(), {"aud": ["other", "wonderland"], "azp": "wonderland"})).subject == "1"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"iss": "https://other.example"}, "iss"),
        ({"aud": "somebody"}, "aud"),
        ({"aud": ["wonderland"], "azp": "somebody"}, "azp"),
        ({"exp": NOW_S - 61}, "exp"),
        ({"exp": None}, "exp"),
        ({"iat": NOW_S - 700}, "iat"),
        ({"iat": NOW_S + 120}, "in the future"),
        ({"iat": True}, "iat"),
        ({"nonce": "other"}, "nonce"),
        ({"nonce": None}, "nonce"),
        ({"sub": ""}, "sub"),
        ({"sub": 7}, "sub"),
        ({"sub": "s" * 256}, "sub"),
        ({"sub": None}, "sub"),
        ({"nbf": NOW_S + 120}, "not yet valid"),
        ({"exp": True}, "exp"),
    ],
)
async def test_tokens_that_are_not_for_this_sign_in(change, said):
    with pytest.raises(OidcError, match=f"sign-in: .*{said}"):
        await answered(Liar(), change)


@pytest.mark.parametrize("said", [None, "", "pwd", "phr ", ["phr"], 7, True])
async def test_who_did_not_sign_in_as_strongly_as_is_asked_for(said):
    strong = {"acr": ("phr", "phrh")}
    assert (await answered(Liar(), {"acr": "phrh"}, **strong)).subject == "1"
    assert (await answered(Liar(), {"acr": said})).subject == "1", "nothing is asked for"
    with pytest.raises(OidcError, match="acr"):
        await answered(Liar(), {} if said is None else {"acr": said}, **strong)


async def test_signatures_that_are_not_the_providers():
    liar = Liar()
    liar.sign_with = ECKey.generate_key("P-256", {"kid": "1"})
    with pytest.raises(OidcError, match="signature"):
        await answered(liar)
    liar = Liar()
    liar.confused = True
    with pytest.raises(OidcError, match="signature"):
        await answered(liar)
    liar = Liar()
    liar.sign_with = liar.key = RSAKey.generate_key(2048, {"kid": "1"})
    liar.header = {"alg": "RS512", "kid": "1"}
    with pytest.raises(OidcError, match="signature"):
        await answered(liar)


async def test_other_ways_in_which_a_provider_is_not_believed():
    with pytest.raises(OidcError, match="state"):
        await answered(Liar(), query={"state": "other"})
    with pytest.raises(OidcError, match="another issuer"):
        await answered(Liar(), query={"iss": "https://other.example"})
    liar = Liar()
    liar.userinfo = {"sub": "2", "email": "root@example.org", "email_verified": True}
    with pytest.raises(OidcError, match="somebody else"):
        await answered(liar)
    for metadata in ({"issuer": "https://other.example"}, {"token_endpoint": "http://liar.example/token"}):
        liar = Liar()
        liar.metadata = metadata
        with pytest.raises(OidcError):
            await answered(liar)
