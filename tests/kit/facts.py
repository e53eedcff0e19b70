"""Records as the contract stores them, and the transactions that store them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from kit.chain import START_MS, Tx, number
from kit.openings import NUMBER, opening
from wonderland.proofs import encoding
from wonderland.proofs.records import assets, keys, pads, policies, sessions, uavs, verdicts

FRAME = {
    "lat_e7": 604_518_000,
    "lon_e7": 222_666_000,
    "height_mm": 30_000,
    "e1": 23_627_000_000,
    "e2": -92_000_000,
    "e3": 3_700_000,
    "n1": 47_900_000_000,
    "n2": 0,
    "n3": 40_000_000,
    "n4": 7_800_000,
    "u2": -87_000_000,
    "u3": -21_000_000,
}


class Facts:
    """Records as the contract stores them, and the transactions that store them. Every one is a valid record."""

    @staticmethod
    def pad(pad_id="pad-1", *, commissioned=True, **more):
        anchors = [
            {
                "anchor_id": f"A{index}",
                "mac": 0xA000 + index,
                "east_mm": east,
                "north_mm": north,
                "up_mm": 200,
                "survey_sigma_mm": 3,
                "bias": [{"range_mm": 0, "bias_mm": 0, "sigma_mm": 5}],
            }
            for index, (east, north) in enumerate(((1500, 1500), (-1500, 1500), (-1500, -1500), (1500, -1500)))
        ]
        record = {
            "pad_id": pad_id,
            "name": "Aurajoki 2",
            "operator_id": "turku",
            "msp_id": "PadMSP",
            "status": "commissioned" if commissioned else "registered",
            "lat_e7": FRAME["lat_e7"],
            "lon_e7": FRAME["lon_e7"],
            "height_mm": 30_000,
            "registered_ms": START_MS,
            "updated_ms": START_MS,
        }
        if commissioned:
            commissioning = {
                "frame": FRAME,
                "anchors": anchors,
                "range_sigma_mm": 25,
                "installation_sigma_mm": 5,
                "max_range_mm": 100_000,
                "valid_from_ms": 0,
                "valid_until_ms": 2 * START_MS,
                "method": "simulated",
            }
            digest = encoding.digest(commissioning).hex()
            record |= {"commissioning": commissioning, "commissioning_sha256": digest}
        return pads.Pad.parse(record | more)

    @staticmethod
    def uav(uav_id="uav-1", *, registration=NUMBER, **more):
        record = {
            "uav_id": uav_id,
            "operator_id": "fleet",
            "msp_id": "FleetMSP",
            "model": "M300",
            "status": "active",
            "registered_ms": START_MS,
            "updated_ms": START_MS,
        }
        if registration:
            record["registration_commitment"] = opening(uav_id, registration).commitment
        return uavs.Uav.parse(record | more)

    @staticmethod
    def authorisation(uav_id="uav-1", authorisation_id="a1", **more):
        record = {
            "authorisation_id": authorisation_id,
            "uav_id": uav_id,
            "pad_id": "*",
            "actions": ["land"],
            "valid_from_ms": 0,
            "valid_until_ms": 2 * START_MS,
            "granted_by": "inspector",
            "granted_ms": START_MS,
            "revoked": False,
        }
        return uavs.Authorisation.parse(record | more)

    @staticmethod
    def claim(**more):
        record = {
            "lat_e7": FRAME["lat_e7"] + 900,
            "lon_e7": FRAME["lon_e7"],
            "height_mm": 42_000,
            "accuracy_mm": 900,
            "height_accuracy_mm": 1_500,
            "t_ms": START_MS,
        }
        return record | more

    def session(self, session_id, pad_id="pad-1", uav_id="uav-1", t_ms=START_MS, **more):
        party = {"msp_id": "PadMSP", "certificate_sha256": "0" * 64, "public_key": "A" * 87}
        record = {
            "session_id": session_id,
            "state": "requested",
            "pad_id": pad_id,
            "uav_id": uav_id,
            "action": "land",
            "claim": self.claim(),
            "prekey_id": "k1",
            "pad_key": "A" * 87,
            "uav_key": "A" * 87,
            "pad": party,
            "uav": party,
            "commissioning_sha256": "0" * 64,
            "transcript_sha256": "0" * 64,
            "contract_version": "1",
            "policy": policies.Policy().to_json(),
            "requested_ms": t_ms,
            "expires_ms": t_ms + 60_000,
        }
        return sessions.Session.parse(record | more)

    @staticmethod
    def evidence(t_ms=START_MS, rounds=3):
        times = [t_ms + 50 * index for index in range(rounds)]
        record = {
            "ranges": {
                "t_ms": times,
                "anchors": [
                    {"anchor_id": f"A{index}", "range_mm": [4_000 + index] * rounds, "nlos": []} for index in range(4)
                ],
            },
            "claims": [],
            "broadcast": [],
            "matched": "both",
            "radio": {"measured_by": "pad", "sts": "provisioned"},
            "steps": [{"step": "poll", "t_ms": t_ms + 10}, {"step": "range", "t_ms": t_ms + 20}],
        }
        return sessions.Evidence.parse(record)

    @staticmethod
    def verdict(session_id, pad_id="pad-1", uav_id="uav-1", t_ms=START_MS, outcome="verified", **more):
        position = {
            "east_mm": 100,
            "north_mm": 1_000,
            "up_mm": 12_000,
            "lat_e7": FRAME["lat_e7"] + 900,
            "lon_e7": FRAME["lon_e7"],
            "height_mm": 42_000,
        }
        judgement = {
            "outcome": outcome,
            "claim": position,
            "error_mm": 120,
            "likelihood_ppm": 999_000,
            "paper_rule": True,
            "reasons": [{"code": "within_buffer", "facts": {"error_mm": 120, "buffer_mm": 1_000}}],
        }
        record = {
            "session_id": session_id,
            "pad_id": pad_id,
            "uav_id": uav_id,
            "action": "land",
            "outcome": outcome,
            "permission": "granted" if outcome == "verified" else "refused",
            "authorised": True,
            "assurance": 2,
            "rounds": 24,
            "buffer_mm": 1_000,
            "decided_ms": t_ms,
            "evidence_sha256": "0" * 64,
            "reasons": [],
            "more_rounds": 0,
            "signed": judgement,
            "estimate": position,
            "covariance": {"ee_mm2": 100, "en_mm2": 5, "nn_mm2": 90},
        }
        return verdicts.Verdict.parse(record | more)

    @staticmethod
    def asset(asset_id="thing", value="a\u0000b", **more):
        record = {
            "id": asset_id,
            "type": "geometry_msgs/msg/PoseStamped",
            "media_type": "text/plain",
            "value": value,
            "owner_msp": "PadMSP",
            "owner": "pad-1",
            "version": 1,
            "created_ms": START_MS,
            "updated_ms": START_MS,
        }
        return assets.Asset.parse(record | more)

    def put_pad(self, pad_id="pad-1", **more):
        pad = self.pad(pad_id, **more)
        return Tx("CommissionPad", {"pad_id": pad_id}, {keys.composite(keys.PAD, pad_id): pad.encode()})

    def put_uav(self, uav_id="uav-1", **more):
        uav = self.uav(uav_id, **more)
        return Tx("RegisterUav", {"uav_id": uav_id}, {keys.composite(keys.UAV, uav_id): uav.encode()})

    def grant(self, uav_id="uav-1", authorisation_id="a1"):
        record = self.authorisation(uav_id, authorisation_id)
        key = keys.composite(keys.AUTHORISATION, uav_id, authorisation_id)
        return Tx("GrantAuthorisation", {"uav_id": uav_id}, {key: record.encode()})

    def set_policy(self, pad_id="*", action="*"):
        key = keys.composite(keys.POLICY, pad_id, action)
        return Tx("ApproveChange", {}, {key: policies.Policy(buffer_mm=2_000).encode()})

    def request(self, name, pad_id="pad-1", uav_id="uav-1", t_ms=START_MS):
        session_id = number("session", name)
        record = self.session(session_id, pad_id, uav_id, t_ms)
        event = ("ProofRequested", encoding.encode({"kind": "ProofRequested", "record": record.to_json()}))
        used = encoding.encode({"session_id": session_id})
        writes = {
            keys.composite(keys.SESSION, session_id): record.encode(),
            keys.composite(keys.PREKEY, pad_id, "k1"): None,
            keys.composite(keys.USED_PREKEY, pad_id, "k1"): used,
        }
        return Tx("RequestProof", {"pad_id": pad_id}, writes, event, t_ms=t_ms, tx_id=session_id)

    def decide(self, name, pad_id="pad-1", uav_id="uav-1", t_ms=START_MS, outcome="verified", rounds=3):
        session_id = number("session", name)
        record = self.session(session_id, pad_id, uav_id, t_ms, state="decided", decided_ms=t_ms + 2_000)
        verdict = self.verdict(session_id, pad_id, uav_id, t_ms + 2_000, outcome)
        event = ("ProofDecided", encoding.encode({"kind": "ProofDecided", "record": verdict.to_json()}))
        evidence = self.evidence(t_ms, rounds)
        argument = {"session_id": session_id, "evidence": evidence.to_json()}
        writes = {
            keys.composite(keys.SESSION, session_id): record.encode(),
            keys.composite(keys.VERDICT, session_id): verdict.encode(),
        }
        return Tx("SubmitProof", argument, writes, event, t_ms=t_ms + 2_000)

    @staticmethod
    def judged(session, evidence=None, verdict=None):
        """The request of this very session; with evidence and verdict, what decided it."""
        if verdict is None:
            kind, record, argument, t_ms = "ProofRequested", session, {"pad_id": session.pad_id}, session.requested_ms
            writes = {keys.composite(keys.SESSION, session.session_id): session.encode()}
        else:
            kind, record, t_ms = "ProofDecided", verdict, verdict.decided_ms
            argument = {"session_id": session.session_id, "evidence": evidence.to_json()}
            ended = replace(session, state="decided", decided_ms=t_ms)
            writes = {
                keys.composite(keys.SESSION, session.session_id): ended.encode(),
                keys.composite(keys.VERDICT, session.session_id): verdict.encode(),
            }
        event = (kind, encoding.encode({"kind": kind, "record": record.to_json()}))
        function, tx_id = ("RequestProof", session.session_id) if verdict is None else ("SubmitProof", "")
        return Tx(function, argument, writes, event, t_ms=t_ms, tx_id=tx_id)

    def complete(self, name, pad_id="pad-1", uav_id="uav-1", t_ms=START_MS, state="completed"):
        session_id = number("session", name)
        times = {"decided_ms": t_ms + 2_000, "ended_ms": t_ms + 5_000}
        record = self.session(session_id, pad_id, uav_id, t_ms, state=state, end="done", ended_by="uav", **times)
        writes = {keys.composite(keys.SESSION, session_id): record.encode()}
        kind = "InteractionCompleted" if state == "completed" else "ProofCancelled"
        event = (kind, encoding.encode({"kind": kind, "record": record.to_json()}))
        return Tx("CompleteInteraction", {"session_id": session_id}, writes, event, t_ms=t_ms + 5_000)


@pytest.fixture
def facts():
    return Facts()
