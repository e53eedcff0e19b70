"""Machines that authenticate by certificate, and tokens that are good with one certificate only (RFC 8705, 9440)."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import datetime as dt
import json
import ssl

import httpx
import pytest
import trustme
from click.testing import CliRunner
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.oid import NameOID
from kit.databases import copy_migrated

from wonderland.client import Wonderland
from wonderland_backend.clients.certificates import sha256_of
from wonderland_backend.clients.commands import client as client_commands
from wonderland_backend.clients.store import ByCertificate, ClientError, NewClient
from wonderland_backend.errors import SettingsError
from wonderland_backend.listening import Listen
from wonderland_backend.serve import new_server
from wonderland_backend.settings import Settings, load

NAME = "machine.city.example"
GRANT = {"grant_type": "client_credentials"}
PADS = "wonderland.pads.read"


class Authority:
    """A CA, and what it issues as files."""

    def __init__(self, directory):
        self.directory = directory
        self.ca = trustme.CA()
        self.file = directory / "ca.pem"
        self.ca.cert_pem.write_to_path(self.file)
        self.count = 0

    def issue(self, *names, ca=None, **options):
        """A leaf: a file with key and chain, and the certificates themselves, the leaf first."""
        self.count += 1
        leaf = (ca or self.ca).issue_cert(*names, **options)
        path = self.directory / f"leaf-{self.count}.pem"
        leaf.private_key_and_cert_chain_pem.write_to_path(path)
        chain = [x509.load_pem_x509_certificate(blob.bytes()) for blob in leaf.cert_chain_pems]
        return path, chain


@pytest.fixture
def authority(tmp_path):
    return Authority(tmp_path)


@contextlib.asynccontextmanager
async def served(backend):
    """Serve with TLS on this machine's name; yields the address."""
    server = new_server(backend.app, backend.settings)
    with contextlib.closing(Listen("127.0.0.1", 0).open()) as bound:
        async with backend.running():
            task = asyncio.create_task(server.serve([bound]))
            while not server.started:
                await asyncio.sleep(0.005)
            try:
                # Before its first administrator a server refuses everything.
                await backend.parts.sign_ins.new_token("Admin", ("admin",))
                yield f"https://localhost:{bound.getsockname()[1]}"
            finally:
                backend.end_streams()
                server.should_exit = True
                await task


@pytest.fixture
async def by_tls(new_backend, authority):
    """A backend that ends TLS itself, and makes HTTP clients with and without a certificate."""
    own, _ = authority.issue("localhost")
    backend = new_backend(
        allowed_hosts=frozenset({"localhost"}),
        public_url="https://localhost",
        tls_certificate=own,
        tls_client_ca=authority.file,
    )
    async with served(backend) as url, contextlib.AsyncExitStack() as opened:

        async def connect(path=None):
            context = ssl.create_default_context(cafile=str(authority.file))
            if path is not None:
                context.load_cert_chain(path)
            http = httpx.AsyncClient(base_url=url, verify=context, trust_env=False, timeout=30)
            return await opened.enter_async_context(http)

        yield backend, connect


async def register(backend, scopes=PADS, **options):
    wanted = NewClient("Tester", tuple(scopes.split()), **options)
    async with backend.database.write() as connection:
        row, secret = await backend.parts.clients.add(connection, wanted, "a test")
    return row.client_id, secret


async def token_of(http, client_id, **headers):
    answer = await http.post("/oauth/token", data=GRANT | {"client_id": client_id}, headers=headers)
    assert answer.status_code == 200, answer.text
    return answer.json()["access_token"]


def bearer(token):
    return {"Authorization": f"Bearer {token}"}


def claims_of(token):
    body = token.split(".")[1]
    return json.loads(base64.urlsafe_b64decode(body + "=" * (-len(body) % 4)))


