"""The audit log: chained, appended to only, checked against the ledger; and what gets into it."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import get_args

import pytest
from sqlalchemy import text
from sqlalchemy.exc import DBAPIError

from wonderland.proof_contract import ProofContract
from wonderland_backend import audit
from wonderland_backend.alerts.schemas import ActName
from wonderland_backend.audit.acts import ACTS
from wonderland_backend.audit.anchors import Anchoring, Anchors
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
async def assets(tmp_path):
    """The contract on a real embedded ledger, as the mirror's identity: it needs no more than that."""
    async with EmbeddedLedger(tmp_path / "ledger", {"pol": load_contract("pol")}) as ledger:
        connection = ledger.connection
        async with connection.open_channel() as channel:
            gateway = Gateway(channel, connection.identity("mirror"), connection.signer("mirror"))
            yield ProofContract(gateway.network(connection.channel), connection.chaincode)


async def test_the_head_is_on_the_ledger_and_a_rewritten_log_contradicts_it(database, assets, clock):
    anchors = Anchors(assets, "i" * 32)
    anchoring = Anchoring(database, assets, every_s=1, clock=clock)
    assert not await anchoring.anchor(anchors), "nothing to anchor"
    await write(database, 3)
    assert await anchoring.anchor(anchors)
    assert not await anchoring.anchor(anchors), "nothing new but that it was anchored"
    await write(database, 2)
    clock.now_ms += 86_400_000
    assert await anchoring.anchor(anchors)
    found = await verify(database, anchors, clock())
    assert (found.ok, found.rows, found.ledger, found.anchors, found.anchored_seq) == (True, 7, "checked", 2, 6)

    rows = "SELECT seq, t_ms, person_id, person, act, subject, detail, tx_id, previous_sha256, sha256 FROM audit_log"
    async with database.read() as session:
        kept = [dict(row._mapping) for row in await session.execute(text(f"{rows} ORDER BY seq"))]
    assert kept[3]["act"] == "audit_anchored"
    assert len(kept[3]["tx_id"]) == 64
    await tamper(database, "DELETE FROM audit_log")
    for row in kept:
        if row["seq"] != 2:
            async with database.write() as connection:
                await audit.record(connection, row["person"], row["act"], row["subject"], t_ms=row["t_ms"])
    assert (await verify(database, None, clock())).ok, "the forged chain is whole by itself"
    assert (await verify(database, anchors, clock())).contradicted_tx == kept[3]["tx_id"]
    await tamper(database, "DELETE FROM audit_log WHERE seq > 2")
    assert not (await verify(database, anchors, clock())).ok, "a log that was cut off at its end"


async def test_what_is_done_and_refused_is_in_the_log(fresh):
    async with fresh.administrator() as ada, fresh.visitor() as eve:
        eve.authenticator.keys = dict(ada.authenticator.keys)
        eve.authenticator.verified = False
        await eve.sign_in(status=401)
        await eve.call("POST", "/session", {"token": "x"}, status=401)
        await eve.call("GET", "/audit", status=401)
        items = (await ada.call("GET", "/audit"))["items"]
        acts = [each["act"] for each in items]
        assert acts == ["sign_in_failed", "sign_in_failed", "sign_in", "passkey_added", "person_active"]
        assert items[1]["detail"] == {"why": "sign-in-required", "address": "127.0.0.1"}
        assert {each.get("person") for each in items[2:]} == {"Ada"}
        mine = await ada.call("GET", f"/audit?act=sign_in&person={items[2]['person_id']}")
        assert [each["seq"] for each in mine["items"]] == [items[2]["seq"]]
        page = await ada.call("GET", "/audit?limit=2")
        rest = await ada.call("GET", f"/audit?limit=50&cursor={page['next']}")
        assert [each["seq"] for each in (*page["items"], *rest["items"])] == [each["seq"] for each in items]
        found = await ada.call("GET", "/audit/verify")
        assert (found["ok"], found["rows"], found["ledger"]) == (True, 5, "off")
        for method in ("PUT", "PATCH", "DELETE", "POST"):
            await ada.call(method, "/audit", status=405)


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
    yield from ("read_personal_data", "audit_anchored", "person_changed", "person_suspended", "person_restored")
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
