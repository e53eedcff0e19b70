"""Machines: client credentials by secret and by signed assertion, scopes, revocation, limits."""

from __future__ import annotations

import httpx
import pytest
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from joserfc import jwt
from joserfc.jwk import ECKey, OctKey, RSAKey
from sqlalchemy import update

from wonderland_backend.clients.keys import TokenKeys
from wonderland_backend.clients.store import ClientError, NewClient, role_within
from wonderland_backend.clients.tokens import ASSERTION_TYPE
from wonderland_backend.db.tables.clients import ClientRow
from wonderland_backend.db.tables.people import PersonRow
from wonderland_backend.errors import SettingsError, TooManyRequests
from wonderland_backend.http.limits import RateLimits
from wonderland_backend.people import store as people
from wonderland_backend.people.schemas import Invitation
from wonderland_backend.person import Account

START_S = 1_800_000_000
BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
both = pytest.mark.parametrize("database_url", BOTH, indirect=True)
GRANT = {"grant_type": "client_credentials"}


@pytest.fixture
async def stranger(running):
    async with httpx.AsyncClient(base_url=running.url, trust_env=False) as http:
        yield http


@both
async def test_a_secret_buys_a_token_and_the_token_opens_what_its_scope_says(running, register, stranger):
    row, secret = await register(running, "wonderland.pads.read wonderland.proofs.read")
    answer = await stranger.post(
        "/oauth/token", data=GRANT | {"scope": "wonderland.pads.read"}, auth=(row.client_id, secret)
    )
    assert (answer.status_code, answer.headers["cache-control"]) == (200, "no-store")
    token = answer.json()
    assert (token["token_type"], token["expires_in"], token["scope"]) == ("Bearer", 3600, "wonderland.pads.read")
    bearer = {"Authorization": f"Bearer {token['access_token']}"}
    pads = await stranger.get("/api/v1/pads", headers=bearer)
    assert [pad["pad_id"] for pad in pads.json()["items"]] == ["pad-1", "pad-2"]
    assert pads.headers["ratelimit-policy"] == '"default";q=600;w=60'
    assert pads.headers["ratelimit"].startswith('"default";r=599;t=')
    refused = await stranger.get("/api/v1/verdicts", headers=bearer)
    assert refused.status_code == 403
    assert refused.json()["type"] == "urn:wonderland:problem:insufficient-scope"
    assert 'scope="wonderland.proofs.read"' in refused.headers["www-authenticate"]
    known = await running.parts.clients.find_client(row.client_id)
    assert known.last_token_ms == running.context.clock()


async def test_the_first_token_of_an_hour_is_in_the_log(running, register, stranger, clock):
    row, secret = await register(running, "wonderland.pads.read")
    token = await running.parts.sign_ins.new_token("Admin", ("admin",))
    assert (await running.http.post("/api/v1/session", json={"token": token})).status_code == 200

    async def issued():
        assert (await stranger.post("/oauth/token", data=GRANT, auth=(row.client_id, secret))).status_code == 200
        return [each["subject"] for each in (await running.json("/audit", act="token_issued"))["items"]]

    assert await issued() == await issued() == [f"client/{row.client_id}"]
    clock.now_ms += 3_600_000
    assert await issued() == [f"client/{row.client_id}"] * 2


async def test_the_token_is_signed_by_a_published_key(running, register, stranger):
    row, secret = await register(running, "wonderland.pads.read")
    server = (await stranger.get("/.well-known/oauth-authorization-server")).json()
    token = (await stranger.post("/oauth/token", data=GRANT, auth=(row.client_id, secret))).json()["access_token"]
    (key,) = (await stranger.get("/oauth/jwks.json")).json()["keys"]
    assert "d" not in key
    found = jwt.decode(token, ECKey.import_key(key), algorithms=["ES256"])
    claims = found.claims
    assert (claims["iss"], claims["aud"], claims["client_id"]) == (server["issuer"], "localhost", row.client_id)
    assert claims["exp"] - claims["iat"] == 3600
    assert found.header["typ"] == "at+jwt"


def assertion(key, client_id, **change):
    claims = {
        "iss": client_id,
        "sub": client_id,
        "aud": "http://localhost/oauth/token",
        "exp": START_S + 60,
        "jti": "one",
    } | change
    claims = {name: value for name, value in claims.items() if value is not None}
    return jwt.encode(
        {"alg": "ES256" if isinstance(key, ECKey) else "RS256"}, claims, key, algorithms=["ES256", "RS256"]
    )