@pytest.mark.parametrize(
    "known_by",
    [
        ("subject_dn", f"CN={NAME},OU=Machines,O=City"),
        ("san_dns", NAME.upper()),
    ],
)
async def test_a_certificate_buys_a_token_that_is_good_with_it_alone(by_tls, authority, known_by):
    backend, connect = by_tls
    path, (leaf, *_) = authority.issue(
        NAME, common_name=NAME, organization_name="City", organization_unit_name="Machines"
    )
    if known_by[0] == "subject_dn":
        known_by = ("subject_dn", leaf.subject.rfc4514_string())
    client_id, secret = await register(backend, tls=ByCertificate.named(*known_by))
    assert secret is None
    http = await connect(path)
    server = (await http.get("/.well-known/oauth-authorization-server")).json()
    assert {"tls_client_auth", "self_signed_tls_client_auth"} <= set(server["token_endpoint_auth_methods_supported"])
    assert server["tls_client_certificate_bound_access_tokens"] is True

    token = await token_of(http, client_id)
    thumbprint = base64.urlsafe_b64encode(sha256_of(leaf)).rstrip(b"=").decode()
    assert claims_of(token)["cnf"] == {"x5t#S256": thumbprint}
    assert (await http.get("/api/v1/pads", headers=bearer(token))).status_code == 200

    stolen = await (await connect()).get("/api/v1/pads", headers=bearer(token))
    assert (stolen.status_code, stolen.json()["type"]) == (401, "urn:wonderland:problem:invalid-token")
    assert "shows none" in stolen.json()["detail"]
    thief, _ = authority.issue("thief.city.example")
    stolen = await (await connect(thief)).get("/api/v1/pads", headers=bearer(token))
    assert stolen.status_code == 401
    assert "another certificate" in stolen.json()["detail"]
    assert 'error="invalid_token"' in stolen.headers["www-authenticate"]
    # A certificate of the same name, issued anew, is the same client; its old token is not good with it.
    renewed, _ = authority.issue(NAME, common_name=NAME, organization_name="City", organization_unit_name="Machines")
    http = await connect(renewed)
    assert (await http.get("/api/v1/pads", headers=bearer(token))).status_code == 401
    if known_by[0] == "san_dns":
        fresh = await token_of(http, client_id)
        assert (await http.get("/api/v1/pads", headers=bearer(fresh))).status_code == 200


async def test_other_certificates_and_none_buy_nothing(by_tls, authority, tmp_path):
    backend, connect = by_tls
    client_id, _ = await register(backend, tls=ByCertificate.named("san_dns", NAME))
    other, _ = authority.issue("other.city.example")
    for http in (await connect(), await connect(other)):
        answer = await http.post("/oauth/token", data=GRANT | {"client_id": client_id})
        assert (answer.status_code, answer.json()["error"]) == (401, "invalid_client")
    # Neither does a client that has a secret get by without it.
    with_secret, _ = await register(backend)
    own, _ = authority.issue(NAME)
    answer = await (await connect(own)).post("/oauth/token", data=GRANT | {"client_id": with_secret})
    assert answer.json()["error"] == "invalid_client"
    async with backend.database.write() as connection:
        await backend.parts.clients.revoke(connection, client_id, "a test")
    answer = await (await connect(own)).post("/oauth/token", data=GRANT | {"client_id": client_id})
    assert answer.json()["error"] == "invalid_client"
    # One of a CA that is not ours does not even come through the handshake.
    foreign = tmp_path / "foreign.pem"
    trustme.CA().issue_cert(NAME).private_key_and_cert_chain_pem.write_to_path(foreign)
    with pytest.raises(httpx.TransportError):
        await (await connect(foreign)).get("/api/v1/health")


async def test_a_secret_with_a_certificate_buys_a_bound_token_and_without_one_as_ever(by_tls, authority):
    backend, connect = by_tls
    client_id, secret = await register(backend)
    path, _ = authority.issue(NAME)
    plain, mutual = await connect(), await connect(path)

    async def buy(http):
        answer = await http.post("/oauth/token", data=GRANT, auth=(client_id, secret))
        return bearer(answer.json()["access_token"])

    unbound, bound = await buy(plain), await buy(mutual)
    assert [(await plain.get("/api/v1/pads", headers=each)).status_code for each in (unbound, bound)] == [200, 401]
    assert [(await mutual.get("/api/v1/pads", headers=each)).status_code for each in (unbound, bound)] == [200, 200]
    # Browsers need none.
    assert (await plain.get("/api/v1/health")).status_code == 200


async def test_other_systems_interfaces_check_the_binding_too(by_tls, authority):
    backend, connect = by_tls
    path, _ = authority.issue(NAME)
    client_id, _ = await register(backend, "rid.display_provider", tls=ByCertificate.named("san_dns", NAME))
    http = await connect(path)
    headers = bearer(await token_of(http, client_id))
    view = {"view": "60.45,22.26,60.46,22.27"}
    assert (await http.get("/uss/flights", params=view, headers=headers)).status_code == 200
    refused = await (await connect()).get("/uss/flights", params=view, headers=headers)
    assert refused.status_code == 401


