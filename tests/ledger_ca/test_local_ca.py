"""The local CA: what it certifies, what it refuses, and what survives."""

from __future__ import annotations

import multiprocessing
import sqlite3
import stat
from datetime import timedelta

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from cryptography.x509.oid import ExtendedKeyUsageOID, ExtensionOID

from wonderland_fabric_gateway.ca import (
    AlreadyEnrolledError,
    CaBusyError,
    CaCorruptError,
    CaError,
    CaExistsError,
    CaNotFoundError,
    CaRequestError,
    Kind,
    LocalCa,
    UnknownCertificateError,
)
from wonderland_fabric_gateway.ca.register import open_register
from wonderland_fabric_gateway.identity import Identity
from wonderland_fabric_gateway.signing import key_file_signer, verify

PAD = {"pol.role": "pad", "pol.id": "pad-1"}


def root_of(ca: LocalCa, kind: Kind = Kind.IDENTITY) -> x509.Certificate:
    return x509.load_pem_x509_certificate(ca.root_pem(kind))


def crl_of(ca: LocalCa, kind: Kind = Kind.IDENTITY) -> x509.CertificateRevocationList:
    return x509.load_pem_x509_crl(ca.revocation_list_pem(kind))


def ski(certificate: x509.Certificate) -> bytes:
    return certificate.extensions.get_extension_for_class(x509.SubjectKeyIdentifier).value.digest


def test_an_enrolled_identity_is_what_fabric_expects(ca):
    enrolment = ca.enrol("pad-one", attributes=PAD)
    identity = enrolment.identity
    assert (identity.common_name, identity.node_ou, identity.role, identity.pol_id) == (
        "pad-one",
        "client",
        "pad",
        "pad-1",
    )
    assert identity.attributes == PAD
    certificate, root = identity.certificate, root_of(ca)
    certificate.verify_directly_issued_by(root)
    raw = certificate.extensions.get_extension_for_oid(x509.ObjectIdentifier("1.2.3.4.5.6.7.8.1")).value
    assert raw.value == b'{"attrs":{"pol.role":"pad","pol.id":"pad-1"}}'
    authority_key = certificate.extensions.get_extension_for_class(x509.AuthorityKeyIdentifier).value
    assert authority_key.key_identifier == ski(root)
    usage = certificate.extensions.get_extension_for_class(x509.KeyUsage)
    assert usage.critical
    assert usage.value.digital_signature
    assert not usage.value.key_cert_sign
    assert certificate.extensions.get_extension_for_class(x509.BasicConstraints).value.ca is False
    assert 0 < certificate.serial_number < 1 << 160


def test_the_root_may_sign_certificates_and_lists_and_no_further_ca(ca):
    root = root_of(ca)
    constraints = root.extensions.get_extension_for_class(x509.BasicConstraints)
    assert constraints.critical
    assert constraints.value.ca
    assert constraints.value.path_length == 0
    usage = root.extensions.get_extension_for_class(x509.KeyUsage).value
    assert usage.key_cert_sign
    assert usage.crl_sign
    assert isinstance(root.public_key().curve, ec.SECP256R1)
    assert root_of(ca, Kind.TLS).public_key() != root.public_key()


def test_the_key_belongs_to_the_certificate_and_signs(ca, tmp_path):
    enrolment = ca.enrol("pad-one")
    certificate, key = enrolment.write(tmp_path / "identities")
    identity = Identity.from_file("PadMSP", certificate)
    verify(identity.public_key, b"message", key_file_signer(key)(b"message"))


def test_files_are_private(ca, tmp_path):
    _, key = ca.enrol("pad-one").write(tmp_path / "identities")
    private = [key, *(ca.directory / name for name in ("ca.key", "tls-ca.key", "register.db", "ca.json"))]
    assert {stat.S_IMODE(path.stat().st_mode) for path in private} == {0o600}
    assert stat.S_IMODE(ca.directory.stat().st_mode) == 0o700
    assert stat.S_IMODE((tmp_path / "identities").stat().st_mode) == 0o700


