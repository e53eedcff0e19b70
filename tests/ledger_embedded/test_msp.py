"""Who is a member: chains, validity, revocation, node OUs."""

import datetime as dt

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.oid import NameOID
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland_fabric_gateway.embedded.errors import AccessDeniedError, RevocationListError
from wonderland_fabric_gateway.embedded.msp import (
    CACHED_MEMBERS,
    ChannelMembership,
    OrganisationTrust,
    check_revocation_list,
)
from wonderland_fabric_gateway.identity import Identity

NOW = dt.datetime(2026, 6, 1, tzinfo=dt.UTC)
NOW_MS = int(NOW.timestamp() * 1000)
DAY = dt.timedelta(days=1)


def name(common_name, *units):
    return x509.Name(
        [x509.NameAttribute(NameOID.COMMON_NAME, common_name)]
        + [x509.NameAttribute(NameOID.ORGANIZATIONAL_UNIT_NAME, unit) for unit in units]
    )


class Issuer:
    """A CA made for one test, with every knob that a real one lacks."""

    def __init__(self, common_name="root", parent=None, *, ca=True, key=None, days=(-10, 100)):
        self.key = key or ec.generate_private_key(ec.SECP256R1())
        self.certificate = (parent or self).issue(
            name(common_name), self.key.public_key(), ca=ca, issuer=None if parent else name(common_name), days=days
        )

    def issue(self, subject, public_key, *, ca=False, issuer=None, days=(-1, 10), basic=True):
        builder = (
            x509.CertificateBuilder()
            .subject_name(subject)
            .issuer_name(issuer or self.certificate.subject)
            .public_key(public_key)
            .serial_number(x509.random_serial_number())
            .not_valid_before(NOW + days[0] * DAY)
            .not_valid_after(NOW + days[1] * DAY)
            .add_extension(x509.SubjectKeyIdentifier.from_public_key(public_key), critical=False)
        )
        if basic:
            builder = builder.add_extension(x509.BasicConstraints(ca=ca, path_length=None), critical=True)
        return builder.sign(self.key, hashes.SHA256())

    def member(self, *units, **options):
        key = options.pop("key", None) or ec.generate_private_key(ec.SECP256R1())
        return self.issue(name("someone", *(units or ("client",))), key.public_key(), **options)

    def crl(self, *certificates, aki=True, key=None):
        builder = (
            x509.CertificateRevocationListBuilder()
            .issuer_name(self.certificate.subject)
            .last_update(NOW - DAY)
            .next_update(NOW - DAY / 2)  # past: still enforced
        )
        if aki:
            builder = builder.add_extension(
                x509.AuthorityKeyIdentifier.from_issuer_public_key(self.key.public_key()), critical=False
            )
        for each in certificates:
            builder = builder.add_revoked_certificate(
                x509.RevokedCertificateBuilder().serial_number(each.serial_number).revocation_date(NOW - DAY).build()
            )
        return builder.sign(key or self.key, hashes.SHA256()).public_bytes(Encoding.PEM)

    @property
    def pem(self):
        return self.certificate.public_bytes(Encoding.PEM)


@pytest.fixture
def root():
    return Issuer()


def membership(root, *intermediates, crls=()):
    return ChannelMembership(
        [OrganisationTrust("OrgMSP", (root.pem,), tuple(each.pem for each in intermediates), tuple(crls))]
    )


def creator(certificate, msp_id="OrgMSP"):
    return Identity(msp_id, certificate.public_bytes(Encoding.PEM)).creator


@pytest.mark.parametrize("unit", ["client", "peer", "admin", "orderer"])
def test_a_member(root, unit):
    member = membership(root).member(creator(root.member(unit)), NOW_MS)
    assert member.creator.node_ou == unit
    assert member.creator.common_name == "someone"
    assert member.creator.attributes == {}


def test_a_member_through_an_intermediate(root):
    middle = Issuer("middle", root)
    certificate = middle.member()
    assert membership(root, middle).member(creator(certificate), NOW_MS).creator.msp_id == "OrgMSP"
    with pytest.raises(AccessDeniedError, match="not issued by a CA"):
        membership(root).member(creator(certificate), NOW_MS)


def test_a_certificate_issued_by_a_member_is_none(root):
    impostor = Issuer("member", root, ca=False)
    with pytest.raises(AccessDeniedError, match="not issued by a CA"):
        membership(root, impostor).member(creator(impostor.member()), NOW_MS)


@pytest.mark.parametrize("units", [("nobody",), ("client", "admin"), ("Client",)])
def test_the_node_ou_must_be_exactly_one(root, units):
    with pytest.raises(AccessDeniedError, match="exactly one of the OUs"):
        membership(root).member(creator(root.member(*units)), NOW_MS)


def test_a_cas_certificate_is_no_identity(root):
    with pytest.raises(AccessDeniedError, match="CA certificate"):
        membership(root).member(creator(root.member(ca=True)), NOW_MS)
    with pytest.raises(AccessDeniedError):
        membership(root).member(creator(root.certificate), NOW_MS)