async def test_the_python_client_by_certificate(by_tls, authority, monkeypatch):
    backend, connect = by_tls
    path, _ = authority.issue(NAME)
    client_id, _ = await register(backend, tls=ByCertificate.named("san_dns", NAME))
    url = str((await connect()).base_url)
    monkeypatch.setenv("SSL_CERT_FILE", str(authority.file))

    def ask():
        with Wonderland(url, client_id, certificate=(str(path), str(path))) as api:
            return list(api.pads())

    assert await asyncio.to_thread(ask) == []
    with pytest.raises(ValueError, match="certificate"):
        Wonderland(url, client_id)


def self_signed(name=NAME, days=30):
    key = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    now = dt.datetime(2027, 1, 15, tzinfo=dt.UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - dt.timedelta(days=30))
        .not_valid_after(now + dt.timedelta(days=days))
        .sign(key, hashes.SHA256())
    )


def item(certificate):
    return f":{base64.b64encode(certificate.public_bytes(Encoding.DER)).decode()}:"


def pem(certificate):
    return certificate.public_bytes(Encoding.PEM).decode()


@pytest.fixture
def behind_proxy(new_backend, serving, authority):
    """Backends that believe a proxy on this machine."""

    def serve(proxies=("127.0.0.1",), **options):
        return serving(new_backend(client_cert_proxies=proxies, **({"tls_client_ca": authority.file} | options)))

    return serve


async def test_a_proxy_tells_the_certificate(behind_proxy, authority):
    intermediate = authority.ca.create_child_ca()
    _, (leaf, *chain) = authority.issue(NAME, ca=intermediate)
    own = self_signed()
    headers = {"Client-Cert": item(leaf), "Client-Cert-Chain": ", ".join(map(item, chain))}
    async with behind_proxy() as running, httpx.AsyncClient(base_url=running.url, trust_env=False) as http:
        by_name, _ = await register(running.backend, tls=ByCertificate.named("san_dns", NAME))
        pinned, _ = await register(running.backend, tls=ByCertificate.pinned(pem(own)))
        token = await token_of(http, by_name, **headers)
        assert (await http.get("/api/v1/pads", headers=bearer(token) | headers)).status_code == 200
        assert (await http.get("/api/v1/pads", headers=bearer(token))).status_code == 401
        swapped = bearer(token) | {"Client-Cert": item(own)}
        assert (await http.get("/api/v1/pads", headers=swapped)).status_code == 401
        token = await token_of(http, pinned, **{"Client-Cert": item(own)})
        assert (await http.get("/api/v1/pads", headers=bearer(token) | {"Client-Cert": item(own)})).status_code == 200

        # By name only what leads to our CA counts: without the intermediate one it does not, nor self-signed.
        for bad in ({"Client-Cert": item(leaf)}, {"Client-Cert": item(own)}):
            answer = await http.post("/oauth/token", data=GRANT | {"client_id": by_name}, headers=bad)
            assert answer.json()["error"] == "invalid_client"
        # A certificate like the pinned one, of another key, is another one.
        answer = await http.post(
            "/oauth/token", data=GRANT | {"client_id": pinned}, headers={"Client-Cert": item(self_signed())}
        )
        assert answer.json()["error"] == "invalid_client"


async def test_a_pinned_certificate_that_has_expired(behind_proxy):
    old = self_signed(days=-1)
    async with behind_proxy() as running:
        client_id, _ = await register(running.backend, tls=ByCertificate.pinned(pem(old)))
        answer = await running.http.post(
            "/oauth/token", data=GRANT | {"client_id": client_id}, headers={"Client-Cert": item(old)}
        )
        assert "not valid now" in answer.json()["error_description"]


@pytest.mark.parametrize("proxies", [("192.0.2.1", "2001:db8::/32"), ()])
async def test_the_header_of_anybody_else_counts_for_nothing(behind_proxy, proxies):
    own = self_signed()
    ca = {} if proxies else {"tls_client_ca": None}
    async with behind_proxy(proxies, **ca) as running:
        client_id, _ = await register(running.backend, tls=ByCertificate.pinned(pem(own)))
        # Not even where it says that it comes from the proxy.
        headers = {"Client-Cert": item(own), "X-Forwarded-For": "192.0.2.1"}
        answer = await running.http.post("/oauth/token", data=GRANT | {"client_id": client_id}, headers=headers)
        assert (answer.status_code, answer.json()["error"]) == (401, "invalid_client")


