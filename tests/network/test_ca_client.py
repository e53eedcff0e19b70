"""The client of Fabric CA against a scripted server: what it sends, and what it makes of every kind of answer."""

import base64
import datetime as dt
import json

import httpx
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland_fabric_gateway.ca import CertificateRequest, Kind, LocalCa
from wonderland_fabric_gateway.ca import client as module
from wonderland_fabric_gateway.ca.client import (
    FabricCaAnswerError,
    FabricCaClient,
    FabricCaError,
    FabricCaUnreachableError,
    token,
)
from wonderland_fabric_gateway.ca.errors import CaError
from wonderland_fabric_gateway.identity import SigningIdentity
from wonderland_fabric_gateway.signing import key_file_signer, verify


@pytest.fixture(scope="module")
def ca(tmp_path_factory):
    return LocalCa.create(tmp_path_factory.mktemp("ca") / "ca", "PadMSP")


@pytest.fixture(scope="module")
def registrar(ca, tmp_path_factory):
    path = tmp_path_factory.mktemp("registrar")
    enrolment = ca.enrol("registrar")
    enrolment.write(path, "registrar")
    return SigningIdentity(enrolment.identity, key_file_signer(path / "registrar.key"))


class Server:
    """Answers what it is told to, and remembers what it was asked."""

    def __init__(self, ca):
        self.ca = ca
        self.requests = []
        self.answer = (200, {"success": True, "result": {}, "errors": []})

    def client(self):
        async def handle(request):
            self.requests.append(request)
            status, body = self.answer if not callable(self.answer) else self.answer(request)
            return httpx.Response(status, content=body if isinstance(body, bytes) else json.dumps(body).encode())

        root = self.ca.root_pem(Kind.TLS)
        return FabricCaClient("ca.example.org:7054", "ca-pad", root, transport=httpx.MockTransport(handle))

    def says(self, result):
        self.answer = (200, {"success": True, "result": result, "errors": []})

    @property
    def last(self):
        return self.requests[-1], json.loads(self.requests[-1].content or b"null")


@pytest.fixture
def server(ca):
    return Server(ca)


def _certificate(ca, csr_pem, name=None):
    """What a CA makes of a request."""
    request = x509.load_pem_x509_csr(csr_pem.encode())
    key = ec.generate_private_key(ec.SECP256R1())
    subject = request.subject if name is None else x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, name)])
    now = dt.datetime.now(dt.UTC)
    builder = x509.CertificateBuilder().subject_name(subject).issuer_name(subject).public_key(request.public_key())
    builder = builder.serial_number(7).not_valid_before(now).not_valid_after(now + dt.timedelta(days=1))
    return builder.sign(key, hashes.SHA256()).public_bytes(Encoding.PEM)


def _encoded(data):
    return base64.b64encode(data).decode()


async def test_enrolling_sends_a_request_for_exactly_that_name_and_those_hosts(server, ca):
    key = ec.generate_private_key(ec.SECP256R1())

    def answer(request):
        body = json.loads(request.content)
        cert = _certificate(ca, body["certificate_request"])
        return 201, {"success": True, "result": {"Cert": _encoded(cert)}, "errors": []}

    server.answer = answer
    async with server.client() as client:
        pem = await client.enrol("peer0", "secret", key, profile="tls", hosts=["localhost", "127.0.0.1", "::1"])
    assert x509.load_pem_x509_certificate(pem).public_key() == key.public_key()
    request, body = server.last
    assert request.url.path == "/api/v1/enroll"
    assert request.headers["authorization"] == "Basic " + _encoded(b"peer0:secret")
    assert (body["caname"], body["profile"]) == ("ca-pad", "tls")
    csr = x509.load_pem_x509_csr(body["certificate_request"].encode())
    assert csr.subject.rfc4514_string() == "CN=peer0"
    names = csr.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["localhost"]
    assert [str(each) for each in names.get_values_for_type(x509.IPAddress)] == ["127.0.0.1", "::1"]


