"""Signing by REST on a real embedded ledger: who may, what is passed on, every way it can come to nothing."""

from __future__ import annotations

import asyncio
import json
import time

import pytest
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.utils import decode_dss_signature, encode_dss_signature
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat, load_pem_private_key
from kit.registry_house import DAY_MS, base64url, decoded, new_house, request_pem
from sqlalchemy import select

from wonderland.proofs import encoding
from wonderland.proofs.records.policies import Policy
from wonderland_backend.db.tables.audit import AuditRow
from wonderland_backend.transactions.keys import signed_text
from wonderland_fabric_gateway.identity import Identity
from wonderland_fabric_gateway.signing import P256_ORDER

DRONE = "OH-DRN-0417"
SUSPEND = {"uav_id": DRONE, "status": "suspended", "reason": "Flew where it did not say"}


@pytest.fixture
def officer(house):
    anna = house.person("Anna", "inspector")
    assert anna.enrol("inspector", "anna").status_code == 201
    return anna


def seen_of(somebody, uav_id=DRONE):
    return somebody.get(f"/registry/drones/{uav_id}").json()["drone"]["version"]


def test_a_change_goes_from_the_form_to_a_valid_block(house, officer):
    proposed = officer.propose("SetUavStatus", SUSPEND, seen_of(officer)).json()
    assert proposed["state"] == "proposed"
    assert proposed["subject"] == f"drone/{DRONE}"
    assert encoding.encode(SUSPEND) in decoded(proposed["to_sign"])
    endorsed = officer.endorse(proposed).json()
    assert (endorsed["state"], endorsed["endorsers"]) == ("endorsed", ["AuthorityMSP", "PadMSP"])
    submitted = officer.submit(endorsed)
    assert submitted.status_code == 202
    done = officer.settled(proposed["tx_id"])
    assert (done["state"], done["validation"]) == ("valid", "VALID")
    house.wait_mirrored(done["block"] + 1)
    assert officer.get(f"/drones/{DRONE}").json()["status"] == "suspended"
    ledger = officer.get(f"/transactions/{proposed['tx_id']}").json()
    assert ledger["creator"]["certificate_sha256"] == officer.certificate_sha256
    assert [each["tx_id"] for each in officer.get("/transactions/proposals").json()["items"]] == [proposed["tx_id"]]


def test_a_number_in_the_argument_is_refused_before_anything_is_kept(house, officer):
    argument = {"uav_id": "uav-s", "operator_id": "fleet", "registration": "FIN87astrdge12k8-xyz", "model": "M300"}
    refused = officer.propose("RegisterUav", argument)
    assert refused.status_code == 400
    assert [each["path"] for each in refused.json()["errors"]] == ["body.argument.registration"]
    assert "xyz" not in refused.text
    assert "FIN87" not in refused.text
    assert "uav-s" not in officer.get("/transactions/proposals").text


def test_what_was_done_is_in_the_audit_log(house, officer):
    done = officer.change("SetUavStatus", SUSPEND)

    async def rows():
        async with house.backend.database.read() as database:
            return (await database.scalars(select(AuditRow).order_by(AuditRow.seq))).all()

    found = {row.act: row for row in house.run(rows())}
    assert found["SetUavStatus"].tx_id == done["tx_id"]
    assert (found["SetUavStatus"].person, found["SetUavStatus"].subject) == ("Anna", f"drone/{DRONE}")
    assert found["bind_key"].subject == f"certificate/{officer.certificate_sha256}"


def test_the_contract_refuses_by_role_in_its_own_words(house):
    paula = house.person("Paula", "pad_operator")
    paula.enrol("pad_operator", "paula")
    refused = paula.change("SetUavStatus", SUSPEND)
    assert refused["state"] == "refused"
    problem = refused["problem"]
    assert (problem["kind"], problem["code"], problem["status"]) == ("refused", "ROLE_NOT_ALLOWED", 403)
    assert "pad_operator" in problem["text"]


def test_two_officers_and_one_record(house, officer):
    other = house.person("Bertil", "admin")
    other.enrol("admin", "bertil")
    seen = seen_of(officer)
    assert other.change("SetUavStatus", SUSPEND | {"reason": "first"}, seen)["state"] == "valid"
    refused = officer.change("SetUavStatus", SUSPEND | {"reason": "second"}, seen)
    assert (refused["state"], refused["problem"]["kind"]) == ("refused", "changed")
    house.wait_mirrored()
    assert officer.get(f"/drones/{DRONE}").json()["status_reason"] == "first"


def test_two_who_sign_at_the_same_moment(house, officer):
    """Both are endorsed on the same state; the block takes one."""
    other = house.person("Bertil", "admin")
    other.enrol("admin", "bertil")
    seen = seen_of(officer)
    first, second = (
        who.endorse(who.propose("SetUavStatus", SUSPEND | {"reason": who_is}, seen).json()).json()
        for who, who_is in ((officer, "one"), (other, "two"))
    )
    officer.submit(first)
    assert officer.settled(first["tx_id"])["state"] == "valid"
    other.submit(second)
    lost = other.settled(second["tx_id"])
    assert (lost["state"], lost["validation"], lost["problem"]["kind"]) == ("invalid", "MVCC_READ_CONFLICT", "changed")


