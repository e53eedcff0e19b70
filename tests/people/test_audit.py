"""The audit log: chained, appended to only, checked against the ledger; and what gets into it."""

from __future__ import annotations

import ast
import json
import time
from pathlib import Path
from types import SimpleNamespace
from typing import get_args

import pytest
import websockets
from sqlalchemy import text
from sqlalchemy.exc import DBAPIError

from wonderland.proof_contract import ProofContract, RefusedError
from wonderland_backend import audit
from wonderland_backend.alerts.schemas import ActName
from wonderland_backend.audit.acts import ACTS
from wonderland_backend.audit.anchors import Anchoring, AuditIdentity
from wonderland_backend.audit.refusals import EACH_HOUR, HOUR_MS, STRANGERS_HOUR, Quota
from wonderland_backend.audit.verify import verify
from wonderland_backend.person import Account
from wonderland_backend.transactions.functions import CHANGES
from wonderland_fabric_gateway.embedded.contracts import load_contract
from wonderland_fabric_gateway.embedded.node import EmbeddedLedger
from wonderland_fabric_gateway.gateway import Gateway

BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
both = pytest.mark.parametrize("database_url", BOTH, indirect=True)
ADA = Account("a" * 32, "Ada")
NOW_MS = 1_800_000_000_000


def now_ms():
    """The ledger's time is the machine's."""
    return time.time_ns() // 1_000_000


async def write(database, count, first=0):
    for index in range(first, first + count):
        async with database.write() as connection:
            await audit.record(connection, ADA, "note", f"alert/{index}", {"note": "ä \u2028"}, t_ms=NOW_MS + index)


@both
async def test_rows_are_chained_and_cannot_be_changed_or_deleted(database):
    await write(database, 3)
    found = await verify(database, None, NOW_MS)
    assert found.to_json() == {"ok": True, "rows": 3, "ledger": "off", "anchors": 0}
    for statement in ("UPDATE audit_log SET person = 'Eve'", "DELETE FROM audit_log WHERE seq = 2"):
        with pytest.raises(DBAPIError, match="appended to, never changed"):
            async with database.write() as connection:
                await connection.execute(text(statement))
    assert (await verify(database, None, NOW_MS)).ok


@both
async def test_a_row_belongs_to_the_transaction_that_does_the_act(database):
    with pytest.raises(RuntimeError, match="no"):
        async with database.write() as connection:
            await audit.record(connection, ADA, "note", "alert/1", t_ms=NOW_MS)
            raise RuntimeError("no")
    assert (await verify(database, None, NOW_MS)).rows == 0


@both
async def test_writers_take_turns(database):
    import asyncio

    await asyncio.gather(*(write(database, 5, first) for first in range(0, 40, 5)))
    found = await verify(database, None, NOW_MS)
    assert (found.ok, found.rows) == (True, 40)


async def tamper(database, *statements):
    """As somebody with the database file in hand does: the triggers are only in the way of the product."""
    async with database.write() as connection:
        for verb in ("update", "delete"):
            await connection.execute(text(f"DROP TRIGGER IF EXISTS audit_log_no_{verb}"))
        for statement in statements:
            await connection.execute(text(statement))


@pytest.mark.parametrize(
    ("statement", "broken"),
    [
        ("UPDATE audit_log SET person = 'Eve' WHERE seq = 2", 2),
        ("UPDATE audit_log SET detail = '{}' WHERE seq = 3", 3),
        ("UPDATE audit_log SET tx_id = 'x' WHERE seq = 1", 1),
        ("DELETE FROM audit_log WHERE seq = 2", 2),
        ("DELETE FROM audit_log WHERE seq = 1", 1),
    ],
)
async def test_what_somebody_changes_in_the_database_is_found(database, statement, broken):
    await write(database, 4)
    await tamper(database, statement)
    assert (await verify(database, None, NOW_MS)).broken_seq == broken


@pytest.fixture
async def contract(tmp_path):
    """The contract on a real embedded ledger, as the mirror's identity."""
    async with EmbeddedLedger(tmp_path / "ledger", {"pol": load_contract("pol")}) as ledger:
        connection = ledger.connection
        async with connection.open_channel() as channel:
            gateway = Gateway(channel, connection.identity("mirror"), connection.signer("mirror"))
            yield ProofContract(gateway.network(connection.channel), connection.chaincode)


