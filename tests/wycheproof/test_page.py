"""Wycheproof through the second verifier, the page that reads evidence in a browser."""

from pathlib import Path

import pytest
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.utils import decode_dss_signature
from kit import wycheproof

from wonderland.proofs import keys
from wonderland_fabric_gateway.signing import P256_ORDER

PAGE = Path(__file__).parents[2] / "docs" / "evidence-verifier.html"
ASK = """async ({ point, tests }) => {
  const octets = (digits) => Uint8Array.from(digits.match(/../g) ?? [], (each) => Number.parseInt(each, 16));
  const key = crypto.subtle.importKey("raw", octets(point), { name: "ECDSA", namedCurve: "P-256" }, false, ["verify"]);
  const holds = async (test, lowS) => {
    try { return await signatureHolds(key, octets(test.sig), octets(test.msg), { lowS }); } catch { return false; }
  };
  return Promise.all(tests.map(async (test) => [await holds(test, true), await holds(test, false)]));
}"""


@pytest.mark.browser
def test_the_page_takes_one_spelling_of_a_signature(browser):
    """What Wycheproof found once, lengths in more octets than need be; it needs no vectors."""
    key = keys.new_key()
    signature = key.sign(b"said", ec.ECDSA(hashes.SHA256()))
    longer = [b"\x30" + length + signature[2:] for length in (b"\x81" + signature[1:2], b"\x82\x00" + signature[1:2])]
    page = browser.new_page()
    page.goto(PAGE.as_uri())
    tests = [{"sig": each.hex(), "msg": b"said".hex()} for each in (signature, *longer)]
    found = page.evaluate(ASK, {"point": keys.public_bytes(key).hex(), "tests": tests})
    page.close()
    assert [either for _, either in found] == [True, False, False]


@pytest.mark.browser
def test_the_page_takes_strict_der_alone_and_low_s_where_fabric_does(browser):
    asked = [
        (group["publicKey"]["uncompressed"], tests) for group, tests in wycheproof.groups("ecdsa_secp256r1_sha256_test")
    ]
    page = browser.new_page()
    page.goto(PAGE.as_uri())
    taken = 0
    for point, tests in asked:
        found = page.evaluate(
            ASK, {"point": point, "tests": [{"sig": each["sig"], "msg": each["msg"]} for each in tests]}
        )
        for test, (low, either) in zip(tests, found, strict=True):
            right = test["result"] == "valid"
            assert either is right, test
            assert low is (right and decode_dss_signature(bytes.fromhex(test["sig"]))[1] <= P256_ORDER // 2), test
            taken += either
    page.close()
    assert taken > 150