@both
async def test_an_assertion_in_place_of_a_secret_is_good_once(running, register, stranger):
    key = ECKey.generate_key("P-256", private=True)
    row, secret = await register(running, "wonderland.pads.read", jwks={"keys": [key.as_dict(private=False)]})
    assert secret is None

    async def ask(text):
        form = GRANT | {"client_assertion_type": ASSERTION_TYPE, "client_assertion": text}
        return await stranger.post("/oauth/token", data=form)

    text = assertion(key, row.client_id)
    assert (await ask(text)).status_code == 200
    again = await ask(text)
    assert (again.status_code, again.json()["error"]) == (401, "invalid_client")
    assert "before" in again.json()["error_description"]
    other = ECKey.generate_key("P-256", private=True)
    for bad in (
        assertion(other, row.client_id, jti="two"),
        assertion(key, row.client_id, jti="three", exp=START_S - 60),
        assertion(key, row.client_id, jti="four", exp=START_S + 7200),
        assertion(key, row.client_id, jti="five", aud="https://elsewhere.example"),
        assertion(key, row.client_id, jti=None),
        assertion(key, row.client_id, jti="six", iss="wl-somebody"),
        assertion(key, "wl-nobody", jti="seven"),
        "a.b.c",
        "x" * 9000,
    ):
        answer = await ask(bad)
        assert (answer.status_code, answer.json()["error"]) == (401, "invalid_client"), answer.text


@pytest.mark.parametrize(
    ("form", "status", "error"),
    [
        ({"grant_type": "password"}, 400, "unsupported_grant_type"),
        ({"scope": "wonderland.pads.read"}, 400, "unsupported_grant_type"),
        (GRANT | {"scope": "wonderland.alerts.read"}, 400, "invalid_scope"),
        (GRANT | {"scope": "nonsense"}, 400, "invalid_scope"),
        (GRANT | {"audience": "elsewhere.example"}, 400, "invalid_target"),
    ],
)
async def test_token_requests_that_ask_for_too_much(running, register, stranger, form, status, error):
    row, secret = await register(running, "wonderland.pads.read")
    answer = await stranger.post("/oauth/token", data=form, auth=(row.client_id, secret))
    assert (answer.status_code, answer.json()["error"]) == (status, error)


async def test_token_requests_of_nobody(running, register, stranger):
    row, secret = await register(running, "wonderland.pads.read")
    for auth in ((row.client_id, "wrong"), ("wl-nobody", secret), (row.client_id, "")):
        answer = await stranger.post("/oauth/token", data=GRANT, auth=auth)
        assert (answer.status_code, answer.json()["error"]) == (401, "invalid_client")
        assert answer.headers["www-authenticate"].startswith("Basic")
    for headers in ({}, {"Authorization": "Basic !!"}, {"Authorization": "Bearer x"}):
        assert (await stranger.post("/oauth/token", data=GRANT, headers=headers)).status_code == 401
    twice = await stranger.post(
        "/oauth/token", content="scope=a&scope=b", headers={"Content-Type": "application/x-www-form-urlencoded"}
    )
    assert twice.json()["error"] == "invalid_request"
    assert (await stranger.post("/oauth/token", json=GRANT)).json()["error"] == "invalid_request"
    many = "&".join(f"a{index}=1" for index in range(100))
    headers = {"Content-Type": "application/x-www-form-urlencoded"}
    assert (await stranger.post("/oauth/token", content=many, headers=headers)).status_code == 400


async def test_a_revoked_client_is_out_at_once(running, machine):
    async with machine("wonderland.pads.read") as http:
        assert (await http.get("/api/v1/pads")).status_code == 200
        answer = await running.http.delete(f"/api/v1/clients/{http.client_id}")
        assert answer.status_code == 403, "an inspector is no administrator"
        async with running.context.database.write() as connection:
            await running.parts.clients.revoke(connection, http.client_id, "a test")
        refused = await http.get("/api/v1/pads")
        assert refused.status_code == 401
        assert 'error="invalid_token"' in refused.headers["www-authenticate"]


async def test_a_revoked_client_is_out_of_network_remote_id_too(running, machine):
    async with machine("rid.display_provider") as http:
        view = "/uss/flights?view=60.44,22.25,60.46,22.29"
        assert (await http.get(view)).status_code == 200
        async with running.context.database.write() as connection:
            await connection.execute(update(ClientRow).values(scopes="rid.service_provider"))
        assert (await http.get(view)).status_code == 403, "what was taken away is in older tokens no longer"
        async with running.context.database.write() as connection:
            await running.parts.clients.revoke(connection, http.client_id, "a test")
        refused = await http.get(view)
        assert (refused.status_code, refused.json()["detail"]) == (401, "The client was revoked.")


async def test_tokens_expire(running, machine, clock):
    async with machine("wonderland.pads.read") as http:
        clock.now_ms += 3_600_000 + 60_000
        refused = await http.get("/api/v1/pads")
        assert (refused.status_code, "expired" in refused.json()["detail"]) == (401, True)