def test_a_policy_that_somebody_else_has_set_meanwhile(house):
    admin = house.person("Bertil", "admin")
    admin.enrol("admin", "bertil")
    policy = {"pad_id": "aurajoki-2", "action": "land", "policy": {"buffer_mm": 2_000}}
    nothing = {"block": -1, "tx_index": 0}
    proposed = admin.change("ProposePolicy", policy, nothing)
    assert proposed["state"] == "valid"
    approval = {"change_id": proposed["tx_id"], "policy": policy | {"policy": Policy(buffer_mm=2_000).to_json()}}
    house.send("inspector", "ApproveChange", approval)
    refused = admin.change("ProposePolicy", policy | {"policy": {"buffer_mm": 3_000}}, nothing)
    assert (refused["state"], refused["problem"]["kind"]) == ("refused", "changed")


@pytest.mark.parametrize(
    ("function", "argument", "status", "says"),
    [
        ("CreateAsset", {"id": "x"}, 403, "nothing else"),
        ("RequestProof", {}, 403, "nothing else"),
        ("nothing", {}, 403, "nothing else"),
        ("SetUavStatus", SUSPEND | {"status": "gone"}, 400, "status"),
        ("SetUavStatus", SUSPEND | {"more": 1}, 400, "unknown field"),
        ("SetUavStatus", {"uav_id": DRONE}, 400, "missing"),
        ("SetUavStatus", SUSPEND | {"reason": "x" * 501}, 400, "501 characters"),
        ("SetUavStatus", SUSPEND | {"reason": 1.5}, 400, "expected a string"),
        ("SetUavStatus", SUSPEND | {"reason": None}, 400, "expected a string"),
    ],
)
def test_what_is_not_passed_on(officer, function, argument, status, says):
    answer = officer.propose(function, argument)
    assert answer.status_code == status, answer.text
    assert says in answer.json()["detail"]


def test_whose_key_it_is(house, officer):
    other = house.person("Bertil", "admin")
    other.certificate_sha256 = officer.certificate_sha256
    assert other.propose("SetUavStatus", SUSPEND).status_code == 403
    proposed = officer.propose("SetUavStatus", SUSPEND).json()
    assert other.get(f"/transactions/proposals/{proposed['tx_id']}").status_code == 404
    assert other.endorse(proposed).status_code == 404


def test_a_signature_that_does_not_fit(officer):
    proposed = officer.propose("SetUavStatus", SUSPEND).json()
    good = officer.sign(proposed["to_sign"])
    r, s = decode_dss_signature(decoded(good))
    wrong = {
        "of other bytes": officer.sign(b"something else"),
        "high S": base64url(encode_dss_signature(r, P256_ORDER - s)),
        "no DER": base64url(b"\x30\x03\x02\x01"),
        "not base64": "A",
    }
    path = f"/transactions/proposals/{proposed['tx_id']}/endorse"
    for why, signature in wrong.items():
        assert officer.post(path, {"signature": signature}).status_code == 400, why
    assert officer.post(path, {"signature": good}).json()["state"] == "endorsed"


def test_steps_out_of_order(officer):
    proposed = officer.propose("SetUavStatus", SUSPEND).json()
    assert officer.submit(proposed).status_code == 409
    endorsed = officer.endorse(proposed).json()
    assert officer.endorse(proposed).status_code == 409
    path = f"/transactions/proposals/{proposed['tx_id']}/submit"
    assert officer.post(path, {}).status_code == 400
    assert officer.submit(endorsed).status_code == 202
    assert officer.settled(proposed["tx_id"])["state"] == "valid"
    assert officer.submit(endorsed).status_code == 409


def test_a_viewer_signs_nothing(house):
    viewer = house.person("Vera", "viewer")
    assert viewer.get("/signing-keys").status_code == 403
    assert viewer.propose("SetUavStatus", SUSPEND | {}).status_code in {403, 422}


def test_enrolment_keeps_to_the_account(house):
    fleet = house.person("Frida", "fleet_operator")
    assert fleet.enrol("admin", "frida").status_code == 403
    place = fleet.get("/signing-keys").json()
    assert place["keys"] == []
    assert place["demo_roles"] == []
    assert "FleetMSP" in place["organisations"]
    answer = fleet.post("/signing-keys/demo", {"role": "admin", "request": request_pem("x", fleet.key)})
    assert answer.status_code == 404


def test_a_wrong_secret_is_refused_by_the_ca(house):
    frida = house.person("Frida", "fleet_operator")
    house.administration.invite("frida", role="fleet_operator", pol_id="frida")
    body = {"msp_id": "FleetMSP", "request": request_pem("frida", frida.key), "secret": "guess"}
    answer = frida.post("/signing-keys/enrol", body)
    assert answer.status_code == 403
    assert "secret" in answer.json()["detail"]