class AnchoredLog:
    """A log of seven rows, of which the ledger has two heads; `rewrite` is what somebody with the database does."""

    def __init__(self, database, contract):
        self.database = database
        self.anchors = AuditIdentity(contract, SimpleNamespace(common_name="mirror"), None).anchors("i" * 32)
        self.anchoring = Anchoring(database, self.anchors, every_s=1, clock=now_ms)
        self.kept = []

    async def write(self, count):
        for index in range(count):
            async with self.database.write() as connection:
                await audit.record(connection, ADA, "note", f"alert/{index}", {"note": "ä"})

    async def begin(self):
        assert not await self.anchoring.anchor(), "nothing to anchor"
        await self.write(3)
        assert await self.anchoring.anchor()
        assert not await self.anchoring.anchor(), "nothing new but that it was anchored"
        await self.write(2)
        assert await self.anchoring.anchor()
        async with self.database.read() as session:
            rows = await session.execute(text("SELECT * FROM audit_log ORDER BY seq"))
            self.kept = [dict(row._mapping) for row in rows]
        return self

    async def check(self, after_ms=0):
        return await verify(self.database, self.anchors, now_ms() + after_ms)

    async def rewrite(self, rows, later_ms=0):
        """Drop the triggers, empty the table, and write these rows with hashes that fit."""
        await tamper(self.database, "DELETE FROM audit_log")
        for row in rows:
            async with self.database.write() as connection:
                detail, at_ms = json.loads(row["detail"]), row["t_ms"] + later_ms
                await audit.record(
                    connection, row["person"], row["act"], row["subject"], detail, row["tx_id"], t_ms=at_ms
                )
        found = await verify(self.database, None, now_ms())
        assert (found.broken_seq, found.misdated_seq) == (None, None), "the forged chain is whole by itself"


@pytest.fixture
async def anchored(database, contract):
    return await AnchoredLog(database, contract).begin()


async def test_the_ledger_vouches_for_a_log_that_is_what_it_was(anchored):
    found = await anchored.check()
    assert (found.ok, found.rows, found.ledger, found.anchors, found.anchored_seq) == (True, 7, "checked", 2, 6)
    assert [row["act"] for row in anchored.kept].count("audit_anchored") == 2
    assert "vouches for them up to row 6 (2 heads compared)." in found.to_text()


async def test_a_row_taken_out_contradicts_the_head(anchored):
    await anchored.rewrite([row for row in anchored.kept if row["seq"] != 2])
    assert (await anchored.check()).contradicted_tx == anchored.kept[3]["tx_id"]


async def test_a_log_cut_off_at_its_end_lacks_a_head(anchored):
    await tamper(anchored.database, "DELETE FROM audit_log WHERE seq > 4")
    assert (await anchored.check()).contradicted_tx == anchored.kept[6]["tx_id"]
    await tamper(anchored.database, "DELETE FROM audit_log")
    found = await anchored.check()
    assert (found.rows, found.ok, found.contradicted_tx) == (0, False, anchored.kept[3]["tx_id"])


async def test_a_log_dated_ahead_is_no_log_without_heads(anchored):
    """Heads were looked for from the first row's day on: dated two days ahead, a forged log was ok with none."""
    await anchored.rewrite([row for row in anchored.kept if row["seq"] != 2], later_ms=2 * 86_400_000)
    found = await anchored.check(after_ms=2 * 86_400_000)
    assert (found.ok, found.misdated_seq, found.contradicted_tx) == (False, 1, anchored.kept[3]["tx_id"])


@pytest.mark.parametrize("instance", ["i" * 32, "another"])
async def test_a_forged_log_of_the_last_hour_is_not_anchored_in_good_faith(anchored, contract, instance):
    """The table and the installation's name are rewritten, all rows dated within the hour; the server anchors on."""
    await anchored.rewrite([row for row in anchored.kept if row["act"] != "audit_anchored"])
    await anchored.write(5)
    anchored.anchors = AuditIdentity(contract, SimpleNamespace(common_name="mirror"), None).anchors(instance)
    anchoring = Anchoring(anchored.database, anchored.anchors, every_s=1, clock=now_ms)
    if instance == "another":
        with pytest.raises(RefusedError, match="AUDIT_LOG_OTHER"):
            await anchoring.anchor()
    else:
        assert await anchoring.anchor()
    found = await anchored.check()
    assert (found.ok, found.contradicted_tx) == (False, anchored.kept[3]["tx_id"])