def test_validity_is_looked_at_every_time(root):
    channel = membership(root)
    who = creator(root.member(days=(-1, 1)))
    channel.member(who, NOW_MS)
    with pytest.raises(AccessDeniedError, match="expired"):
        channel.member(who, NOW_MS + 2 * 86_400_000)
    with pytest.raises(AccessDeniedError, match="not valid yet"):
        channel.member(who, NOW_MS - 2 * 86_400_000)
    channel.member(who, NOW_MS)


def test_the_chain_must_be_valid_too():
    root = Issuer(days=(-10, 1))
    who = creator(root.member(days=(-1, 10)))
    with pytest.raises(AccessDeniedError, match="expired"):
        membership(root).member(who, NOW_MS + 2 * 86_400_000)


def test_revocation_by_a_list_that_is_past_its_time(root):
    bad, good = root.member(), root.member()
    channel = membership(root, crls=[root.crl(bad)])
    with pytest.raises(AccessDeniedError, match="revoked"):
        channel.member(creator(bad), NOW_MS)
    channel.member(creator(good), NOW_MS)


def test_revoking_an_intermediate_revokes_all_below_it(root):
    middle = Issuer("middle", root)
    channel = membership(root, middle, crls=[root.crl(middle.certificate)])
    with pytest.raises(AccessDeniedError, match="revoked"):
        channel.member(creator(middle.member()), NOW_MS)


def test_a_list_of_one_ca_does_not_touch_the_serials_of_another(root):
    middle = Issuer("middle", root)
    mine = middle.member()
    channel = membership(root, middle, crls=[root.crl(mine)])  # the root lists a serial that it did not issue
    channel.member(creator(mine), NOW_MS)


def test_lists_that_must_not_get_onto_the_channel(root):
    assert check_revocation_list(root.crl(), [root.pem]).issuer == root.certificate.subject
    with pytest.raises(RevocationListError, match="no authority key identifier"):
        check_revocation_list(root.crl(aki=False), [root.pem])
    with pytest.raises(RevocationListError, match="not signed by the CA"):
        check_revocation_list(root.crl(key=ec.generate_private_key(ec.SECP256R1())), [root.pem])
    with pytest.raises(RevocationListError, match="is no CA of that organisation"):
        check_revocation_list(Issuer("other").crl(), [root.pem])
    with pytest.raises(RevocationListError, match="no PEM"):
        check_revocation_list(b"rubbish", [root.pem])


@pytest.mark.parametrize(
    "key", [ec.generate_private_key(ec.SECP384R1()), rsa.generate_private_key(65537, 2048)], ids=["P-384", "RSA"]
)
def test_other_kinds_of_keys(root, key):
    with pytest.raises(AccessDeniedError, match="malformed"):
        membership(root).member(creator(root.member(key=key)), NOW_MS)


def test_a_broken_attribute_extension_is_refused(root):
    from wonderland_fabric_gateway.attributes import ATTRIBUTES_OID

    key = ec.generate_private_key(ec.SECP256R1())
    certificate = (
        x509.CertificateBuilder()
        .subject_name(name("someone", "client"))
        .issuer_name(root.certificate.subject)
        .public_key(key.public_key())
        .serial_number(1)
        .not_valid_before(NOW - DAY)
        .not_valid_after(NOW + DAY)
        .add_extension(x509.UnrecognizedExtension(ATTRIBUTES_OID, b"{not json"), critical=False)
        .sign(root.key, hashes.SHA256())
    )
    with pytest.raises(AccessDeniedError, match="malformed"):
        membership(root).member(creator(certificate), NOW_MS)


def test_the_memory_of_members_is_bounded(root):
    channel = membership(root)
    who = creator(root.member())
    channel._members.update({str(index).encode(): None for index in range(CACHED_MEMBERS)})
    channel.member(who, NOW_MS)
    assert len(channel._members) == CACHED_MEMBERS
    assert who in channel._members


@given(data=st.binary(max_size=300), prefix=st.sampled_from([b"", b"\x0a\x06OrgMSP\x12"]))
@settings(max_examples=100, deadline=None)
def test_garbage_is_denied(data, prefix):
    with pytest.raises(AccessDeniedError):
        CHANNEL.member(prefix + data, NOW_MS)


@given(position=st.integers(0, 10_000), value=st.integers(0, 255))
@settings(max_examples=150, deadline=None)
def test_a_damaged_certificate_is_denied_or_the_same(position, value):
    damaged = bytearray(GOOD)
    damaged[position % len(damaged)] = value
    try:
        member = CHANNEL.member(bytes(damaged), NOW_MS)
    except AccessDeniedError:
        return
    # Letters between the PEM lines do not belong to the certificate.
    assert member.creator.certificate_sha256 == CHANNEL.member(GOOD, NOW_MS).creator.certificate_sha256


_ROOT = Issuer()
CHANNEL = membership(_ROOT)
GOOD = creator(_ROOT.member())