async def test_forged_tokens_are_refused(running, stranger, register):
    row, _ = await register(running, "wonderland.pads.read")
    claims = {
        "iss": "http://localhost", "sub": row.client_id, "client_id": row.client_id, "aud": "localhost",
        "iat": START_S, "exp": START_S + 600, "scope": "wonderland.pads.read",
    }  # fmt: skip
    public = running.parts.machines.tokens.keys.public()["keys"][0]
    ours = running.parts.machines.tokens.keys.signing
    foreign = ECKey.generate_key("P-256", private=True)
    forged = [
        jwt.encode({"alg": "ES256"}, claims, foreign, algorithms=["ES256"]),
        jwt.encode({"alg": "ES256", "kid": public["kid"]}, claims, foreign, algorithms=["ES256"]),
        jwt.encode({"alg": "HS256"}, claims, OctKey.import_key(public["x"]), algorithms=["HS256"]),
        jwt.encode({"alg": "RS256"}, claims, RSAKey.generate_key(2048), algorithms=["RS256"]),
        jwt.encode({"alg": "ES256"}, claims | {"iss": "https://elsewhere"}, ours, algorithms=["ES256"]),
        jwt.encode({"alg": "ES256"}, claims | {"aud": "elsewhere"}, ours, algorithms=["ES256"]),
        jwt.encode({"alg": "ES256"}, claims | {"sub": "wl-nobody"}, ours, algorithms=["ES256"]),
        "eyJhbGciOiJub25lIn0.e30.",
        "not-a-token",
    ]
    for token in forged:
        answer = await stranger.get("/api/v1/pads", headers={"Authorization": f"Bearer {token}"})
        assert answer.status_code == 401, token
        assert answer.headers["www-authenticate"].startswith("Bearer")


async def test_what_has_no_scope_is_closed_to_machines(running, machine):
    every = "wonderland.pads.read wonderland.drones.read wonderland.proofs.read wonderland.alerts.read wonderland.ledger.read"
    async with machine(every) as http:
        for path in ("/api/v1/session", "/api/v1/clients"):
            assert (await http.get(path)).status_code == 403, path
        for path in ("/api/v1/pads", "/api/v1/drones", "/api/v1/verdicts", "/api/v1/alerts", "/api/v1/status"):
            assert (await http.get(path)).status_code == 200, path
        alert = (await http.get("/api/v1/alerts")).json()["items"][0]
        act = {"act": "acknowledge", "revision": alert["revision"]}
        answer = await http.post(f"/api/v1/alerts/{alert['alert_id']}/acts", json=act)
        assert answer.status_code == 403


async def test_too_many_requests(new_backend, serving, machine_at, clock):
    async with (
        serving(new_backend(client_requests_per_min=3)) as served,
        machine_at(served, "wonderland.pads.read") as http,
    ):
        for left in (2, 1, 0):
            answer = await http.get("/api/v1/pads")
            assert (answer.status_code, answer.headers["ratelimit"].split(";")[1]) == (200, f"r={left}")
        refused = await http.get("/api/v1/pads")
        assert (refused.status_code, refused.json()["type"]) == (429, "urn:wonderland:problem:too-many-requests")
        assert 0 < int(refused.headers["retry-after"]) <= 60
        clock.now_ms += 60_000
        assert (await http.get("/api/v1/pads")).status_code == 200


def test_limits_forget_callers_rather_than_fill_memory(monkeypatch):
    now = [0]
    limits = RateLimits(1, lambda: now[0])
    monkeypatch.setattr("wonderland_backend.http.limits.MAX_CALLERS", 10)
    for index in range(1000):
        limits.count(f"caller {index}")
    assert len(limits._windows) <= 10
    scope = {}
    limits.admit(scope, "somebody")
    with pytest.raises(TooManyRequests):
        limits.admit(scope, "somebody")