async def test_a_log_that_nobody_anchors_is_a_failure_before_long(anchored, contract):
    anchored.anchors = AuditIdentity(contract, SimpleNamespace(common_name="nobody"), None).anchors("i" * 32)
    found = await anchored.check(after_ms=2 * 3_600_000)
    assert (found.ok, found.anchors, found.late_seq) == (False, 0, 1)
    assert found.lost_tx == anchored.kept[3]["tx_id"], "the log names heads that are another's"
    assert "no head on the ledger covers it" in found.to_text()


async def test_an_invented_anchor_is_none(anchored):
    async with anchored.database.write() as connection:
        await audit.record(connection, "the server", "audit_anchored", "audit/7", {}, "f" * 64)
    assert (await anchored.check()).lost_tx == "f" * 64


async def test_what_is_not_anchored_in_time_is_a_failure(anchored):
    await anchored.write(1)
    assert (await anchored.check()).ok
    found = await anchored.check(after_ms=3_700_000)
    assert (found.ok, found.late_seq) == (False, 8)
    assert await anchored.anchoring.anchor()
    assert (await anchored.check(after_ms=3_700_000)).ok


async def test_rows_are_never_dated_back(database):
    for t_ms in (NOW_MS, NOW_MS - 5_000, NOW_MS + 1):
        async with database.write() as connection:
            await audit.record(connection, ADA, "note", "alert/1", t_ms=t_ms)
    async with database.read() as session:
        dates = list(await session.scalars(text("SELECT t_ms FROM audit_log ORDER BY seq")))
    assert dates == [NOW_MS, NOW_MS, NOW_MS + 1]


def test_who_asks_again_and_again_does_not_fill_the_log():
    quota = Quota()

    def take(who, subject, after_ms, *, known=False):
        return quota.take(who, subject, NOW_MS + after_ms, known=known)

    assert take("eve", "GET/audit", 0) == 0
    assert take("eve", "GET/audit", 59_999) is None, "the same again within a minute"
    assert take("eve", "GET/audit", 60_000) == 1, "and the next row says that one was left out"
    taken = [take("eve", f"GET/{index}", 60_001) for index in range(200)]
    assert sum(each is not None for each in taken) == EACH_HOUR - 2
    assert take("bob", "GET/audit", 60_002) == 200 - (EACH_HOUR - 2)
    many = [take(f"2001:db8::{index:x}", "GET/audit", 60_003) for index in range(2 * STRANGERS_HOUR)]
    assert sum(each is not None for each in many) == STRANGERS_HOUR - EACH_HOUR - 1
    assert take("mallory's id", "GET/people", 60_004, known=True) is not None, "strangers hide nobody who is signed in"
    assert take("eve", "GET/audit", HOUR_MS) is not None, "an hour later"


async def test_what_is_done_and_refused_is_in_the_log(fresh):
    async with fresh.administrator() as ada, fresh.visitor() as eve:
        eve.authenticator.keys = dict(ada.authenticator.keys)
        eve.authenticator.verified = False
        await eve.sign_in(status=401)
        await eve.call("POST", "/session", {"token": "x"}, status=401)
        await eve.call("GET", "/audit", status=401)
        items = (await ada.call("GET", "/audit"))["items"]
        acts = [each["act"] for each in items]
        assert acts == ["refused", "sign_in_failed", "sign_in_failed", "sign_in", "passkey_added", "person_active"]
        assert items[0]["detail"] == {"status": 401, "address": "127.0.0.1"}
        assert items[0]["subject"] == "GET/api/v1/audit"
        assert items[2]["detail"] == {"why": "sign-in-required", "address": "127.0.0.1"}
        assert {each.get("person") for each in items[3:]} == {"Ada"}
        mine = await ada.call("GET", f"/audit?act=sign_in&person={items[3]['person_id']}")
        assert [each["seq"] for each in mine["items"]] == [items[3]["seq"]]
        page = await ada.call("GET", "/audit?limit=2")
        rest = await ada.call("GET", f"/audit?limit=50&cursor={page['next']}")
        assert [each["seq"] for each in (*page["items"], *rest["items"])] == [each["seq"] for each in items]
        found = await ada.call("GET", "/audit/verify")
        assert (found["ok"], found["rows"], found["ledger"]) == (True, 6, "off")
        for method in ("PUT", "PATCH", "DELETE", "POST"):
            await ada.call(method, "/audit", status=405)