def test_a_tls_certificate_names_its_hosts(ca):
    enrolment = ca.enrol("gateway", kind=Kind.TLS, hosts=["localhost", "127.0.0.1", "::1", "*.pads.example"])
    certificate = enrolment.identity.certificate
    certificate.verify_directly_issued_by(root_of(ca, Kind.TLS))
    names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["localhost", "*.pads.example"]
    assert [str(each) for each in names.get_values_for_type(x509.IPAddress)] == ["127.0.0.1", "::1"]
    purposes = certificate.extensions.get_extension_for_oid(ExtensionOID.EXTENDED_KEY_USAGE).value
    assert set(purposes) == {ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH}


def test_a_key_made_elsewhere_is_certified_and_never_seen(ca, tmp_path):
    key = ec.generate_private_key(ec.SECP256R1())
    enrolment = ca.enrol("hsm", public_key=key.public_key())
    assert enrolment.private_key_pem is None
    assert enrolment.identity.public_key == key.public_key()
    with pytest.raises(CaRequestError, match="made elsewhere"):
        enrolment.write(tmp_path)


def test_another_curve_is_refused(ca):
    with pytest.raises(CaRequestError, match="P-256"):
        ca.enrol("hsm", public_key=ec.generate_private_key(ec.SECP384R1()).public_key())


def test_validity_begins_a_little_in_the_past_and_ends_with_the_root(ca, clock):
    certificate = ca.enrol("one").identity.certificate
    assert certificate.not_valid_after_utc - clock.moment.replace(microsecond=0) == timedelta(days=365)
    clock.advance(days=15 * 365 - 10)
    late = ca.enrol("two").identity.certificate
    assert late.not_valid_after_utc == root_of(ca).not_valid_after_utc
    clock.advance(days=11)
    with pytest.raises(CaRequestError, match="expired"):
        ca.enrol("three")


def test_the_same_randomness_gives_the_same_certificates(tmp_path, clock, random_bytes):
    first = LocalCa.create(tmp_path / "a", "PadMSP", now=clock, random_bytes=random_bytes).enrol("x")
    second = LocalCa.create(tmp_path / "b", "PadMSP", now=clock, random_bytes=type(random_bytes)()).enrol("x")
    assert first.private_key_pem == second.private_key_pem
    assert first.certificate.serial == second.certificate.serial


def test_a_name_is_enrolled_once(ca, clock):
    ca.enrol("pad-one", validity=timedelta(hours=1))
    with pytest.raises(AlreadyEnrolledError, match="renew"):
        ca.enrol("pad-one")
    ca.enrol("pad-one", kind=Kind.TLS)  # another kind is another matter
    clock.advance(hours=2)
    ca.enrol("pad-one")


def test_renewal_keeps_what_the_name_is_and_leaves_the_old_certificate(ca, clock):
    old = ca.enrol("pad-one", attributes=PAD, hosts=["pad.example"]).certificate
    clock.advance(days=300)
    new = ca.renew("pad-one").certificate
    assert (new.attributes, new.hosts, new.node_ou) == (old.attributes, old.hosts, old.node_ou)
    assert new.serial != old.serial
    assert new.not_after_ms > old.not_after_ms
    assert [each.revoked_ms for each in ca.certificates("pad-one")] == [None, None]
    assert list(crl_of(ca)) == []


def test_renewal_can_change_attributes_and_revoke_the_old_one(ca):
    old = ca.enrol("pad-one", attributes=PAD).certificate
    new = ca.renew("pad-one", attributes={**PAD, "pol.id": "pad-2"}, revoke_old=True)
    assert new.identity.pol_id == "pad-2"
    assert [f"{line.serial_number:x}" for line in crl_of(ca)] == [old.serial]


def test_renewal_needs_something_to_renew(ca):
    with pytest.raises(UnknownCertificateError, match="never enrolled"):
        ca.renew("nobody")
    ca.enrol("pad-one")
    ca.revoke(name="pad-one")
    with pytest.raises(UnknownCertificateError, match="revoked"):
        ca.renew("pad-one")
    assert ca.enrol("pad-one").certificate.revoked_ms is None


