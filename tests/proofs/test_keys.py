from __future__ import annotations

import dataclasses

import pytest
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

from wonderland.proofs import keys
from wonderland.proofs.errors import KeyAgreementError
from wonderland.proofs.statement import statement
from wonderland.proofs.transcript import transcript_of


def test_both_sides_derive_the_same_and_another_transcript_gives_others():
    pad, uav = keys.new_key(), keys.new_key()
    secret = keys.shared_secret(pad, keys.public_bytes(uav))
    assert secret == keys.shared_secret(uav, keys.public_bytes(pad))
    one, same, other = (keys.derive(secret, digest) for digest in (b"t" * 32, b"t" * 32, b"u" * 32))
    assert one == same
    for field in dataclasses.fields(one):
        assert getattr(one, field.name) != getattr(other, field.name), field.name
    assert one.session_a ^ one.session_b == 1
    assert 0xB000 <= one.uav_mac <= 0xBFFF


def test_derivation_is_hkdf_of_rfc_5869():
    expected = HKDF(hashes.SHA256(), 16, b"t" * 32, b"wonderland/1 code pad").derive(b"s" * 32)
    assert keys.derive(b"s" * 32, b"t" * 32).code_pad == expected


def test_secrets_do_not_show():
    assert "code_pad" not in repr(keys.derive(b"s" * 32, b"t" * 32))


@pytest.mark.parametrize("bad", [b"", b"\x04" + b"\x00" * 64, b"\x04" + b"\x01" * 64, b"\x02" + b"\x01" * 32])
def test_a_key_off_the_curve_is_refused(bad):
    with pytest.raises(KeyAgreementError):
        keys.shared_secret(keys.new_key(), bad)


def test_transcript_and_statement_change_with_each_thing_they_bind(world):
    session = world.session(world.claim((3000, 4000, 3000), 1_800_000_000_000))
    digests = {transcript_of(session, "wonderland").digest()}
    for change in (
        {"pad_id": "pad-2"},
        {"uav_id": "x"},
        {"action": "dock"},
        {"prekey_id": "k2"},
        {"expires_ms": 5},
        {"session_id": "1" * 64},
        {"commissioning_sha256": "2" * 64},
    ):
        digests.add(transcript_of(dataclasses.replace(session, **change), "wonderland").digest())
    digests.add(transcript_of(session, "other").digest())
    digests.add(transcript_of(dataclasses.replace(session, contract_version="2"), "wonderland").digest())
    assert len(digests) == 10

    evidence = world.evidence(lambda t: (3000, 4000, 3000), lambda t: (3000, 4000, 3000), rounds=5)
    base = statement("0" * 64, "1" * 64, evidence.ranges, evidence.claims)
    anchors = list(evidence.ranges.anchors)
    anchors[0] = dataclasses.replace(anchors[0], range_mm=(1, *anchors[0].range_mm[1:]))
    changed = dataclasses.replace(evidence.ranges, anchors=tuple(anchors))
    assert statement("0" * 64, "1" * 64, changed, evidence.claims) != base
    assert statement("0" * 64, "1" * 64, evidence.ranges, evidence.claims[1:]) != base
    flagged = dataclasses.replace(
        evidence.ranges,
        anchors=(dataclasses.replace(evidence.ranges.anchors[0], nlos=(1,)), *evidence.ranges.anchors[1:]),
    )
    assert statement("0" * 64, "1" * 64, flagged, evidence.claims) == base