@pytest.mark.parametrize(
    "header", ["", ":", "::", ":AAAA:", "not base64", ":????:", f":{'A' * 40_000}:", f"{item(self_signed())[:-1]}"]
)
async def test_a_proxy_that_tells_no_certificate(behind_proxy, header):
    async with behind_proxy() as running:
        answer = await running.http.post("/oauth/token", data=GRANT, headers={"Client-Cert": header})
        assert (answer.status_code, answer.json()["type"]) == (400, "urn:wonderland:problem:bad-request")


async def test_a_certificate_told_twice_is_none(behind_proxy):
    async with behind_proxy() as running:
        headers = [("Client-Cert", item(self_signed())), ("Client-Cert", item(self_signed()))]
        answer = await running.http.post("/oauth/token", data=GRANT, headers=headers)
        assert answer.status_code == 400


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"tls_certificate": "x.pem"}, "public_url"),
        ({"tls_key": "x.pem"}, "tls_certificate"),
        ({"tls_client_ca": "x.pem"}, "tls_certificate"),
        ({"client_cert_proxies": ("nonsense",)}, "nonsense"),
        ({"client_cert_proxies": ("0.0.0.0/0",)}, "everybody"),
    ],
)
def test_settings_that_make_no_sense(options, named):
    with pytest.raises(SettingsError, match=named):
        load(**options)


async def test_files_that_are_none(new_backend, tmp_path, authority):
    empty = tmp_path / "empty.pem"
    empty.write_text("nothing")
    with pytest.raises(SettingsError, match="tls_client_ca"):
        new_backend(tls_client_ca=empty, client_cert_proxies=("127.0.0.1",))
    backend = new_backend()
    settings = Settings(public_url="https://localhost", tls_certificate=tmp_path / "missing.pem")
    with pytest.raises(SettingsError, match="tls_certificate"):
        new_server(backend.app, settings)


@pytest.mark.parametrize(
    "make",
    [
        lambda: ByCertificate.named("subject_dn", "no DN"),
        lambda: ByCertificate.named("san_dns", ""),
        lambda: ByCertificate.named("san_uri", "a\nb"),
        lambda: ByCertificate.pinned("no certificate"),
        lambda: ByCertificate.pinned(pem(self_signed()) * 2),
    ],
)
def test_certificates_that_cannot_be_registered(make):
    with pytest.raises(ClientError):
        make()


async def test_an_administrator_registers_by_certificate(running):
    token = await running.parts.sign_ins.new_token("Admin", ("admin",))
    assert (await running.http.post("/api/v1/session", json={"token": token})).status_code == 200
    own = self_signed()
    body = {"name": "City", "scopes": [PADS], "certificate": {"pem": pem(own)}}
    made = (await running.http.post("/api/v1/clients", json=body)).json()
    assert "client_secret" not in made
    assert made["client"]["method"] == "self_signed_tls_client_auth"
    assert made["client"]["certificate"] == {"sha256": sha256_of(own).hex()}
    body["certificate"] = {"subject_dn": "CN=machine,O=City"}
    made = (await running.http.post("/api/v1/clients", json=body)).json()
    assert made["client"]["method"] == "tls_client_auth"
    for bad in ({}, {"san_dns": "a", "san_uri": "b"}, {"pem": "x"}, {"subject_dn": "x"}):
        answer = await running.http.post("/api/v1/clients", json=body | {"certificate": bad})
        assert answer.status_code == 422, answer.text


def test_the_command_registers_by_certificate(tmp_path):
    own = tmp_path / "own.pem"
    own.write_text(pem(self_signed()))
    database = ["--database", f"sqlite:///{copy_migrated(tmp_path / 'own.db')}"]
    for options, method in (
        (["--certificate", str(own)], "self_signed_tls_client_auth"),
        (["--subject-dn", "CN=machine,O=City"], "tls_client_auth"),
        ([], "client_secret_basic"),
    ):
        done = CliRunner().invoke(client_commands, ["add", "City", *options, *database, "--json"])
        assert done.exit_code == 0, done.output
        listed = json.loads(CliRunner().invoke(client_commands, ["list", *database, "--json"]).output)
        (row,) = [each for each in listed if each["client_id"] == json.loads(done.output)["client_id"]]
        assert row["method"] == method
    done = CliRunner().invoke(client_commands, ["add", "City", "--san-dns", "a", "--san-uri", "b", *database])
    assert done.exit_code == 1
    assert "one of" in done.output