async def test_an_administrator_registers_and_revokes(running):
    token = await running.parts.sign_ins.new_token("Admin", ("admin",))
    assert (await running.http.post("/api/v1/session", json={"token": token})).status_code == 200
    body = {"name": "City U-space", "scopes": ["wonderland.proofs.read", "rid.display_provider"]}
    answer = await running.http.post("/api/v1/clients", json=body)
    assert answer.status_code == 201, answer.text
    made = answer.json()
    assert len(made["client_secret"]) == 43
    client = made["client"]
    assert answer.headers["location"].endswith(client["client_id"])
    assert (client["role"], client["method"]) == ("viewer", "client_secret_basic")
    listed = await running.json("/clients")
    assert [each["client_id"] for each in listed["items"]] == [client["client_id"]]
    assert made["client_secret"] not in str(listed)
    gone = (await running.http.delete(f"/api/v1/clients/{client['client_id']}")).json()
    assert gone["revoked_ms"]
    assert (await running.json(f"/clients/{client['client_id']}")) == gone
    assert (await running.http.delete(f"/api/v1/clients/wl-{'0' * 24}")).status_code == 404
    bad = await running.http.post("/api/v1/clients", json=body | {"scopes": ["everything"]})
    assert (bad.status_code, "everything" in bad.json()["detail"]) == (422, True)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"name": ""}, "name"),
        ({"scopes": ()}, "scopes"),
        ({"role": "admin"}, "role"),
        ({"role": "pad_operator"}, "msp_id"),
        ({"msp_id": "PadMSP"}, "msp_id"),
        ({"jwks": {"keys": []}}, "jwks"),
        ({"jwks": {}}, "jwks"),
        ({"jwks": {"keys": [{"kty": "oct", "k": "c2VjcmV0"}]}}, "jwks"),
        ({"jwks": {"keys": [ECKey.generate_key("P-256", private=True).as_dict(private=True)]}}, "private"),
    ],
)
def test_clients_that_cannot_be(change, said):
    options = {"name": "x", "scopes": ("wonderland.pads.read",)} | change
    with pytest.raises(ClientError, match=said):
        NewClient(**options).check()


def test_keys_from_a_file(tmp_path):
    path = tmp_path / "keys.pem"
    keys = [ec.generate_private_key(ec.SECP256R1()) for _ in range(2)]
    path.write_bytes(b"".join(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()) for key in keys))
    loaded = TokenKeys.load(path)
    assert len(loaded.public()["keys"]) == 2
    assert TokenKeys.load(path).signing.kid == loaded.signing.kid
    for content in (b"", b"-----BEGIN PRIVATE KEY-----\nAA==\n-----END PRIVATE KEY-----\n"):
        path.write_bytes(content)
        with pytest.raises(SettingsError, match="token_key_file"):
            TokenKeys.load(path)
    with pytest.raises(SettingsError, match="token_key_file"):
        TokenKeys.load(tmp_path / "missing")


@pytest.mark.parametrize(
    ("change", "state", "role", "left"),
    [
        ({"roles": "inspector"}, "active", "inspector", "inspector"),
        ({"roles": "viewer"}, "active", "inspector", "viewer"),
        ({"roles": "pad_operator", "msp_id": "PadMSP"}, "active", "inspector", None),
        ({"roles": "admin"}, "suspended", "viewer", None),
    ],
)
async def test_a_machine_never_goes_beyond_the_person_who_registered_it(running, change, state, role, left):
    """Demoted or suspended: its machines lose with it, at once, with the tokens that they have."""
    ada = Account("a" * 32, "Ada")
    async with running.context.database.write() as connection:
        await people.create(
            connection, ada, Invitation(name="Ada", roles=["admin"]), ada.person_id, state="active", now_ms=0
        )
        wanted = NewClient("Bot", ("wonderland.pads.read", "wonderland.traffic.ussp"), role)
        row, secret = await running.parts.clients.add(connection, wanted, ada)
    async with httpx.AsyncClient(base_url=running.url, trust_env=False) as http:
        form = {"grant_type": "client_credentials"}
        answer = await http.post("/oauth/token", data=form, auth=(row.client_id, secret))
        bearer = {"Authorization": f"Bearer {answer.json()['access_token']}"}
        assert (await http.get("/api/v1/pads", headers=bearer)).status_code == 200
        async with running.context.database.write() as connection:
            await connection.execute(
                update(PersonRow).where(PersonRow.person_id == ada.person_id).values(state=state, **change)
            )
        now = await running.parts.clients.find_client(row.client_id)
        assert (now.role if now.revoked_ms is None else None) == left
        assert ("wonderland.traffic.ussp" in now.scopes.split()) == (change["roles"] in {"inspector", "admin"}), (
            "who is told operators and pilots"
        )
        again = await http.get("/api/v1/pads", headers=bearer)
        anew = await http.post("/oauth/token", data=form, auth=(row.client_id, secret))
        expected = (200, 200) if left else (401, 401)
        assert (again.status_code, anew.status_code) == expected


@pytest.mark.parametrize(
    ("role", "msp_id", "held", "held_msp_id", "left"),
    [
        ("pad_operator", "PadMSP", ("pad_operator",), "PadMSP", "pad_operator"),
        ("pad_operator", "PadMSP", ("pad_operator",), "Pad2MSP", None),
        ("fleet_operator", "FleetMSP", ("viewer",), "", None),
        ("inspector", "", ("fleet_operator",), "FleetMSP", None),
        ("viewer", "", ("inspector",), "", "viewer"),
        ("inspector", "", (), "", None),
    ],
)
def test_what_is_left_of_a_machine(role, msp_id, held, held_msp_id, left):
    assert role_within(role, msp_id, held, held_msp_id) == left