def test_revocation_makes_a_list_that_fabric_heeds(ca, clock):
    old = ca.enrol("pad-one").certificate
    new = ca.renew("pad-one").certificate
    other = ca.enrol("pad-two").certificate
    revoked = ca.revoke(name="pad-one", reason="keyCompromise")
    assert {each.serial for each in revoked} == {old.serial, new.serial}
    assert all(each.revoked_ms == int(clock.moment.replace(microsecond=0).timestamp() * 1000) for each in revoked)
    crl, root = crl_of(ca), root_of(ca)
    assert crl.is_signature_valid(root.public_key())
    assert crl.issuer == root.subject
    # Without this extension Fabric accepts the list and then refuses every identity of the organisation.
    assert crl.extensions.get_extension_for_class(x509.AuthorityKeyIdentifier).value.key_identifier == ski(root)
    assert crl.next_update_utc > clock.moment
    assert {f"{line.serial_number:x}" for line in crl} == {old.serial, new.serial}
    assert other.serial not in {f"{line.serial_number:x}" for line in crl}
    reasons = {line.extensions.get_extension_for_class(x509.CRLReason).value.reason for line in crl}
    assert reasons == {x509.ReasonFlags.key_compromise}


def test_each_list_has_a_higher_number(ca):
    numbers = []
    for name in ("a", "b", "c"):
        ca.enrol(name)
        ca.revoke(name=name)
        numbers.append(crl_of(ca).extensions.get_extension_for_class(x509.CRLNumber).value.crl_number)
    assert numbers == [1, 2, 3]
    assert len(list(crl_of(ca))) == 3


def test_a_list_is_renewed_before_it_runs_out(ca, clock):
    ca.enrol("a")
    ca.revoke(name="a")
    first = ca.revocation_list_pem()
    clock.advance(days=10)
    assert ca.revocation_list_pem() == first
    clock.advance(days=10)
    assert ca.revocation_list_pem() != first
    assert len(list(crl_of(ca))) == 1


def test_an_expired_certificate_stays_on_the_list(ca, clock):
    ca.enrol("a", validity=timedelta(days=1))
    ca.revoke(name="a")
    clock.advance(days=100)
    assert len(list(crl_of(ca))) == 1


def test_revocation_by_serial_number_in_any_spelling(ca):
    certificate = ca.enrol("a").certificate
    spelled = ":".join(certificate.serial.upper().zfill(40)[i : i + 2] for i in range(0, 40, 2))
    assert ca.revoke(serial=spelled)[0].serial == certificate.serial
    with pytest.raises(UnknownCertificateError, match="already"):
        ca.revoke(serial=certificate.serial)


def test_tls_has_its_own_list(ca):
    ca.enrol("a", kind=Kind.TLS)
    ca.revoke(name="a", kind=Kind.TLS)
    assert len(list(crl_of(ca, Kind.TLS))) == 1
    assert list(crl_of(ca)) == []
    assert crl_of(ca, Kind.TLS).is_signature_valid(root_of(ca, Kind.TLS).public_key())


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        ({"name": ""}, "name"),
        ({"name": "a/b"}, "name"),
        ({"name": "../up"}, "name"),
        ({"name": "x" * 65}, "name"),
        ({"name": "a\nb"}, "name"),
        ({"name": "a", "node_ou": "boss"}, "node OU"),
        ({"name": "a", "validity": timedelta(0)}, "lifetime"),
        ({"name": "a", "validity": timedelta(days=100_000)}, "lifetime"),
        ({"name": "a", "attributes": {"x": "y" * 20_000}}, "attributes"),
        ({"name": "a", "attributes": {"x": 1}}, "not text"),
        ({"name": "a", "attributes": {"x": "\ud800"}}, "Unicode"),
        ({"name": "a", "attributes": {str(i): "" for i in range(65)}}, "65 attributes"),
        ({"name": "a", "hosts": ["a b"]}, "host"),
        ({"name": "a", "hosts": ["-a.example"]}, "host"),
        ({"name": "a", "hosts": [""]}, "host"),
        ({"name": "a", "hosts": ["h"] * 101}, "101 hosts"),
        ({"name": "a", "kind": Kind.TLS, "attributes": PAD}, "TLS"),
    ],
)
def test_what_cannot_be_certified_is_refused_and_not_recorded(ca, request_, words):
    with pytest.raises(CaRequestError, match=words):
        ca.enrol(**request_)
    assert ca.certificates() == ()


def test_what_cannot_be_revoked_is_refused(ca):
    with pytest.raises(CaRequestError, match="reason"):
        ca.revoke(name="a", reason="boredom")
    with pytest.raises(CaRequestError, match="either"):
        ca.revoke()
    with pytest.raises(CaRequestError, match="hexadecimal"):
        ca.revoke(serial="xyz")
    with pytest.raises(UnknownCertificateError):
        ca.revoke(serial="abc")
    with pytest.raises(UnknownCertificateError):
        ca.revoke(name="a")


