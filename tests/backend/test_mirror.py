"""From blocks to rows: what the ledger says, all of it, once, in order; or a halt that says why."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import re
from pathlib import Path

import orjson
import pytest
from sqlalchemy import select

from wonderland.proofs.records import keys
from wonderland.proofs.records.verdicts import Verdict
from wonderland_backend.db import bulk
from wonderland_backend.db.tables.ledger import (
    AssetRow,
    AuthorisationRow,
    BlockRow,
    Checkpoint,
    DroneRow,
    EventRow,
    EvidenceRow,
    OrganisationRow,
    PadRow,
    PolicyRow,
    SessionRow,
    TransactionRow,
    UnreadRow,
    VerdictRow,
)
from wonderland_backend.errors import MirrorHalted
from wonderland_backend.mirror import source, store
from wonderland_backend.mirror.derive import WITHOUT_ROWS
from wonderland_backend.mirror.follow import Mirror
from wonderland_backend.mirror.rebuild import digest, rebuild
from wonderland_backend.mirror.rows import RECORDS
from wonderland_backend.mirror.source import GatewaySource
from wonderland_backend.mirror.status import MirrorStatus
from wonderland_fabric_gateway.errors import LedgerError

BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
both = pytest.mark.parametrize("database_url", BOTH, indirect=True)


@pytest.fixture
def new_mirror(database, clock):
    def make(source, **options):
        status = options.pop("status", None) or MirrorStatus()
        options = {"channel": "wonderland", "chaincode": "pol", "clock": clock, "sleep": no_sleep, **options}
        return Mirror(options.pop("database", database), source, status=status, **options), status

    return make


async def no_sleep(_seconds):
    await asyncio.sleep(0)


async def rows(database, model):
    async with database.read() as session:
        return (await session.scalars(select(model).order_by(*model.__table__.primary_key))).all()


@both
async def test_every_kind_of_record_becomes_its_row(database, new_mirror, chain, source_of, facts, tx):
    asset = facts.asset()
    key = keys.composite(keys.ASSET, "thing")
    chain.add(facts.put_pad(), facts.put_uav(), facts.grant(), facts.set_policy("pad-1", "land"))
    chain.add(facts.request("one"), tx("CreateAsset", {}, {key: asset.encode()}))
    chain.add(facts.decide("one"))
    chain.add(facts.complete("one"))
    mirror, status = new_mirror(source_of(chain))
    await mirror.run_until(chain.height)

    (pad,) = await rows(database, PadRow)
    assert (pad.pad_id, pad.status, pad.block, pad.tx_index) == ("pad-1", "commissioned", 1, 0)
    assert pad.record == facts.pad().encode().decode()
    (drone,) = await rows(database, DroneRow)
    assert drone.uav_id == "uav-1"
    (authorisation,) = await rows(database, AuthorisationRow)
    assert (authorisation.uav_id, authorisation.authorisation_id) == ("uav-1", "a1")
    (policy,) = await rows(database, PolicyRow)
    assert (policy.pad_id, policy.action) == ("pad-1", "land")
    (stored,) = await rows(database, AssetRow)
    assert orjson.loads(stored.record) == asset.to_json()
    (session,) = await rows(database, SessionRow)
    assert (session.state, session.end, session.block) == ("completed", "done", 4)
    (verdict,) = await rows(database, VerdictRow)
    assert (verdict.outcome, verdict.block, verdict.tx_index) == ("verified", 3, 0)
    assert Verdict.decode(verdict.record).to_json()["rounds"] == verdict.rounds == 24
    assert session.verdict_tx == verdict.tx_id != session.complete_tx
    assert session.complete_tx is not None
    (evidence,) = await rows(database, EvidenceRow)
    assert hashlib.sha256(evidence.record.encode()).hexdigest() == hashlib.sha256(facts.evidence().encode()).hexdigest()
    told = ["ProofRequested", "ProofDecided", "InteractionCompleted"]
    assert [row.name for row in await rows(database, EventRow)] == told
    assert [row.msp_id for row in await rows(database, OrganisationRow)] == [
        "AuthorityMSP",
        "FleetMSP",
        "OrdererMSP",
        "PadMSP",
    ]
    assert await rows(database, UnreadRow) == []
    assert (status.mirrored, status.height, status.is_level, status.problem) == (5, 5, True, None)


async def test_refused_transactions_are_listed_and_change_nothing(database, new_mirror, chain, source_of, facts, tx):
    chain.add(facts.put_pad())
    changed = facts.put_pad(name="Somebody else's")
    changed.code = 11
    chain.add(changed, tx(broken=True, code=2), facts.put_uav())
    mirror, _ = new_mirror(source_of(chain))
    await mirror.run_until(chain.height)
    (pad,) = await rows(database, PadRow)
    assert orjson.loads(pad.record)["name"] == "Aurajoki 2"
    listed = [(row.block, row.tx_index, row.type, row.validation_code) for row in await rows(database, TransactionRow)]
    assert listed == [
        (0, 0, "config", 0),
        (1, 0, "endorser", 0),
        (2, 0, "endorser", 11),
        (2, 1, "malformed", 2),
        (2, 2, "endorser", 0),
    ]
    assert [(row.transactions, row.valid) for row in await rows(database, BlockRow)] == [(1, 1), (1, 1), (3, 1)]


@both
async def test_deleted_assets_go_and_may_come_back(database, new_mirror, chain, source_of, facts, tx):
    key = keys.composite(keys.ASSET, "thing")
    chain.add(tx("CreateAsset", {}, {key: facts.asset().encode()}))
    chain.add(tx("DeleteAsset", {}, {key: None}))
    mirror, _ = new_mirror(source_of(chain), batch_transactions=1)
    await mirror.run_until(chain.height)
    assert await rows(database, AssetRow) == []
    chain.add(tx("CreateAsset", {}, {key: facts.asset(version=2).encode()}), tx("DeleteAsset", {}, {key: None}))
    chain.add(tx("CreateAsset", {}, {key: facts.asset(version=3).encode()}))
    mirror, _ = new_mirror(source_of(chain))
    await mirror.run_until(chain.height)
    (asset,) = await rows(database, AssetRow)
    assert orjson.loads(asset.record)["version"] == 3


def test_every_kind_of_key_has_rows_or_is_known_to_have_none():
    kinds = {value for name, value in vars(keys).items() if name.isupper()} - {keys.SEPARATOR, keys.LAST}
    assert set(RECORDS) | WITHOUT_ROWS == kinds


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("plain", b"{}", "not a composite key"),
        (keys.composite("spaceship", "x"), b"{}", "no such kind"),
        (keys.composite(keys.PAD, "pad-1"), b"\xff", "no JSON"),
        (keys.composite(keys.PAD, "pad-1"), b"[]", "no JSON object"),
        (keys.composite(keys.PAD, "pad-1"), b'{"pad_id":"pad-2","msp_id":"M","status":"s"}', "not that of the key"),
        (keys.composite(keys.PAD, "pad-1"), b'{"pad_id":"pad-1","msp_id":5,"status":"s"}', "msp_id"),
        (keys.composite(keys.PAD, "a", "b"), b'{"pad_id":"a"}', "has 1 parts"),
        (keys.composite(keys.PAD, "p" * 200), b'{"pad_id":"a"}', "1 to 128 characters"),
        (keys.composite(keys.SESSION, "x"), b'{"session_id":"x","state":"requested"}', "session_id"),
    ],
)
async def test_what_cannot_be_read_is_kept_and_counted(
    database, new_mirror, chain, source_of, tx, facts, key, value, said
):
    chain.add(tx(writes={key: value}), facts.put_uav())
    mirror, status = new_mirror(source_of(chain))
    await mirror.run_until(chain.height)
    (unread,) = await rows(database, UnreadRow)
    assert re.search(said, unread.problem)
    assert status.unread == 1
    assert len(await rows(database, DroneRow)) == 1


@both
async def test_other_chaincodes_and_odd_texts_do_no_harm(database, new_mirror, chain, source_of, tx, facts):
    pad = keys.composite(keys.PAD, "pad-1")
    chain.add(
        tx(writes={pad: facts.pad().encode()}, chaincode="other"),
        tx("F\x00\x00oo" + "x" * 500, b"\xff\xfe", event=("E\x00v", b"\x00\xff")),
        tx("SubmitProof", b"no json"),
        tx("SubmitProof", {"session_id": "x", "evidence": {"steps": 5}}),
    )
    mirror, _ = new_mirror(source_of(chain))
    await mirror.run_until(chain.height)
    assert await rows(database, PadRow) == []
    assert len(await rows(database, UnreadRow)) == 2
    functions = [row.function for row in await rows(database, TransactionRow)]
    assert functions[2].startswith("F\ufffd\ufffdoo")
    assert len(functions[2]) == 128


@both
async def test_block_by_block_and_in_batches_come_to_the_same(
    database, new_mirror, new_chain, source_of, facts, tmp_path, monkeypatch
):
    from wonderland_backend.db.engine import Database
    from wonderland_backend.db.migrate import migrate

    chain = new_chain()
    fill(chain, facts, 12)
    mirror, _ = new_mirror(source_of(chain), batch_transactions=1)
    await mirror.run_until(chain.height)
    before = await digest(database)
    monkeypatch.setattr(bulk, "MANY_ROWS", 2)
    await rebuild(database, source_of(chain), channel="wonderland", chaincode="pol", batch_transactions=9)
    assert await digest(database) == before
    other = Database(f"sqlite:///{tmp_path / 'other.db'}")
    try:
        await migrate(other)
        mirror, _ = new_mirror(source_of(chain), batch_transactions=10_000, database=other)
        await mirror.run_until(chain.height)
        assert await digest(other) == await digest(database)
    finally:
        await other.close()


def fill(chain, facts, sessions):
    """A few pads and drones, and sessions that end in different ways, several in a block."""
    chain.add(*(facts.put_pad(f"pad-{index}") for index in range(3)))
    chain.add(facts.put_uav())
    for index in range(sessions):
        names = {"pad_id": f"pad-{index % 3}", "t_ms": 1_800_000_000_000 + 1_000 * index}
        chain.add(facts.request(index, **names), facts.request(("b", index), **names))
        outcome = ("verified", "refuted", "inconclusive")[index % 3]
        chain.add(facts.decide(index, outcome=outcome, **names))
        if index % 2:
            chain.add(facts.complete(index, **names), facts.complete(("b", index), state="cancelled", **names))


@both
async def test_rebuilding_gives_identical_content(database, new_mirror, chain, source_of, facts):
    fill(chain, facts, 9)
    source = source_of(chain)
    mirror, _ = new_mirror(source)
    await mirror.run_until(chain.height)
    before = await digest(database)
    seen = []
    await rebuild(
        database,
        source,
        channel="wonderland",
        chaincode="pol",
        batch_transactions=7,
        on_progress=lambda done, of: seen.append((done, of)),
    )
    assert await digest(database) == before
    assert seen[-1] == (chain.height, chain.height)
    assert before.tables["verdicts"].rows == 9
    async with database.write() as connection:
        await connection.execute(VerdictRow.__table__.update().values(outcome="verified"))
    assert (await digest(database)).sha256 != before.sha256


@both
async def test_it_continues_where_it_stopped(database, new_mirror, chain, source_of, facts):
    fill(chain, facts, 3)
    mirror, _ = new_mirror(source_of(chain))
    await mirror.run_until(4)
    (checkpoint,) = await rows(database, Checkpoint)
    assert checkpoint.block >= 3
    source = source_of(chain)
    mirror, status = new_mirror(source)
    await mirror.run_until(chain.height)
    assert status.mirrored == chain.height
    assert len(await rows(database, BlockRow)) == chain.height


async def test_interruptions_are_survived_and_said(database, new_mirror, chain, source_of, facts, clock):
    source = source_of(chain)
    mirror, status = new_mirror(source)
    running = asyncio.create_task(mirror.run())
    try:
        chain.add(facts.put_pad())
        await until(lambda: status.mirrored == 2)
        assert status.lag_ms(clock()) == 0
        source.fail = LedgerError("the line was cut")
        await until(lambda: status.problem == "the line was cut" or source.opened > 1)
        source.limit = 2
        clock.now_ms += 5_000
        await until(lambda: status.connected)
        chain.add(facts.put_uav())
        source.fail = LedgerError("again")
        await until(lambda: source.opened > 2)
        clock.now_ms += 1_500
        await until(lambda: status.height == 3)
        assert status.mirrored == 2
        assert status.lag_ms(clock()) >= 1_500
        source.limit = None
        source.fail = LedgerError("and again")
        await until(lambda: status.mirrored == 3)
        assert status.lag_ms(clock()) == 0
        assert status.problem is None
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)


async def until(condition):
    async with asyncio.timeout(10):
        while not condition():
            await asyncio.sleep(0.002)


@pytest.mark.postgres
@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
async def test_a_database_that_restarts_is_survived(database, new_mirror, chain, source_of, facts, postgres):
    mirror, status = new_mirror(source_of(chain), sleep=asyncio.sleep)
    running = asyncio.create_task(mirror.run())
    try:
        await until(lambda: status.mirrored == 1)
        await asyncio.to_thread(postgres.stop)
        chain.add(facts.put_pad())
        await until(lambda: status.problem is not None)
        assert status.halted is None
        await asyncio.to_thread(postgres.restart)
        await until(lambda: status.mirrored == 2)
        assert status.problem is None
        assert len(await rows(database, PadRow)) == 1
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)


def test_nothing_but_the_mirror_writes_what_the_ledger_says():
    from wonderland_backend.db.tables.ledger import ledger_tables

    package = Path(store.__file__).parents[1]
    tables = "|".join(each.__name__ for each in ledger_tables())
    writes = re.compile(rf"\b(insert|update|delete|_upsert|_insert)\([^()]*\b({tables})\b")
    files = [file for file in package.rglob("*.py") if "mirror" not in file.parent.name]
    assert len(files) > 40
    assert [file.name for file in files if writes.search(file.read_text())] == []
    assert writes.search("insert(VerdictRow)"), "the check itself"


@pytest.mark.parametrize("how", ["gap", "previous", "data", "reset"])
async def test_contradictions_halt_it(database, new_mirror, chain, new_chain, source_of, facts, tx, how):
    chain.add(facts.put_pad())
    mirror, _ = new_mirror(source_of(chain))
    await mirror.run_until(chain.height)
    before = await digest(database)
    source = source_of(chain)
    envelope = chain.envelope(tx(), "0" * 64)
    if how == "gap":
        chain.append([envelope], b"\x00", at=5)
        said = "block 5 came after 1"
    elif how == "previous":
        chain.append([envelope], b"\x00", previous=b"x" * 32)
        said = "does not continue the chain"
    elif how == "data":
        chain.append([envelope], b"\x00")
        chain.blocks[-1] = chain.blocks[-1].replace(b"n" * 24, b"m" * 24)
        said = "data_hash"
    else:
        other = new_chain()
        other.add(facts.put_uav(), facts.put_uav("uav-2"))
        other.add(facts.put_uav("uav-3"))
        source = source_of(other)
        said = "another block 1"
    mirror, status = new_mirror(source)
    await asyncio.wait_for(mirror.run(), 5)
    assert status.halted is not None
    assert said in status.halted
    assert await digest(database) == before


@pytest.mark.parametrize("batch", [1, 2_000])
async def test_valid_blocks_before_a_contradiction_are_kept(database, new_mirror, chain, source_of, facts, tx, batch):
    chain.add(facts.put_pad())
    chain.append([chain.envelope(tx(), "0" * 64)], b"\x00", previous=b"x" * 32)
    mirror, status = new_mirror(source_of(chain), batch_transactions=batch)
    await asyncio.wait_for(mirror.run(), 5)
    assert status.halted is not None
    assert len(await rows(database, PadRow)) == 1


class Silent:
    """A channel whose Deliver service sends what `source` has, and then nothing."""

    def __init__(self, of):
        self.of = of

    async def height(self):
        return await self.of.height()

    async def blocks(self, start_block):
        return contextlib.aclosing(self.of.blocks(start_block))


async def test_a_peer_that_says_it_has_more_and_sends_nothing_is_named(
    new_mirror, chain, source_of, facts, monkeypatch
):
    monkeypatch.setattr(source, "SILENT_S", 0.05)
    chain.add(facts.put_pad())
    sent = source_of(chain)
    sent.limit = 1
    mirror, status = new_mirror(GatewaySource(Silent(sent)), sleep=asyncio.sleep)
    task = asyncio.create_task(mirror.run())
    async with asyncio.timeout(5):
        while status.problem is None:
            await asyncio.sleep(0.01)
    assert "2 blocks, and has sent none" in status.problem
    assert (status.connected, status.mirrored) == (False, 1)
    sent.limit = None
    async with asyncio.timeout(5):
        while status.mirrored < 2:
            await asyncio.sleep(0.01)
    # One that has sent all that it has may be silent for as long as it likes.
    opened = sent.opened
    await asyncio.sleep(0.3)
    assert (sent.opened, status.problem, status.connected) == (opened, None, True)
    task.cancel()


async def test_another_channel_is_refused(new_mirror, chain, source_of):
    mirror, _ = new_mirror(source_of(chain))
    await mirror.run_until(1)
    mirror, status = new_mirror(source_of(chain), channel="other")
    await asyncio.wait_for(mirror.run(), 5)
    assert "mirrors channel wonderland" in status.halted


@both
async def test_two_mirrors_of_one_database_do_not_both_write(database, new_mirror, chain, source_of, facts):
    chain.add(facts.put_pad())
    first, _ = new_mirror(source_of(chain))
    await first.run_until(chain.height)
    position = await store.position(database)
    chain.add(facts.put_uav())
    second, _ = new_mirror(source_of(chain))
    await second.run_until(chain.height)
    from wonderland_backend.mirror.derive import Changes, derive
    from wonderland_fabric_gateway.blocks import parse_block

    changes = Changes()
    derive(parse_block(chain.blocks[-1]), "pol", changes)
    with pytest.raises(MirrorHalted, match="Another mirror"):
        await store.save(database, "wonderland", position, changes)
    assert len(await rows(database, BlockRow)) == 3


async def test_a_shorter_ledger_is_waited_for(new_mirror, new_chain, source_of, facts):
    chain = new_chain()
    fill(chain, facts, 2)
    mirror, _ = new_mirror(source_of(chain))
    await mirror.run_until(chain.height)
    shorter = new_chain()
    mirror, status = new_mirror(source_of(shorter))
    running = asyncio.create_task(mirror.run())
    try:
        await until(lambda: status.problem is not None)
        assert "has only 1 blocks" in status.problem
        assert status.halted is None
        assert not status.connected
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)


async def test_a_shorter_ledger_of_other_blocks_halts_it(database, new_mirror, new_chain, source_of, facts):
    """A database of another network: no waiting makes that good, and it is said before a single block is read."""
    chain = new_chain()
    fill(chain, facts, 4)
    mirror, _ = new_mirror(source_of(chain))
    await mirror.run_until(chain.height)
    before = await digest(database)
    other = new_chain()
    other.add(facts.put_uav("another"))
    mirror, status = new_mirror(source_of(other))
    await asyncio.wait_for(mirror.run(), 20)
    assert "another block 1 than the one that was mirrored" in status.halted
    assert "rebuild" in status.halted
    assert await digest(database) == before
