"""Keys in a hardware module: the URI that names them, and signing on SoftHSM."""

import contextlib
import datetime as dt
import os
import shutil
import subprocess
import threading
from pathlib import Path

import pytest
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland.enrolment.machine import Place, make_request
from wonderland_fabric_gateway.ca.requests import CertificateRequest
from wonderland_fabric_gateway.errors import SignatureError
from wonderland_fabric_gateway.hsm import HsmKey
from wonderland_fabric_gateway.signing import key_file_signer, private_key, verify

MODULES = [Path("/usr/lib/softhsm/libsofthsm2.so"), Path("/usr/lib64/libsofthsm2.so")]
PIN = "271828"


def test_a_uri_is_read():
    key = HsmKey.parse("pkcs11:token=my%20token;object=pad-7;id=%01%ff?module-path=/lib/x.so&pin-source=file:/etc/pin")
    assert key == HsmKey(Path("/lib/x.so"), "my token", "pad-7", b"\x01\xff", Path("/etc/pin"))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("file:/x", "a PKCS#11 URI looks like"),
        ("pkcs11:object=k?module-path=/m&pin-source=/p", "has no token"),
        ("pkcs11:token=t?module-path=/m&pin-source=/p", "names no key"),
        ("pkcs11:token=t;object=k?module-path=/m", "has no pin-source"),
        ("pkcs11:token=t;object=k?module-path=/m&pin-value=1234", "a PIN has no place"),
        ("pkcs11:token=t;token=u;object=k?module-path=/m&pin-source=/p", "'token' twice"),
        ("pkcs11:token;object=k?module-path=/m&pin-source=/p", "'token' without a value"),
        ("pkcs11:token=t;objct=k?module-path=/m&pin-source=/p", "unknown attribute 'objct'"),
        ("pkcs11:token=t;object=k?module-path=m.so&pin-source=/p", "absolute paths"),
        ("pkcs11:token=%ff;object=k?module-path=/m&pin-source=/p", "token of the PKCS#11 URI is no text"),
    ],
)
def test_what_is_wrong_with_a_uri_is_said(text, says):
    with pytest.raises(SignatureError) as raised:
        HsmKey.parse(text)
    assert says in str(raised.value)
    assert "1234" not in str(raised.value)


@settings(deadline=None, max_examples=150)
@given(st.text(max_size=120))
def test_any_text_is_a_uri_or_a_typed_error(text):
    with contextlib.suppress(SignatureError):
        HsmKey.parse("pkcs11:" + text)


def test_without_the_extra_the_error_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pkcs11", None)
    (tmp_path / "pin").write_text(PIN)
    (tmp_path / "key").write_text(f"pkcs11:token=t;object=k?module-path=/m.so&pin-source=file:{tmp_path}/pin\n")
    with pytest.raises(SignatureError, match=r"key: keys in a hardware module need the extra hsm"):
        key_file_signer(tmp_path / "key")


@pytest.fixture(scope="module")
def token(tmp_path_factory):
    """A SoftHSM token with a P-256 key: (key file, the key itself, its directory)."""
    pytest.importorskip("pkcs11", reason="the extra hsm is not installed")
    module = next((each for each in MODULES if each.exists()), None)
    if module is None or not shutil.which("softhsm2-util"):
        pytest.skip("SoftHSM is not installed (Debian: softhsm2)")
    path = tmp_path_factory.mktemp("softhsm")
    (path / "tokens").mkdir()
    (path / "softhsm2.conf").write_text(f"directories.tokendir = {path}/tokens\nobjectstore.backend = file\n")
    os.environ["SOFTHSM2_CONF"] = str(path / "softhsm2.conf")

    def run(*arguments):
        subprocess.run(["softhsm2-util", *arguments], check=True, capture_output=True, timeout=60)

    key = ec.generate_private_key(ec.SECP256R1())
    (path / "plain.pem").write_bytes(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
    run("--init-token", "--free", "--label", "wonderland", "--so-pin", "314159", "--pin", PIN)
    run("--import", str(path / "plain.pem"), "--token", "wonderland", "--label", "pad-7", "--id", "07", "--pin", PIN)
    run("--init-token", "--free", "--label", "locked", "--so-pin", "314159", "--pin", PIN)
    (path / "pin").write_text(f"{PIN}\n")
    (path / "pad-7.key").write_text(_uri(module, path / "pin"))
    yield path, key, module
    del os.environ["SOFTHSM2_CONF"]


def _uri(module, pin, name="pad-7", token="wonderland"):
    return f"pkcs11:token={token};object={name}?module-path={module}&pin-source=file:{pin}\n"


def test_signatures_are_of_the_modules_key_and_low_s(token):
    path, key, _ = token
    sign = key_file_signer(path / "pad-7.key")
    for number in range(20):  # half of all signatures would be high-S
        verify(key.public_key(), b"message %d" % number, sign(b"message %d" % number))


def test_several_threads_sign_at_once(token):
    path, key, _ = token
    sign = key_file_signer(path / "pad-7.key")
    signatures = []
    threads = [threading.Thread(target=lambda: signatures.append(sign(b"same"))) for _ in range(8)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    for signature in signatures:
        verify(key.public_key(), b"same", signature)
    assert len(signatures) == 8


@pytest.mark.parametrize(
    ("name", "in_token", "pin", "says"),
    [
        ("pad-8", "wonderland", PIN, "there is no single key 'pad-8' on it"),
        ("pad-7", "elsewhere", PIN, "token 'elsewhere': cannot be used by"),
        ("pad-7", "locked", "000000", "is wrong; a token locks itself"),
    ],
)
def test_what_is_wrong_is_said_and_no_pin_with_it(token, tmp_path, name, in_token, pin, says):
    (tmp_path / "pin").write_text(pin)
    (tmp_path / "key").write_text(_uri(token[2], tmp_path / "pin", name, in_token))
    with pytest.raises(SignatureError) as raised:
        key_file_signer(tmp_path / "key")
    assert says in str(raised.value)
    assert pin not in str(raised.value)


def test_a_module_that_is_not_there_is_said(token, tmp_path):
    (tmp_path / "key").write_text(_uri("/nowhere/lib.so", token[0] / "pin"))
    with pytest.raises(SignatureError, match=r"cannot be used by /nowhere/lib.so"):
        key_file_signer(tmp_path / "key")


def test_a_request_for_a_certificate_is_signed_in_the_module_and_the_key_never_leaves_it(token, tmp_path):
    path, key, _ = token
    made = CertificateRequest.of_key_file("pad-7", path / "pad-7.key")
    found = CertificateRequest.parse(made.pem)
    assert (found.name, found.public_key) == ("pad-7", key.public_key())
    place = Place(tmp_path / "identity")
    now = dt.datetime.now(dt.UTC)
    asked = make_request(place, "pad-7", "pad", "pad-7", key=path / "pad-7.key", now=now, random_bytes=os.urandom)
    assert CertificateRequest.parse(asked.request).public_key == key.public_key()
    assert place.key("pad-7").read_bytes().startswith(b"pkcs11:")
    inside = private_key(path / "pad-7.key")
    for reading in (
        inside.private_numbers,
        lambda: inside.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()),
        lambda: inside.exchange(ec.ECDH(), key.public_key()),
    ):
        with pytest.raises(SignatureError):
            reading()
    with pytest.raises(SignatureError, match="SHA-256 only"):
        inside.sign(b"x", ec.ECDSA(hashes.SHA384()))