def test_it_is_there_again_after_opening(ca, clock, random_bytes):
    ca.enrol("pad-one", attributes=PAD)
    ca.revoke(name="pad-one")
    again = LocalCa.open(ca.directory, now=clock, random_bytes=random_bytes)
    assert again.msp_id == "PadMSP"
    assert again.certificates() == ca.certificates()
    assert again.revocation_list_pem() == ca.revocation_list_pem()
    again.enrol("pad-one").identity.certificate.verify_directly_issued_by(root_of(ca))


def test_a_second_ca_in_the_same_place_is_refused(ca):
    root = ca.root_pem()
    with pytest.raises(CaExistsError):
        LocalCa.create(ca.directory, "OtherMSP")
    assert LocalCa.open(ca.directory).root_pem() == root
    assert [path.name for path in ca.directory.parent.iterdir()] == ["ca"]  # nothing half made is left


def test_an_empty_directory_is_taken(tmp_path):
    (tmp_path / "ca").mkdir()
    assert LocalCa.create(tmp_path / "ca", "PadMSP").msp_id == "PadMSP"


def test_a_file_in_the_way_is_said(tmp_path):
    (tmp_path / "ca").write_text("")
    with pytest.raises(CaExistsError):
        LocalCa.create(tmp_path / "ca", "PadMSP")


@pytest.mark.parametrize("msp_id", ["", "1st", "a b", "x" * 65])
def test_an_msp_id_that_is_none(tmp_path, msp_id):
    with pytest.raises(CaRequestError, match="MSP id"):
        LocalCa.create(tmp_path / "ca", msp_id)


def test_no_ca_is_said(tmp_path):
    with pytest.raises(CaNotFoundError):
        LocalCa.open(tmp_path)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("ca.json", b"{"),
        ("ca.json", b'{"msp_id": 3}'),
        ("ca.json", b"[]"),
        ("ca.key", b"garbage"),
        ("tls-ca.pem", b"garbage"),
        ("ca.key", None),
        ("register.db", None),
    ],
)
def test_damage_is_said(ca, name, content):
    path = ca.directory / name
    path.unlink()
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(CaCorruptError):
        LocalCa.open(ca.directory)


def test_a_foreign_key_is_noticed(ca):
    (ca.directory / "ca.key").write_bytes((ca.directory / "tls-ca.key").read_bytes())
    with pytest.raises(CaCorruptError, match="not the key"):
        LocalCa.open(ca.directory)


def test_a_damaged_register_is_said(ca):
    (ca.directory / "register.db").write_bytes(b"no database at all, sorry" * 100)
    with pytest.raises(CaCorruptError):
        ca.certificates()


def test_a_damaged_row_is_said(ca):
    ca.enrol("a")
    with sqlite3.connect(ca.directory / "register.db") as database:
        database.execute("UPDATE certificates SET attributes = '{'")
    database.close()
    with pytest.raises(CaCorruptError):
        ca.certificates()


def test_two_processes_take_turns(ca):
    with (
        open_register(ca.directory / "register.db", write=True),
        pytest.raises(CaBusyError),
        open_register(ca.directory / "register.db", write=True, timeout_s=0.05),
    ):
        pass
    ca.enrol("a")


def enrol_some(directory, prefix):
    ca = LocalCa.open(directory)
    for number in range(5):
        ca.enrol(f"{prefix}{number}")


def test_two_processes_at_once_lose_nothing(ca):
    context = multiprocessing.get_context("spawn")
    processes = [context.Process(target=enrol_some, args=(ca.directory, prefix)) for prefix in "ab"]
    for process in processes:
        process.start()
    for process in processes:
        process.join(30)
    assert [process.exitcode for process in processes] == [0, 0]
    assert {each.name for each in ca.certificates()} == {f"{prefix}{number}" for prefix in "ab" for number in range(5)}


def test_nothing_is_recorded_when_the_work_fails(ca):
    with pytest.raises(CaError), open_register(ca.directory / "register.db", write=True) as register:
        register.revoke("ff", 1, "x")
        raise CaError
    key = load_pem_private_key(ca.enrol("a").private_key_pem, None)
    assert isinstance(key, ec.EllipticCurvePrivateKey)