@pytest.mark.parametrize("wrong", ["key", "name"])
async def test_a_certificate_for_somebody_else_is_refused(server, ca, wrong):
    key, other = (ec.generate_private_key(ec.SECP256R1()) for _ in range(2))

    def answer(request):
        csr = json.loads(request.content)["certificate_request"]
        if wrong == "key":
            csr = module._enrolment("peer0", other, "", ())["certificate_request"]
        cert = _certificate(ca, csr, name="peer9" if wrong == "name" else None)
        return 201, {"success": True, "result": {"Cert": _encoded(cert)}, "errors": []}

    server.answer = answer
    async with server.client() as client:
        with pytest.raises(FabricCaAnswerError, match="not for peer0 and its key"):
            await client.enrol("peer0", "secret", key)


async def test_a_token_is_a_low_s_signature_over_method_path_body_and_certificate(server, registrar):
    async with server.client() as client:
        await client.register(registrar, "pad-7", node_ou="client", secret="s", attributes={"pol.role": "pad"})
    request, body = server.last
    certificate, _, signature = request.headers["authorization"].partition(".")
    assert base64.b64decode(certificate) == registrar.identity.certificate_pem
    path, content = _encoded(b"/api/v1/register"), _encoded(request.content)
    message = f"POST.{path}.{content}.{certificate}".encode()
    verify(registrar.identity.public_key, message, base64.b64decode(signature))  # refuses high-S
    assert body["attrs"] == [{"name": "pol.role", "value": "pad", "ecert": True}]
    assert (body["id"], body["type"], body["affiliation"]) == ("pad-7", "client", "")


def test_every_token_is_low_s(registrar):
    for number in range(30):
        certificate, _, signature = token(registrar, "GET", f"/{number}", b"").partition(".")
        message = f"GET.{_encoded(f'/{number}'.encode())}..{certificate}".encode()
        verify(registrar.identity.public_key, message, base64.b64decode(signature))


async def test_one_certificate_is_revoked_by_serial_and_authority(server, registrar):
    server.says({"RevokedCerts": [{"Serial": "AB", "AKI": "CD"}]})
    certificate = registrar.identity.certificate
    async with server.client() as client:
        revoked = await client.revoke(registrar, certificate=certificate, reason="keyCompromise")
    _, body = server.last
    assert body["serial"] == f"{certificate.serial_number:x}"
    assert body["aki"] == module.authority_key_id(certificate)
    assert body["reason"] == "keycompromise"
    assert "id" not in body
    assert [(each.serial, each.authority_key_id) for each in revoked] == [("ab", "cd")]


async def test_lists_and_info_are_read(server, registrar, ca):
    pem = registrar.identity.certificate_pem
    async with server.client() as client:
        server.says({"certs": [{"PEM": pem.decode()}]})
        (listed,) = await client.certificates(registrar, "registrar")
        assert listed.certificate == registrar.identity.certificate
        assert server.last[0].url.query == b"ca=ca-pad&id=registrar"
        server.says({"CRL": _encoded(ca.revocation_list_pem())})
        assert await client.revocation_list(registrar) == ca.revocation_list_pem()
        server.says({"CAName": "ca-pad", "CAChain": _encoded(b"chain"), "Version": "1.5.15"})
        info = await client.info()
        assert (info.name, info.chain_pem, info.version) == ("ca-pad", b"chain", "1.5.15")


async def test_a_refusal_has_code_and_hint(server, registrar):
    server.answer = (401, {"success": False, "errors": [{"code": 20, "message": "Authentication failure"}]})
    async with server.client() as client:
        with pytest.raises(FabricCaError, match="not \\(or no longer\\) one that this CA accepts") as raised:
            await client.revocation_list(registrar)
    assert (raised.value.status, raised.value.code) == (401, 20)


@pytest.mark.parametrize(
    "answer",
    [
        (200, b"<html>"),
        (200, b""),
        (200, []),
        (200, {"success": True}),
        (200, {"success": True, "result": []}),
        (500, {"success": False, "errors": "no"}),
        (500, {"success": False, "errors": [None]}),
        (200, {"success": True, "result": {"CRL": 5}}),
        (200, {"success": True, "result": {"CRL": "not base64!"}}),
        (200, b"[" * 100_000),
    ],
)
async def test_whatever_else_answers_is_a_typed_error(server, registrar, answer):
    server.answer = answer
    async with server.client() as client:
        with pytest.raises((FabricCaAnswerError, FabricCaError)):
            await client.revocation_list(registrar)