def bring(somebody, files, key_pem):
    challenge = somebody.get("/signing-keys").json()["challenge"]
    somebody.key = load_pem_private_key(key_pem, None)
    certificate = files.certificate.read_text()
    digest = Identity(files.msp_id, certificate.encode()).certificate_sha256
    signature = somebody.sign(signed_text(challenge, digest))
    body = {"msp_id": files.msp_id, "certificate": certificate, "signature": signature}
    answer = somebody.post("/signing-keys", body)
    if answer.status_code == 201:
        somebody.certificate_sha256 = digest
    return answer


def test_a_certificate_with_its_key_can_be_brought_along(house):
    frida = house.person("Frida", "fleet_operator")
    files = house.ledger.connection.files("fleet_operator")
    assert bring(frida, files, files.key.read_bytes()).status_code == 201
    work = {
        "uav_id": DRONE,
        "performed_ms": house.now_ms() - 1_000,
        "valid_until_ms": house.now_ms() + DAY_MS,
        "work": "Motors",
    }
    assert frida.change("RecordMaintenance", work)["state"] == "valid"
    other = house.person("Fanni", "fleet_operator")
    assert bring(other, files, files.key.read_bytes()).status_code == 409
    stranger = house.person("Frank", "fleet_operator")
    pem = ec.generate_private_key(ec.SECP256R1()).private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    assert bring(stranger, files, pem).status_code == 400


def test_a_key_that_was_taken_off_or_revoked_signs_nothing(house, officer):
    proposed = officer.propose("SetUavStatus", SUSPEND).json()
    assert officer.http.delete(f"/api/v1/signing-keys/{officer.certificate_sha256}").status_code == 204
    assert officer.endorse(proposed).status_code == 403
    assert officer.propose("SetUavStatus", SUSPEND).status_code == 403
    bertil = house.person("Bertil", "admin")
    bertil.enrol("admin", "bertil")
    house.run(house.administration.revoke("bertil"))
    until = time.monotonic() + 10
    while bertil.get("/signing-keys").json()["keys"][0]["usable"] and time.monotonic() < until:
        time.sleep(0.05)
    (key,) = bertil.get("/signing-keys").json()["keys"]
    assert "revoked" in key["problem"]
    refused = bertil.propose("SetUavStatus", SUSPEND)
    assert refused.status_code == 403
    assert "revoked" in refused.json()["detail"]


def test_the_demo_gives_every_role_at_a_click(demo_house):
    visitor = demo_house.person("Visitor", "admin")
    assert visitor.get("/signing-keys").json()["demo_roles"] == ["admin", "fleet_operator", "inspector", "pad_operator"]
    answer = visitor.post("/signing-keys/demo", {"role": "pad_operator", "request": request_pem("v1", visitor.key)})
    assert answer.status_code == 201, answer.text
    assert (answer.json()["role"], answer.json()["msp_id"]) == ("pad_operator", "PadMSP")
    visitor.certificate_sha256 = answer.json()["certificate_sha256"]
    assert visitor.change("UpdatePad", {"pad_id": "aurajoki-2", "name": "Aurajoki II"})["state"] == "valid"
    assert (
        visitor.post("/signing-keys/demo", {"role": "uav", "request": request_pem("v2", visitor.key)}).status_code
        == 400
    )


def test_the_ledger_is_away_and_comes_back(house, officer):
    proposed = officer.propose("SetUavStatus", SUSPEND).json()
    endorsed = officer.endorse(proposed).json()
    house.run(house.ledger.stop())
    away = officer.endorse(officer.propose("SetUavStatus", SUSPEND | {"uav_id": "OH-DRN-0640"}).json())
    assert away.status_code == 503
    assert officer.submit(endorsed).status_code == 202
    time.sleep(0.3)
    assert officer.get(f"/transactions/proposals/{proposed['tx_id']}").json()["state"] in {"submitted", "unknown"}


def test_a_backend_that_ends_leaves_nothing_half_done(house, officer):
    """What was submitted is seen through by the next start, with the very same bytes."""
    proposed = officer.propose("SetUavStatus", SUSPEND).json()
    endorsed = officer.endorse(proposed).json()

    async def hold(_transaction):
        await asyncio.Event().wait()

    house.backend.parts.ledger.settle = hold
    assert officer.submit(endorsed).status_code == 202
    house.stop_backend()
    house.start_backend()
    assert officer.settled(proposed["tx_id"])["state"] == "valid"


def test_so_many_a_minute(tmp_path, ledger_template):
    running = new_house(tmp_path, ledger_template, signed_per_minute=2)
    try:
        anna = running.person("Anna", "inspector")
        anna.enrol("inspector", "anna")
        assert [anna.propose("SetUavStatus", SUSPEND).status_code for _ in range(3)] == [201, 201, 429]
    finally:
        running.close()


def test_unknown_fields_and_broken_json_are_problems(officer):
    answer = officer.post(
        "/transactions/proposals", {"function": "SetUavStatus", "argument": {}, "certificate_sha256": "00", "x": 1}
    )
    assert answer.status_code == 422
    answer = officer.http.post(
        "/api/v1/transactions/proposals", content=b"{", headers={"content-type": "application/json"}
    )
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"
    assert json.loads(answer.content)["errors"]