async def test_what_is_refused_before_any_endpoint_is_in_the_log(fresh, clock):
    """Requests from other sites' pages, and attempts beyond the minute's allowance."""
    async with fresh.administrator() as ada, fresh.visitor() as eve:
        foreign = {"Origin": "https://evil.example"}
        assert (await eve.http.post("/api/v1/session", json={"token": "x"}, headers=foreign)).status_code == 403
        with pytest.raises(websockets.InvalidStatus):
            async with websockets.connect(
                f"{fresh.address.replace('http', 'ws')}/api/v1/live", proxy=None, origin=foreign["Origin"]
            ):
                pass
        for _ in range(61):
            last = await eve.http.post("/api/v1/sign-in/passkey/challenge")
        assert last.status_code == 429
        items = (await ada.call("GET", "/audit?act=refused"))["items"]
        assert [(each["subject"], each["detail"]["status"]) for each in items] == [
            ("POST/api/v1/sign-in/passkey/challenge", 429),
            ("WebSocket/api/v1/live", 403),
            ("POST/api/v1/session", 403),
        ]


async def test_input_that_is_refused_is_in_the_log_without_what_it_was(fresh):
    async with fresh.administrator() as ada:
        await ada.call("GET", "/audit?limit=-1", status=422)
        await ada.call("POST", "/session", {"token": "SELECT " + "x" * 70_000}, status=413)
        items = (await ada.call("GET", "/audit?act=refused"))["items"]
        assert [(each["subject"], each["detail"]["status"]) for each in items] == [
            ("POST/api/v1/session", 413),
            ("GET/api/v1/audit", 422),
        ]
        assert "SELECT" not in str(items)


async def test_forms_filled_in_wrongly_hide_no_refusal(fresh, clock):
    async with fresh.administrator() as ada:
        for _ in range(EACH_HOUR + 9):
            await ada.call("GET", "/audit?limit=-1", status=422)
            clock.now_ms += 60_001
        await ada.http.post("/api/v1/alerts/none/note", json={}, headers={"Origin": "https://evil.example"})
        newest = (await ada.call("GET", "/audit?act=refused&limit=1"))["items"][0]
        assert newest["detail"]["status"] == 403


async def test_who_asks_without_end_is_told_to_wait(fresh):
    async with fresh.administrator() as ada:
        await ada.call("GET", "/alerts")
        limits = fresh.parts.machines.limits
        for _ in range(fresh.context.settings.person_requests_per_min):
            limits.count(next(iter(limits._windows)))
        await ada.call("GET", "/alerts", status=429)


def written():
    """Acts that the backend's source names where it writes to the log, and those that it puts together there."""
    for path in Path(audit.__file__).parents[1].rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if not isinstance(node, ast.Call) or ast.unparse(node.func) not in {"audit.record", "audit.record_read"}:
                continue
            place = node.args[2] if ast.unparse(node.func) == "audit.record" else None
            place = next((each.value for each in node.keywords if each.arg == "act"), place)
            if isinstance(place, ast.Constant):
                yield place.value
            elif isinstance(place, ast.JoinedStr):
                rest = "".join(each.value for each in place.values if isinstance(each, ast.Constant))
                yield from {
                    "person_": ("person_active", "person_invited"),
                    "_link_made": ("invitation_link_made", "recovery_link_made"),
                    "_subscription": ("active_subscription", "paused_subscription"),
                }[rest]
    yield from (
        "read_personal_data",
        "audit_anchored",
        "refused",
        "person_changed",
        "person_suspended",
        "person_restored",
    )
    yield from get_args(ActName)
    yield from CHANGES


def test_the_list_of_acts_is_what_the_backend_can_write():
    assert set(written()) == ACTS


async def test_an_act_that_is_not_in_the_list_is_refused(database):
    async with database.write() as connection:
        with pytest.raises(ValueError, match=r"backend\.audit\.acts"):
            await audit.record(connection, ADA, "drop_table", "alert/1", t_ms=NOW_MS)


async def test_the_log_is_filtered_by_acts_that_exist(fresh):
    async with fresh.administrator() as ada:
        assert await ada.call("GET", "/audit?act=RegisterPad") == {"items": []}
        assert (await ada.call("GET", "/audit?act=person_active"))["items"] != []
        await ada.call("GET", "/audit?act=drop_table", status=422)