async def test_an_endless_answer_is_cut_off(server, registrar, monkeypatch):
    monkeypatch.setattr(module, "MAX_ANSWER_BYTES", 1000)
    server.answer = (200, b" " * 2000)
    async with server.client() as client:
        with pytest.raises(FabricCaAnswerError, match="larger than 1000 bytes"):
            await client.revocation_list(registrar)


async def test_nobody_there_is_said(ca, registrar):
    async with FabricCaClient("127.0.0.1:1", "ca-pad", ca.root_pem(Kind.TLS), timeout_s=2) as client:
        with pytest.raises(FabricCaUnreachableError, match="does it run"):
            await client.revocation_list(registrar)


def test_a_root_that_is_none_is_said():
    with pytest.raises(FabricCaUnreachableError, match="no PEM certificate"):
        FabricCaClient("ca:1", "ca", b"rubbish")


_json = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=10),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["success", "result", "errors", "certs", "PEM", "RevokedCerts"]), inner, max_size=3
        )
    ),
    max_leaves=6,
)


@settings(deadline=None, max_examples=60)
@given(_json, st.sampled_from([200, 401, 500]))
async def test_any_json_is_an_answer_or_a_typed_error(ca, registrar, body, status):
    server = Server(ca)
    server.answer = (status, body)
    async with server.client() as client:
        for call in (client.certificates(registrar), client.revoke(registrar, name="x"), client.info()):
            try:
                await call
            except CaError:
                continue


@pytest.mark.parametrize("said", ["Wed, 21 Oct 2026 07:28:00 GMT", "Wed, 21 Oct 2026 07:28:00 -0000"])
async def test_the_servers_time_is_read(ca, said):
    result = {"CAName": "ca-pad", "CAChain": _encoded(b"pem"), "Version": "1.5"}

    async def handle(_request):
        return httpx.Response(200, headers={"date": said}, json={"success": True, "result": result, "errors": []})

    root = ca.root_pem(Kind.TLS)
    async with FabricCaClient("ca.example.org:7054", "c", root, transport=httpx.MockTransport(handle)) as client:
        assert (await client.info()).now == dt.datetime(2026, 10, 21, 7, 28, tzinfo=dt.UTC)


@pytest.mark.parametrize("said", [None, "yesterday", "Wed, 99 Oct 2026 07:28:00 GMT"])
async def test_a_server_without_a_time_is_borne(ca, said):
    result = {"CAName": "ca-pad", "CAChain": _encoded(b"pem"), "Version": "1.5"}

    async def handle(_request):
        headers = {} if said is None else {"date": said}
        return httpx.Response(200, headers=headers, json={"success": True, "result": result, "errors": []})

    root = ca.root_pem(Kind.TLS)
    async with FabricCaClient("ca.example.org:7054", "c", root, transport=httpx.MockTransport(handle)) as client:
        assert (await client.info()).now is None


async def test_a_request_that_somebody_made_elsewhere_is_passed_on_as_it_is(server, ca):
    key = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "anna")])
    signed = x509.CertificateSigningRequestBuilder().subject_name(subject).sign(key, hashes.SHA256())
    asked = CertificateRequest.parse(signed.public_bytes(Encoding.PEM).decode())

    def answer(request):
        body = json.loads(request.content)
        pem = _certificate(ca, body["certificate_request"])
        return 201, {"success": True, "result": {"Cert": base64.b64encode(pem).decode()}, "errors": []}

    server.answer = answer
    async with server.client() as client:
        pem = await client.enrol_request(asked, "one-time")
        assert x509.load_pem_x509_certificate(pem).public_key() == key.public_key()
        sent, body = server.last
        assert sent.url.path == "/api/v1/enroll"
        assert body["certificate_request"] == asked.pem
        assert sent.headers["authorization"] == "Basic " + base64.b64encode(b"anna:one-time").decode()
        other = ec.generate_private_key(ec.SECP256R1())
        swapped = x509.CertificateSigningRequestBuilder().subject_name(subject).sign(other, hashes.SHA256())
        server.answer = lambda _: answer(
            httpx.Request(
                "POST",
                "https://x",
                json={"certificate_request": swapped.public_bytes(Encoding.PEM).decode()},
            )
        )
        with pytest.raises(FabricCaAnswerError):
            await client.enrol_request(asked, "one-time")
