"""Invitations: one secret, one certificate, for a key that the CA never sees."""

from __future__ import annotations

import base64
from datetime import timedelta

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.oid import NameOID

from wonderland_fabric_gateway.ca import (
    AlreadyEnrolledError,
    CertificateRequest,
    Invitations,
    NotInvitedError,
)
from wonderland_fabric_gateway.ca.errors import CaRequestError
from wonderland_fabric_gateway.ca.invitations import INVITATION_VALIDITY, MAX_FAILURES


@pytest.fixture
def invitations(ca, clock, random_bytes):
    return Invitations(ca, now=clock, random_bytes=random_bytes)


def request(name="anna", key=None, **more):
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, each) for each in (name, *more.get("names", ()))])
    builder = x509.CertificateSigningRequestBuilder().subject_name(subject)
    signed = builder.sign(key or ec.generate_private_key(ec.SECP256R1()), hashes.SHA256())
    return signed.public_bytes(Encoding.PEM).decode()


def test_the_secret_buys_one_certificate_for_the_requests_key(ca, invitations):
    key = ec.generate_private_key(ec.SECP256R1())
    secret = invitations.invite("anna", {"pol.role": "pad_operator", "pol.id": "anna"})
    enrolment = invitations.enrol(CertificateRequest.parse(request(key=key)), secret)
    assert enrolment.private_key_pem is None
    assert enrolment.identity.certificate.public_key() == key.public_key()
    assert (enrolment.identity.role, enrolment.identity.pol_id, enrolment.identity.node_ou) == (
        "pad_operator",
        "anna",
        "client",
    )
    with pytest.raises(NotInvitedError):
        invitations.enrol(CertificateRequest.parse(request()), secret)
    assert len(ca.certificates("anna")) == 1


def test_the_secret_is_kept_nowhere(ca, invitations):
    secret = invitations.invite("anna", {})
    assert secret.encode() not in (ca.directory / "register.db").read_bytes()


def test_a_wrong_secret_and_a_wrong_name_are_refused_alike(invitations):
    invitations.invite("anna", {})
    texts = set()
    for name in ("anna", "berta"):
        with pytest.raises(NotInvitedError) as refused:
            invitations.enrol(CertificateRequest.parse(request(name)), "guess")
        texts.add(str(refused.value).replace(name, "…"))
    assert len(texts) == 1


def test_guessing_ends_the_invitation(invitations):
    secret = invitations.invite("anna", {})
    for _ in range(MAX_FAILURES):
        with pytest.raises(NotInvitedError):
            invitations.enrol(CertificateRequest.parse(request()), "guess")
    with pytest.raises(NotInvitedError):
        invitations.enrol(CertificateRequest.parse(request()), secret)
    fresh = invitations.invite("anna", {})
    assert invitations.enrol(CertificateRequest.parse(request()), fresh).certificate.name == "anna"


def test_an_invitation_is_not_good_for_ever(invitations, clock):
    secret = invitations.invite("anna", {})
    clock.moment += INVITATION_VALIDITY
    with pytest.raises(NotInvitedError):
        invitations.enrol(CertificateRequest.parse(request()), secret)


def test_a_later_invitation_replaces_the_first(invitations):
    first = invitations.invite("anna", {"pol.role": "admin"})
    second = invitations.invite("anna", {"pol.role": "inspector"}, validity=timedelta(days=2))
    with pytest.raises(NotInvitedError):
        invitations.enrol(CertificateRequest.parse(request()), first)
    enrolment = invitations.enrol(CertificateRequest.parse(request()), second)
    assert enrolment.identity.role == "inspector"
    assert enrolment.certificate.not_after_ms - enrolment.certificate.not_before_ms < 3 * 86_400_000


def test_who_holds_a_certificate_does_not_get_a_second_one(ca, invitations):
    ca.enrol("anna")
    secret = invitations.invite("anna", {})
    with pytest.raises(AlreadyEnrolledError):
        invitations.enrol(CertificateRequest.parse(request()), secret)
    ca.revoke(name="anna")
    assert invitations.enrol(CertificateRequest.parse(request()), secret).certificate.name == "anna"


def test_a_name_that_cannot_be_certified_is_not_invited(invitations):
    with pytest.raises(CaRequestError):
        invitations.invite("no spaces", {})


def test_a_request_must_be_signed_by_its_own_key():
    mine = x509.load_pem_x509_csr(request().encode())
    others = x509.load_pem_x509_csr(request().encode()).signature
    der = mine.public_bytes(Encoding.DER).replace(
        mine.signature, others.ljust(len(mine.signature))[: len(mine.signature)]
    )
    body = base64.encodebytes(der).decode()
    with pytest.raises(CaRequestError):
        CertificateRequest.parse(f"-----BEGIN CERTIFICATE REQUEST-----\n{body}-----END CERTIFICATE REQUEST-----\n")


@pytest.mark.parametrize(
    "pem",
    [
        "",
        "nothing",
        "ä",
        "x" * 10_000,
        request(key=ec.generate_private_key(ec.SECP384R1())),
        request(names=("berta",)),
    ],
)
def test_what_is_no_request_is_refused_by_name(pem):
    with pytest.raises(CaRequestError):
        CertificateRequest.parse(pem)
