"""Alerts: raised with the mirror's commit, never twice, never lost; acted upon by one at a time; told outside."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import hashlib
import hmac
import json
from email.header import decode_header, make_header
from types import SimpleNamespace

import pytest
from aiosmtpd.controller import Controller
from aiosmtpd.handlers import Message
from cryptography import x509
from jsonschema import Draft202012Validator
from kit.backend import serving
from kit.description import document
from msgspec.structs import asdict
from sqlalchemy import insert, select, update

from wonderland import messages
from wonderland.proofs import encoding
from wonderland_backend.alerts import oddities, queries, store, watch
from wonderland_backend.alerts.deliver import Delivery
from wonderland_backend.alerts.derive import alerts_of
from wonderland_backend.alerts.kinds import SEVERITIES, Alert, plain_text
from wonderland_backend.alerts.schemas import KindName
from wonderland_backend.db.tables.ledger import CertificateRow, OrganisationRow
from wonderland_backend.db.tables.reported import FindingRow
from wonderland_backend.errors import SettingsError
from wonderland_backend.http.targets import Destinations
from wonderland_backend.mirror.certificates import note_signers
from wonderland_backend.mirror.rows import VerdictWrite
from wonderland_backend.settings import load
from wonderland_backend.tracks.schemas import Finding
from wonderland_backend.webhooks.post import Poster, retry_ms

START_MS = 1_800_000_000_000
BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
both = pytest.mark.parametrize("database_url", BOTH, indirect=True)
SECRET = "s" * 40
DOCUMENT = document()


def conforms(name, value):
    schema = {"$ref": f"#/components/schemas/{name}", "components": DOCUMENT["components"]}
    assert [each.message for each in Draft202012Validator(schema).iter_errors(value)] == []


async def alerts(running, **filters):
    return (await running.json("/alerts", **filters))["items"]


async def act(running, alert, name, **more):
    body = {"act": name, "revision": alert["revision"], **more}
    return await running.http.post(f"/api/v1/alerts/{alert['alert_id']}/acts", json=body)


@both
async def test_a_refuted_drone_raises_one_alert_with_its_verdict(running, number):
    found = await alerts(running)
    assert [(each["kind"], each["severity"], each["state"]) for each in found] == [("refuted", "critical", "open")]
    conforms("AlertPage", await running.json("/alerts"))
    (alert,) = found
    assert (alert["uav_id"], alert["session_id"]) == ("uav-2", number("session", "two"))
    assert alert["facts"]["error_mm"] > 0
    detail = await running.json(f"/alerts/{alert['alert_id']}")
    conforms("AlertDetail", detail)
    assert (detail["acts"], detail["deliveries"]) == ([], [])


async def test_mirroring_anew_raises_nothing_twice_and_forgets_no_acknowledgement(
    running, new_backend, serving, source_of, chain
):
    (alert,) = await alerts(running)
    assert (await act(running, alert, "acknowledge", note="seen")).status_code == 200
    from wonderland_backend.mirror import store

    await store.clear(running.context.database)
    again = new_backend(source_of(chain), database=running.context.database)
    async with serving(again) as client:
        await client.mirrored(chain.height)
        found = await alerts(client)
    assert [(each["alert_id"], each["state"], each["acknowledged_by"]) for each in found] == [
        (alert["alert_id"], "acknowledged", "Inspector")
    ]


@both
async def test_two_officers_do_not_overwrite_each_other(running):
    (alert,) = await alerts(running)
    first = await act(running, alert, "assign", assignee="M. Inspector")
    assert first.json()["assigned_to"] == "M. Inspector"
    second = await act(running, alert, "acknowledge", note="mine")
    assert (second.status_code, second.json()["type"]) == (409, "urn:wonderland:problem:conflict")
    assert "look at it again" in second.json()["detail"]
    alert = first.json()
    alert = (await act(running, alert, "note", note="<b>not markup</b>")).json()
    alert = (await act(running, alert, "acknowledge")).json()
    alert = (await act(running, alert, "reopen")).json()
    assert (alert["state"], alert["revision"]) == ("open", 4)
    detail = await running.json(f"/alerts/{alert['alert_id']}")
    assert [each["act"] for each in detail["acts"]] == ["assign", "note", "acknowledge", "reopen"]
    assert detail["acts"][1]["note"] == "<b>not markup</b>"


async def test_what_sleeps_comes_back(running, clock):
    (alert,) = await alerts(running, state="inbox")
    await act(running, alert, "snooze", until_ms=clock.now_ms + 600_000)
    assert await alerts(running, state="inbox") == []
    assert len(await alerts(running, state="snoozed")) == 1
    clock.now_ms += 600_001
    assert len(await alerts(running, state="inbox")) == 1


@pytest.mark.parametrize(
    "body",
    [
        {"act": "snooze", "revision": 0},
        {"act": "acknowledge", "revision": 0, "until_ms": 5},
        {"act": "note", "revision": 0},
        {"act": "assign", "revision": -1},
        {"act": "delete", "revision": 0},
        {"act": "acknowledge", "revision": 0, "note": "x" * 2_001},
        {"act": "acknowledge", "revision": 0, "assignee": "x"},
        {"act": "acknowledge", "revision": 0, "extra": 1},
    ],
)
async def test_acts_that_make_no_sense_are_refused(running, body):
    (alert,) = await alerts(running)
    answer = await running.http.post(f"/api/v1/alerts/{alert['alert_id']}/acts", json=body)
    assert (answer.status_code, answer.headers["content-type"]) == (422, "application/problem+json")


async def test_unknown_alerts_are_not_found(running):
    assert (await running.get(f"/alerts/{'0' * 32}")).status_code == 404
    assert (await act(running, {"alert_id": "0" * 32, "revision": 0}, "acknowledge")).status_code == 404


async def test_each_is_told_live_and_none_is_coalesced(running, chain, facts):
    async with running.live() as socket:
        frames = [json.loads(await asyncio.wait_for(socket.recv(), 5)) for _ in range(2)]
        assert [each["kind"] for each in frames[1]["alerts"]] == ["refuted"]
        names = [f"more-{index}" for index in range(3)]
        chain.add(*(facts.request(name, uav_id="uav-2", t_ms=START_MS + 40_000) for name in names))
        chain.add(*(facts.decide(name, uav_id="uav-2", t_ms=START_MS + 40_000, outcome="refuted") for name in names))
        told = []
        async with asyncio.timeout(10):
            while len(told) < 3:
                told += json.loads(await socket.recv()).get("alerts", [])
    assert len({each["alert_id"] for each in told}) == 3


async def test_more_than_the_live_interface_holds_are_counted(
    running, chain, facts, monkeypatch, new_backend, serving, source_of
):
    monkeypatch.setattr(store, "MAX_OPEN", 2)
    names = [f"more-{index}" for index in range(3)]
    chain.add(*(facts.request(name, uav_id="uav-2", t_ms=START_MS + 40_000) for name in names))
    chain.add(*(facts.decide(name, uav_id="uav-2", t_ms=START_MS + 40_000, outcome="refuted") for name in names))
    await running.mirrored(chain.height)

    async def shown(client):
        async with client.live() as socket:
            _, snapshot = [json.loads(await asyncio.wait_for(socket.recv(), 5)) for _ in range(2)]
        conforms("AlertCount", found := await client.json("/alerts/count"))
        return len(snapshot["alerts"]), snapshot.get("alerts_more"), found["inbox"]

    assert await shown(running) == (2, True, 4)
    async with serving(new_backend(source_of(chain))) as again:
        await again.mirrored(chain.height)
        assert await shown(again) == (2, True, 4)
        alert, *_ = await alerts(again)
        await act(again, alert, "acknowledge")
        assert (await again.json("/alerts/count"))["inbox"] == 3


async def test_an_old_ledger_brings_history_not_news(new_backend, serving, source_of, chain, facts, clock):
    clock.now_ms = START_MS + 30 * 86_400_000
    chain.add(facts.put_pad(), facts.put_uav("uav-2"), facts.request("two", uav_id="uav-2"))
    chain.add(facts.decide("two", uav_id="uav-2", outcome="refuted"))
    backend = new_backend(source_of(chain), alert_webhooks=("https://example.invalid",), alert_webhook_secret=SECRET)
    async with serving(backend) as client:
        await client.mirrored(chain.height)
        (alert,) = await alerts(client)
        assert alert["state"] == "over"
        assert (await client.json(f"/alerts/{alert['alert_id']}"))["deliveries"] == []


async def test_a_pad_that_falls_silent_and_comes_back(running, database, clock):
    from sqlalchemy import insert, update

    from wonderland_backend.db.tables.reported import HealthRow

    row = {"agent": "pad", "agent_id": "pad-1", "t_ms": clock.now_ms, "body": "{}"}
    async with database.write() as connection:
        await connection.execute(insert(HealthRow), [row])
    await running.backend.watch.look_once()
    assert await alerts(running, kind="pad_silent") == []
    clock.now_ms += watch.SILENT_MS + 1
    for _ in range(2):
        await running.backend.watch.look_once()
    (silent,) = await alerts(running, kind="pad_silent", state="open")
    assert silent["facts"]["since_ms"] == row["t_ms"]
    async with database.write() as connection:
        await connection.execute(update(HealthRow).values(t_ms=clock.now_ms))
    await running.backend.watch.look_once()
    (returned,) = await alerts(running, kind="pad_silent", state="inbox")
    assert (returned["state"], returned["over_ms"]) == ("returned", clock.now_ms)
    # Nobody had seen it: it stays until somebody has, also in the live interface and after a restart.
    async with running.live() as socket:
        shown = [json.loads(await asyncio.wait_for(socket.recv(), 5)) for _ in range(2)][1]["alerts"]
        assert {each["state"] for each in shown if each["kind"] == "pad_silent"} == {"returned"}
        assert (await act(running, silent, "acknowledge")).status_code == 409, "it has changed since"
        assert (await act(running, returned, "acknowledge")).json()["state"] == "over"
        told = []
        while not told:
            told = json.loads(await asyncio.wait_for(socket.recv(), 5)).get("alerts", [])
        assert [each["state"] for each in told] == ["over"]
    assert await alerts(running, kind="pad_silent", state="inbox") == []
    clock.now_ms += watch.SILENT_MS + 1
    await running.backend.watch.look_once()
    (again, _) = await alerts(running, kind="pad_silent")
    # One that was seen while it lasted is over when it ends.
    await act(running, again, "acknowledge")
    async with database.write() as connection:
        await connection.execute(update(HealthRow).values(t_ms=clock.now_ms))
    await running.backend.watch.look_once()
    assert [each["state"] for each in await alerts(running, kind="pad_silent")] == ["over", "over"]


async def test_a_halted_mirror_and_certificates_that_expire(running, clock):
    running.parts.mirror.halted = "block 9 does not continue the chain"
    clock.now_ms += 20 * 365 * 86_400_000
    await running.backend.watch.look_once()
    await running.sign_in()
    kinds = {each["kind"] for each in await alerts(running, state="open", limit=100)}
    assert {"ledger_halted", "certificate_expiring"} <= kinds
    running.parts.mirror.halted = None


async def expiring(running, state="open"):
    """Alerts of certificates that end soon, by the serial number."""
    await running.backend.watch.look_once()
    found = await alerts(running, kind="certificate_expiring", state=state, limit=100)
    return {each["facts"]["serial"]: each for each in found}


@pytest.fixture
def certificate_row(database):
    """Puts a certificate into the table of those that signed, as the mirror does."""

    async def put(enrolment, **change):
        transaction = SimpleNamespace(creator=enrolment.identity, endorsers=(), index=0)
        rows = {}
        note_signers(rows, 1, transaction)
        row = asdict(*rows.values())
        async with database.write() as connection:
            await connection.execute(insert(CertificateRow), [row | change])
        return row

    return put


async def test_a_certificate_that_ends_is_told_of_whoever_holds_it(
    running, clock, authorities, certificate_row, database
):
    officer = await certificate_row(authorities.enrol("officer", role="inspector"))
    assert await expiring(running) == {}
    clock.now_ms = officer["not_after_ms"] - 10 * 86_400_000
    await running.sign_in()
    first = await expiring(running)
    alert = first[officer["serial"]]
    assert alert["facts"]["who"] == f"{officer['name']} (PadMSP)"
    assert alert["facts"]["until_ms"] == officer["not_after_ms"]
    # It was replaced; it is over.
    later = {"certificate_sha256": "f" * 64, "serial": "abc", "not_after_ms": officer["not_after_ms"] + 10**11}
    await certificate_row(authorities.enrol("officer", role="inspector"), **later)
    assert officer["serial"] not in await expiring(running)
    # Others, that signed the blocks, go on with the alerts that they have; revoked ones do not.
    left = await expiring(running)
    serial, pad = next((serial, each) for serial, each in left.items() if "pad-1" in each["facts"]["who"])
    assert pad["alert_id"] == first[serial]["alert_id"]
    stolen = await certificate_row(authorities.enrol("stolen"))
    assert stolen["serial"] in await expiring(running)
    authorities.cas["PadMSP"].revoke(name=stolen["name"])
    async with database.write() as connection:
        where = OrganisationRow.msp_id == "PadMSP"
        definition = json.loads(
            (await connection.execute(select(OrganisationRow.definition).where(where))).scalar_one()
        )
        definition["revocation_lists"] = [authorities.cas["PadMSP"].revocation_list_pem().decode()]
        await connection.execute(update(OrganisationRow).where(where).values(definition=json.dumps(definition)))
    assert stolen["serial"] not in await expiring(running)
    # Long expired and never replaced: nobody uses it any more. CAs are always needed.
    clock.now_ms = officer["not_after_ms"] + 15 * 86_400_000
    await running.sign_in()
    assert await expiring(running) == {}


async def test_an_agent_that_comes_and_goes_has_one_alert(running, clock, agent_client):
    certificate = None

    async def connected():
        nonlocal certificate
        async with running.connect("/ingest") as socket:
            agent = agent_client(socket, agent_id="pad-2")  # it never signed a block
            assert (await agent.hello())["type"] == "welcome"
            certificate = x509.load_pem_x509_certificate(agent.enrolment.certificate_pem)
            return await expiring(running)

    await connected()
    clock.now_ms = int(certificate.not_valid_after_utc.timestamp() * 1000) - 5 * 86_400_000
    await running.sign_in()
    serial = f"{certificate.serial_number:x}"
    alert_ids = {found[serial]["alert_id"] for found in [await connected(), await expiring(running), await connected()]}
    assert len(alert_ids) == 1
    assert serial not in await expiring(running, "over")


async def test_a_permission_that_no_broadcast_follows(running, database, clock):
    from sqlalchemy import insert

    from wonderland_backend.db.tables.reported import TrackRow

    clock.now_ms = START_MS + 2_000 + queries.MATCH_AFTER_MS + 1
    await running.backend.watch.look_once()
    assert await alerts(running, kind="permission_unmatched") == [], "a pad that hears nobody accuses nobody"
    async with database.write() as connection:
        row = {"uav_id": "another", "pad_id": "pad-1", "t_ms": START_MS, "received_ms": START_MS, "body": "{}"}
        await connection.execute(insert(TrackRow), [row])
    await running.backend.watch.look_once()
    (alert,) = await alerts(running, kind="permission_unmatched")
    assert (alert["uav_id"], alert["pad_id"]) == ("uav-1", "pad-1")


@pytest.mark.parametrize("why", ["erased at a person's request", "not kept any more"])
async def test_what_is_gone_from_the_database_accuses_nobody(running, database, clock, why):
    from sqlalchemy import delete, insert

    from wonderland_backend.db.tables.reported import TrackRow
    from wonderland_backend.personal_data import store as personal_data
    from wonderland_backend.personal_data.subjects import Erased, Subject

    clock.now_ms = START_MS + 2_000 + queries.MATCH_AFTER_MS + 1
    async with database.write() as connection:
        rows = [
            {"uav_id": uav_id, "pad_id": "pad-1", "t_ms": START_MS, "received_ms": START_MS, "body": "{}"}
            for uav_id in ("another", "uav-1")
        ]
        await connection.execute(insert(TrackRow), rows)
    await running.backend.watch.look_once()
    assert await alerts(running, kind="permission_unmatched") == []
    async with database.write() as connection:
        if why == "not kept any more":
            await connection.execute(delete(TrackRow).where(TrackRow.uav_id == "uav-1"))
        else:
            erased = Erased(Subject("drone", "uav-1"), clock.now_ms)
            found = await personal_data.erase(connection, erased, "she asked", clock.now_ms, dry=False)
            assert found["tracks"] == 1
    if why == "not kept any more":
        async with database.read() as session:
            assert await queries.unmatched_permissions(session, clock.now_ms, queries.MATCH_AFTER_MS) == []
            assert len(await queries.unmatched_permissions(session, clock.now_ms, 86_400_000)) == 1, (
                "or nothing is seen"
            )
    else:
        await running.backend.watch.look_once()
        assert await alerts(running, kind="permission_unmatched") == []


class Receiver:
    """An HTTP server that keeps what it gets, and answers as told."""

    def __init__(self):
        self.requests = []
        self.answers = []

    async def serve(self, reader, writer):
        head = (await reader.readuntil(b"\r\n\r\n")).decode()
        headers = dict(line.split(": ", 1) for line in head.split("\r\n")[1:] if line)
        headers = {name.lower(): value for name, value in headers.items()}
        body = await reader.readexactly(int(headers.get("content-length", 0)))
        self.requests.append((headers, body))
        status = self.answers.pop(0) if self.answers else 204
        writer.write(
            f"HTTP/1.1 {status} x\r\ncontent-length: 0\r\nconnection: close\r\nlocation: /else\r\n\r\n".encode()
        )
        await writer.drain()
        writer.close()

    @contextlib.asynccontextmanager
    async def listening(self):
        server = await asyncio.start_server(self.serve, "127.0.0.1", 0)
        async with server:
            yield f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}/hook"


async def test_a_webhook_is_signed_tried_again_and_sent_once(new_backend, serving, source_of, chain, facts, clock):
    receiver = Receiver()
    receiver.answers = [500, 302]
    async with receiver.listening() as url:
        options = {"alert_webhooks": (url,), "alert_webhook_secret": SECRET}
        backend = new_backend(source_of(chain), **options)
        chain.add(facts.put_pad(), facts.put_uav("uav-2"), facts.request("two", uav_id="uav-2"))
        chain.add(facts.decide("two", uav_id="uav-2", outcome="refuted"))
        async with serving(backend) as client:
            await client.mirrored(chain.height)
            delivery = Delivery(
                client.context.database, client.context.settings, clock, Poster(Destinations(frozenset({"127.0.0.1"})))
            )
            async with asyncio.timeout(20):
                for _ in range(2):
                    while not receiver.requests:
                        await delivery.send_due()
                        await asyncio.sleep(0.01)
                (alert,) = await alerts(client)

                async def told():
                    (found,) = (await client.json(f"/alerts/{alert['alert_id']}"))["deliveries"]
                    return found

                for attempts, problem in ((1, "500"), (2, "302")):
                    while (await told())["attempts"] < attempts:
                        await delivery.send_due()
                        await asyncio.sleep(0.01)
                    found = await told()
                    assert problem in found["problem"]
                    assert "delivered_ms" not in found
                    clock.now_ms += retry_ms(attempts) + 60_001
                while "delivered_ms" not in (await told()):
                    await delivery.send_due()
                    await asyncio.sleep(0.01)
            count = len(receiver.requests)
            clock.now_ms += 86_400_000
            await delivery.send_due()
    assert (count, len(receiver.requests)) == (3, 3)
    headers, body = receiver.requests[-1]
    signed = f"{headers['webhook-id']}.{headers['webhook-timestamp']}.".encode() + body
    mac = base64.b64encode(hmac.new(SECRET.encode(), signed, hashlib.sha256).digest()).decode()
    assert headers["webhook-signature"] == f"v1,{mac}"
    assert headers["webhook-id"] == alert["alert_id"]
    content = json.loads(body)
    assert content["alert"]["uav_id"] == "uav-2"
    assert "uav-2 is not where it says" in content["text"]
    conforms("AlertTold", content)


class Mailbox(Message):
    def __init__(self):
        super().__init__()
        self.messages = []

    def handle_message(self, message):
        self.messages.append(message)


@pytest.mark.parametrize(
    ("language", "subject"),
    [("en", "critical: uav-2 is not where it says"), ("fi", "kriittinen: uav-2 ei ole siellä missä sanoo")],
)
async def test_an_alert_by_mail(language, subject, new_backend, serving, source_of, chain, facts):
    mailbox = Mailbox()
    controller = Controller(mailbox, hostname="127.0.0.1", port=_free_port())
    controller.start()
    try:
        backend = new_backend(
            source_of(chain),
            alert_emails=("mailto:duty@authority.example",),
            alert_language=language,
            smtp=f"smtp://127.0.0.1:{controller.port}",
            smtp_from="wonderland@authority.example",
            public_url="http://127.0.0.1/",
        )
        chain.add(facts.put_pad(), facts.put_uav("uav-2"), facts.request("two", uav_id="uav-2"))
        chain.add(facts.decide("two", uav_id="uav-2", outcome="refuted"))
        async with serving(backend) as client:
            await client.mirrored(chain.height)
            async with asyncio.timeout(20):
                while not mailbox.messages:
                    await asyncio.sleep(0.02)
            (alert,) = await alerts(client)
    finally:
        controller.stop()
    (message,) = mailbox.messages
    assert str(make_header(decode_header(message["Subject"]))).startswith(f"[Wonderland] {subject}")
    assert message["To"] == "duty@authority.example"
    assert f"/#/alerts/{alert['alert_id']}" in message.get_payload(decode=True).decode()


def _free_port():
    import socket

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"alert_emails": ("duty@x",), "smtp": "smtp://x"}, "mailto:"),
        ({"alert_emails": ("mailto:duty@x",)}, "smtp"),
        ({"alert_webhooks": ("https://x",)}, "alert_webhook_secret"),
        ({"alert_webhooks": ("http://x",), "alert_webhook_secret": SECRET}, "https"),
        ({"alert_webhook_secret": "short"}, "32"),
    ],
)
def test_settings_that_could_not_tell_anybody_are_refused(options, said):
    with pytest.raises(SettingsError, match=said):
        load(**options)


@pytest.mark.parametrize(
    ("record", "kind", "error_mm"),
    [
        ({"signed": {"outcome": "refuted", "error_mm": 4_200}}, "refuted", 4_200),
        (
            {
                "signed": {"outcome": "verified", "error_mm": 9},
                "broadcast": {"outcome": "own_contradicted", "error_mm": 30_000},
            },
            "broadcast_contradicts",
            30_000,
        ),
        (
            {
                "signed": {"outcome": "inconclusive", "error_mm": 50},
                "broadcast": {"outcome": "undecided", "error_mm": 60},
                "time_differences": {"error_mm": 3_100},
            },
            "stamps_contradict",
            3_100,
        ),
        (
            {
                "signed": {
                    "outcome": "refuted",
                    "error_mm": 47,
                    "reasons": [{"code": "within_buffer"}, {"code": "time_differences_contradict"}],
                },
                "time_differences": {"error_mm": 3_640},
            },
            "stamps_contradict",
            3_640,
        ),
        (
            {
                "signed": {
                    "outcome": "refuted",
                    "error_mm": 4_200,
                    "reasons": [{"code": "outside_buffer"}, {"code": "time_differences_contradict"}],
                },
                "time_differences": {"error_mm": 3_640},
            },
            "refuted",
            4_200,
        ),
    ],
)
def test_what_refuted_is_what_the_alert_says(record, kind, error_mm):
    row = {"pad_id": "p", "uav_id": "u", "session_id": "s", "tx_id": "t", "action": "land", "decided_ms": 1}
    (alert,) = alerts_of([verdict(**row, outcome="refuted", record=json.dumps(record))])
    assert (alert.kind, alert.facts["error_mm"]) == (kind, error_mm)
    assert f"{error_mm / 1000:.2f}\u00a0m" in plain_text(alert.kind, alert.pad_id, alert.uav_id, alert.facts)


def verdict(**said):
    return VerdictWrite(permission="denied", rounds=0, **said)


def at(east_mm, north_mm=0):
    return {"east_mm": east_mm, "north_mm": north_mm}


@pytest.mark.parametrize(
    ("outcome", "signed_at", "supported", "kinds"),
    [
        ("verified", 0, True, ["broadcast_unattributed"]),  # beside an impostor it lands
        ("inconclusive", 0, False, ["broadcast_unattributed"]),  # nothing true is broadcast
        ("refuted", 30_000, False, ["refuted"]),  # it broadcasts what it signs: one alert says both
        ("refuted", 5_000, False, ["refuted", "broadcast_unattributed"]),
    ],
)
def test_a_broadcast_of_unknown_origin_convicts_nobody_and_is_told(outcome, signed_at, supported, kinds):
    row = {"pad_id": "p", "uav_id": "u", "session_id": "s", "tx_id": "t", "action": "land", "decided_ms": 1}
    heard = {
        "outcome": "contradicted",
        "supported": supported,
        "error_mm": 30_000,
        "claim": at(30_000),
        "tolerance_mm": 2_000,
    }
    signed = {
        "outcome": outcome,
        "error_mm": signed_at,
        "claim": at(signed_at),
        "reasons": [{"code": "outside_buffer"}],
    }
    record = json.dumps({"signed": signed, "broadcast": heard})
    found = list(alerts_of([verdict(**row, outcome=outcome, record=record)]))
    assert [alert.kind for alert in found] == kinds
    if found[-1].kind == "broadcast_unattributed":
        assert found[-1].severity == "warning"
        assert found[-1].facts == {"action": "land", "error_mm": 30_000, "supported": "yes" if supported else "no"}
        assert "an impostor, or its own lie" in plain_text(found[-1].kind, "p", "u", found[-1].facts)


def test_a_drone_that_was_leaving_is_not_said_to_be_off_by_the_error_of_all_its_rounds():
    row = {"pad_id": "p", "uav_id": "u", "session_id": "s", "tx_id": "t", "action": "land", "decided_ms": 1}
    signed = {"outcome": "refuted", "error_mm": 310, "reasons": [{"code": "within_buffer"}, {"code": "leaving"}]}
    (alert,) = alerts_of([verdict(**row, outcome="refuted", record=json.dumps({"signed": signed}))])
    assert (alert.kind, "error_mm" in alert.facts) == ("leaving", False)


def finding(uav_id, kind, t_ms, **more):
    body = {"uav_id": uav_id, "pad_id": "pad-1", "kind": kind, "t_ms": t_ms, "count": 1, "verified": False, **more}
    return {"uav_id": uav_id, "pad_id": "pad-1", "kind": kind, "t_ms": t_ms, "body": json.dumps(body)}


@both
async def test_what_a_receiver_finds_odd_is_an_alert_until_it_is_odd_no_more(running, database, clock):
    from sqlalchemy import insert

    rows = [
        finding("uav-1", "two_places", clock.now_ms - 5_000, distance_mm=390_000),
        finding("uav-1", "two_places", clock.now_ms - 1_000, distance_mm=412_000, interval_ms=300),
        finding("uav-1", "rate_high", clock.now_ms - 900),
    ]
    async with database.write() as connection:
        await connection.execute(insert(FindingRow), rows)
    for _ in range(2):
        await running.backend.watch.look_once()
    (identity,) = await alerts(running, kind="identity_odd")
    assert (identity["uav_id"], identity["pad_id"], identity["severity"]) == ("uav-1", "pad-1", "warning")
    assert identity["facts"] == {
        "finding": "two_places",
        "distance_mm": 412_000,
        "interval_ms": 300,
    }
    conforms("Alert", identity)
    (rate,) = await alerts(running, kind="broadcast_odd")
    assert (rate["severity"], rate["facts"]["finding"]) == ("notice", "rate_high")
    clock.now_ms += queries.LASTS_MS
    await running.backend.watch.look_once()
    assert {each["state"] for each in await alerts(running, kind="identity_odd")} == {"returned"}


@both
async def test_a_flood_of_invented_identities_drowns_nobody_and_is_told(running, database, clock):
    from sqlalchemy import insert

    rows = [finding(f"ghost-{i:03}", "two_places", clock.now_ms + i) for i in range(oddities.SHOWN + 7)]
    async with database.write() as connection:
        await connection.execute(insert(FindingRow), rows)
    await running.backend.watch.look_once()
    assert len(await alerts(running, kind="identity_odd", limit=100)) == oddities.SHOWN
    (flood,) = await alerts(running, kind="broadcasts_flooded")
    assert flood["facts"]["drones"] == oddities.SHOWN + 7


def test_every_kind_of_finding_has_its_words():
    assert messages.keys_of("findings") == set(Finding.model_fields["kind"].annotation.__args__)
    for kind in messages.keys_of("findings"):
        (condition,) = oddities.conditions([oddities.Odd("pad-1", "uav-1", kind, 1, "{}")])
        assert "{" not in plain_text(condition.kind, "pad-1", "uav-1", condition.facts)


def test_everything_is_said_in_finnish_too():
    for kind in SEVERITIES:
        text = plain_text(kind, "pad-1", None, {}, "fi")
        assert "{" not in text
        assert text.endswith(".")
        assert "unknown" not in text
    for kind in messages.keys_of("findings", "fi"):
        (condition,) = oddities.conditions([oddities.Odd("pad-1", "uav-1", kind, 1, '{"distance_mm": 5000}')])
        said = plain_text(condition.kind, "pad-1", "uav-1", condition.facts, "fi")
        assert "{" not in said
    facts = {"until_ms": 1_800_263_100_000}
    assert "18.1.2027 klo\u00a009.05\u00a0UTC" in plain_text("closures_ending", "pad-1", None, facts, "fi")
    assert "laskeutua" in plain_text("unauthorised", "pad-1", "uav-1", {"action": "land"}, "fi")


@pytest.mark.parametrize(
    ("reason", "facts", "said"),
    [
        (
            {"code": "zone_active", "facts": {"zone_id": "FIN:P20", "action": "land", "pad_id": "pad-1"}},
            {"code": "zone_active", "zone_id": "FIN:P20"},
            "jonka vyöhyke FIN:P20 sulkee.",
        ),
        (
            {"code": "closures_outdated", "facts": {"pad_id": "pad-1", "until_ms": 5}},
            {"code": "closures_outdated", "zone_id": ""},
            "jonka sulkuajat vyöhykkeiden vuoksi ovat vanhentuneet.",
        ),
    ],
)
def test_what_closes_a_pad_is_told_by_its_code(reason, facts, said):
    record = json.dumps({"authorised": False, "reasons": [reason]})
    row = {"pad_id": "pad-1", "uav_id": "uav-1", "session_id": "0" * 64, "tx_id": "1" * 64, "action": "land"}
    (alert,) = alerts_of([verdict(**row, outcome="verified", decided_ms=START_MS, record=record)])
    assert alert.kind == "zone_closed"
    assert alert.facts == {"action": "land", **facts}
    assert plain_text(alert.kind, alert.pad_id, alert.uav_id, alert.facts, "fi").endswith(said)


async def test_alerts_say_what_they_are_in_the_language_asked_for(running):
    (alert,) = await alerts(running, kind="refuted")
    assert alert["text"].startswith("uav-2 is not where it says")
    path = f"/alerts/{alert['alert_id']}"
    for answer in (await running.get(path), await running.get(path, headers={"Accept-Language": "de, en;q=0.5"})):
        assert answer.json()["alert"]["text"] == alert["text"]
    finnish_one = await running.get(path, headers={"Accept-Language": "fi-FI, en;q=0.5"})
    assert finnish_one.json()["alert"]["text"].startswith("uav-2 ei ole siellä missä sanoo")
    assert finnish_one.headers["etag"] != (await running.get(path)).headers["etag"]
    unknown = await running.get(f"/alerts/{'0' * 32}", headers={"Accept-Language": "fi"})
    assert (unknown.json()["title"], unknown.json()["detail"]) == ("Ei löytynyt", "Tällaista hälytystä ei ole.")


def test_every_kind_has_a_text_and_a_name_in_the_interface():
    assert set(SEVERITIES) == set(KindName.__args__)
    for kind in SEVERITIES:
        text = plain_text(kind, "pad-1", None, {})
        assert "{" not in text
        assert text.endswith(".")
    one, other = (Alert("refuted", source, 0) for source in "ab")
    assert one.alert_id == Alert("refuted", "a", 99).alert_id != other.alert_id
    assert [retry_ms(each) for each in (1, 2, 3, 30)] == [10_000, 20_000, 40_000, 3_600_000]


def landing_event(**more):
    claim = {"lat_e7": 1, "lon_e7": 1, "height_mm": 1, "accuracy_mm": 1, "height_accuracy_mm": 1, "t_ms": START_MS}
    record = {"uav_id": "uav-1", "pad_id": "pad-1", "cause": "pilot", "claim": claim, "reported_ms": START_MS}
    return ("LandingReported", encoding.encode({"kind": "LandingReported", "record": record | more}))


async def test_a_landing_without_permission_that_a_drone_reports_is_an_alert(new_backend, chain, source_of, tx, facts):
    chain.add(facts.put_pad(), facts.put_uav())
    chain.add(
        tx("ReportLanding", {}, event=landing_event(), t_ms=START_MS),
        tx("ReportLanding", {}, event=landing_event(), chaincode="other"),
        tx("ReportLanding", {}, event=landing_event(cause=7)),
        tx("ReportLanding", {}, event=("LandingReported", b"\xff")),
        tx("CreateAsset", {}, event=landing_event()),
    )
    async with serving(new_backend(source_of(chain))) as running:
        await running.mirrored(chain.height)
        (alert,) = await alerts(running)
        conforms("AlertPage", await running.json("/alerts"))
        assert (alert["kind"], alert["severity"], alert["uav_id"]) == ("landed_unpermitted", "critical", "uav-1")
        assert alert["facts"] == {"cause": "pilot"}
        said = plain_text(alert["kind"], alert["pad_id"], alert["uav_id"], alert["facts"])
        assert said == "uav-1 came down at pad-1 without a permission: its pilot flew. It says so itself."
