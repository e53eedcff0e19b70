"""Operators' numbers beside the ledger: committed to there, kept here, and what liars, crashes and edits do to them."""

from __future__ import annotations

import asyncio
import logging

import pytest
from kit.openings import NUMBER, fresh, told
from sqlalchemy import insert, select, text
from sqlalchemy.exc import IntegrityError

from wonderland_backend.db.tables import Base
from wonderland_backend.db.tables.audit import AuditRow
from wonderland_backend.db.tables.numbers import RegistrationNumberRow
from wonderland_backend.db.tables.signing import SignedTransactionRow
from wonderland_backend.mirror import rebuild as rebuilding
from wonderland_backend.transactions import store

ANOTHER = "SWE01abcdefghij2"


@pytest.fixture
def frida(house):
    frida = house.person("Frida", "fleet_operator", msp_id="FleetMSP")
    assert frida.enrol("fleet_operator", "frida").status_code == 201
    return frida


@pytest.fixture
def anna(house):
    return house.person("Anna", "inspector")


def drone(opening, **more):
    return {
        "uav_id": opening.uav_id,
        "operator_id": "arctic-air",
        "model": "Falcon 4",
        "registration_commitment": opening.commitment,
    } | more


def registered(house, somebody, opening):
    done = somebody.change("RegisterUav", drone(opening), opening=opening)
    if done["state"] == "valid":
        house.wait_mirrored(done["block"] + 1)
    return done


def rows(house, uav_id):
    async def read():
        async with house.backend.database.read() as database:
            query = select(RegistrationNumberRow).where(RegistrationNumberRow.uav_id == uav_id)
            return (await database.scalars(query)).all()

    return house.run(read())


def edit(house, statement, **values):
    async def write():
        async with house.backend.database.write() as connection:
            assert (await connection.execute(text(statement), values)).rowcount == 1

    house.run(write())


def shown(somebody, uav_id):
    return somebody.get(f"/registry/drones/{uav_id}").json()["drone"]["registration"]


def unmask(somebody, uav_id):
    body = {"uav_id": uav_id, "field": "registration", "reason": "Collision at Aurajoki"}
    return somebody.post("/unmask", body)


def everything_but_numbers(house):
    """All of the database as a text, but for the one table; and the bytes of the ledger's directory."""

    async def read():
        found = []
        async with house.backend.database.read() as database:
            for table in Base.metadata.sorted_tables:
                if table.name != RegistrationNumberRow.__tablename__:
                    found += [str(tuple(row)) for row in await database.execute(select(table))]
        return "\n".join(found)

    files = [path.read_bytes() for path in (house.directory / "ledger").rglob("*") if path.is_file()]
    return house.run(read()).encode() + b"".join(files)


def test_a_number_is_kept_here_and_nowhere_else(house, frida, anna, caplog):
    caplog.set_level(logging.DEBUG)
    opening = fresh("OH-NEW-1", ANOTHER)
    assert registered(house, frida, opening)["state"] == "valid"
    assert shown(frida, "OH-NEW-1") == {"state": "here", "number": ANOTHER}
    assert shown(anna, "OH-NEW-1") == {"state": "here", "number": "SWE---j2"}
    assert unmask(anna, "OH-NEW-1").json() == {"value": ANOTHER, "show_ms": 60_000}
    (row,) = rows(house, "OH-NEW-1")
    assert (row.stored_by, row.tx_id) == (frida.get("/me").json()["person"]["person_id"], None)
    all_else = everything_but_numbers(house)
    assert b"OH-NEW-1" in all_else
    assert opening.commitment.encode() in all_else
    for secret in (opening.salt, opening.registration):
        assert secret.encode() not in all_else
        assert bytes.fromhex(opening.salt) not in all_else
        assert secret not in caplog.text


@pytest.mark.parametrize(
    ("opening", "path"),
    [
        (None, "body.opening"),
        ({"registration": ANOTHER}, "body.opening"),
        ({"salt": "5" * 64}, "body.opening.salt"),
        ({"salt": "00" * 31 + "01"}, "body.opening.salt"),
        ({"registration": ANOTHER.lower()}, "body.opening.registration"),
        ({"registration": ANOTHER + "-xyz"}, "body.opening.registration"),
        ({"registration": "ÅÄÖ"}, "body.opening.registration"),
    ],
)
def test_what_does_not_open_the_commitment_is_refused_before_anything_is_kept(house, frida, opening, path):
    right = fresh("OH-BAD-1")
    body = {"function": "RegisterUav", "argument": drone(right), "certificate_sha256": frida.certificate_sha256}
    if opening is not None:
        body["opening"] = told(right) | opening
    answer = frida.post("/transactions/proposals", body)
    assert answer.status_code == 400, answer.text
    assert [each["path"] for each in answer.json()["errors"]] == [path]
    assert right.salt not in answer.text
    assert rows(house, "OH-BAD-1") == []
    assert "OH-BAD-1" not in frida.get("/transactions/proposals").text


def test_an_opening_belongs_to_a_commitment(house, frida):
    opening = fresh("OH-BAD-2")
    without = {name: value for name, value in drone(opening).items() if name != "registration_commitment"}
    assert frida.propose("RegisterUav", without, opening=opening).status_code == 400
    maintenance = {"uav_id": "OH-DRN-0417", "performed_ms": 1, "valid_until_ms": 2, "work": "x"}
    assert frida.propose("RecordMaintenance", maintenance, opening=opening).status_code == 400
    assert frida.change("RegisterUav", without)["state"] == "valid"
    other = drone(opening, uav_id="OH-BAD-3")
    assert frida.propose("RegisterUav", other, opening=opening).status_code == 400, "another drone's"


def test_a_salt_serves_once(house, frida):
    opening = fresh("OH-TWICE")
    first = frida.propose("RegisterUav", drone(opening), opening=opening)
    assert first.status_code == 201
    again = frida.propose("RegisterUav", drone(opening), opening=opening)
    assert (again.status_code, again.json()["type"]) == (409, "urn:wonderland:problem:conflict")
    assert len(rows(house, "OH-TWICE")) == 1


def test_two_officers_register_the_same_drone_and_the_number_of_the_one_that_counts_stays(house, frida, anna):
    fred = house.person("Fred", "fleet_operator", msp_id="FleetMSP")
    assert fred.enrol("fleet_operator", "fred").status_code == 201
    mine, theirs = fresh("OH-BOTH", NUMBER), fresh("OH-BOTH", ANOTHER)
    proposals = [(frida, mine), (fred, theirs)]
    ended = [
        (who, who.endorse(who.propose("RegisterUav", drone(its), opening=its).json()).json()) for who, its in proposals
    ]
    assert len(rows(house, "OH-BOTH")) == 2
    for who, endorsed in ended:
        assert who.submit(endorsed).status_code == 202
    states = [who.settled(endorsed["tx_id"]) for who, endorsed in ended]
    assert sorted(each["state"] for each in states) == ["invalid", "valid"]
    house.wait_mirrored()
    winner = proposals[[each["state"] for each in states].index("valid")][1]
    (row,) = rows(house, "OH-BOTH")
    assert (row.commitment, row.number, row.tx_id) == (winner.commitment, winner.registration, None)
    assert unmask(anna, "OH-BOTH").json()["value"] == winner.registration


def test_what_the_contract_refuses_leaves_no_number(house, frida):
    opening = fresh("OH-DRN-0417", ANOTHER)
    before = [row.commitment for row in rows(house, "OH-DRN-0417")]
    assert registered(house, frida, opening)["state"] == "refused"
    assert [row.commitment for row in rows(house, "OH-DRN-0417")] == before != []


def test_what_nobody_signs_is_forgotten_and_what_is_under_way_is_not(house, frida):
    left, signed = fresh("OH-LEFT"), fresh("OH-SIGNED")
    assert frida.propose("RegisterUav", drone(left), opening=left).status_code == 201
    proposed = frida.propose("RegisterUav", drone(signed), opening=signed).json()

    async def sweep(before_ms):
        async with house.backend.database.write() as connection:
            await store.sweep(connection, before_ms)

    house.run(sweep(house.now_ms() - 60_000))
    assert len(rows(house, "OH-LEFT")) == len(rows(house, "OH-SIGNED")) == 1
    edit(house, "UPDATE signed_transactions SET state = 'unknown' WHERE tx_id = :tx_id", tx_id=proposed["tx_id"])
    house.run(sweep(house.now_ms() + 1))
    assert (len(rows(house, "OH-LEFT")), len(rows(house, "OH-SIGNED"))) == (0, 1)


@pytest.mark.parametrize("when", ["proposed", "endorsed", "submitted", "committed"])
def test_a_crash_leaves_a_number_with_its_drone_and_none_without(house, frida, anna, when, monkeypatch):
    opening = fresh(f"OH-CRASH-{when}")
    proposed = frida.propose("RegisterUav", drone(opening), opening=opening).json()
    if when != "proposed":
        endorsed = frida.endorse(proposed).json()
    if when in {"submitted", "committed"}:
        # The server dies between writing down that it submits and hearing what became of it.
        async def never(_signing, _tx_id, *, begun):
            await asyncio.sleep(3_600)

        monkeypatch.setattr(type(house.backend.parts.signing), "_settle", never)
        frida.submit(endorsed)
    if when == "committed":

        async def hand_over():
            async with house.backend.database.read() as database:
                row = await database.get(SignedTransactionRow, proposed["tx_id"])
            signing = house.backend.parts.signing
            await signing._ledger.settle(signing._ledger.transaction(await signing._identity(row), row.transaction))

        house.run(hand_over())
    house.stop_backend()
    monkeypatch.undo()
    house.start_backend()
    if when in {"proposed", "endorsed"}:
        assert len(rows(house, opening.uav_id)) == 1, "ten minutes to sign"
        edit(house, "UPDATE signed_transactions SET created_ms = 1 WHERE tx_id = :tx_id", tx_id=proposed["tx_id"])
        house.stop_backend()
        house.start_backend()
        assert rows(house, opening.uav_id) == []
    else:
        assert frida.settled(proposed["tx_id"])["state"] == "valid"
        house.wait_mirrored()
        assert unmask(anna, opening.uav_id).json()["value"] == NUMBER
        assert rows(house, opening.uav_id)[0].tx_id is None


def compared(house):
    house.run(house.backend.row_check.once())
    return list(house.backend.parts.mirror.rows_differ)


EDITS = {
    "number": f"UPDATE registration_numbers SET number = '{ANOTHER}' WHERE uav_id = :uav_id",
    "salt": f"UPDATE registration_numbers SET salt = '{'0123456789abcdef' * 4}' WHERE uav_id = :uav_id",
    "rubbish": "UPDATE registration_numbers SET number = '<b>' WHERE uav_id = :uav_id",
    "whose": f"UPDATE registration_numbers SET number = '{ANOTHER}', uav_id = 'OH-OTHER' WHERE uav_id = :uav_id",
}


@pytest.mark.parametrize("which", EDITS)
def test_a_row_that_somebody_edited_is_found_and_its_number_never_shown(house, frida, anna, which):
    opening = fresh("OH-EDIT")
    assert registered(house, frida, opening)["state"] == "valid"
    assert compared(house) == []
    edit(house, EDITS[which], uav_id="OH-EDIT")
    assert shown(anna, "OH-EDIT") == shown(frida, "OH-EDIT") == {"state": "altered"}
    answer = unmask(anna, "OH-EDIT")
    assert answer.status_code == 409
    assert "somebody has changed it" in answer.json()["detail"]
    for text_ in (ANOTHER, NUMBER):
        assert text_ not in answer.text
        hits = anna.post("/search", {"q": text_}).json()["items"]
        assert "OH-EDIT" not in [each["id"] for each in hits]
    assert compared(house) == ["registration_numbers OH-EDIT"]


def test_a_row_under_another_commitment_is_nobodys(house, frida, anna):
    opening, false = fresh("OH-SWAP"), fresh("OH-SWAP", ANOTHER)
    assert registered(house, frida, opening)["state"] == "valid"
    statement = "UPDATE registration_numbers SET commitment = :c, number = :n, salt = :s WHERE uav_id = 'OH-SWAP'"
    edit(house, statement, c=false.commitment, n=ANOTHER, s=false.salt)
    assert shown(anna, "OH-SWAP") == {"state": "elsewhere", "held_by": "FleetMSP"}
    answer = unmask(anna, "OH-SWAP")
    assert answer.status_code == 404
    assert "FleetMSP" in answer.json()["detail"]


def test_a_commitment_copied_from_another_drone_opens_nothing(house, frida, anna):
    opening = fresh("OH-MINE")
    assert registered(house, frida, opening)["state"] == "valid"
    house.send("fleet_operator", "RegisterUav", drone(opening, uav_id="OH-COPY"))
    house.wait_mirrored()
    assert shown(anna, "OH-COPY") == {"state": "elsewhere", "held_by": "FleetMSP"}
    assert unmask(anna, "OH-COPY").status_code == 404
    listed = {
        each["record"]["uav_id"]: each["registration"]["state"] for each in anna.get("/registry/drones").json()["items"]
    }
    assert (listed["OH-MINE"], listed["OH-COPY"]) == ("here", "elsewhere")
    hits = [each["id"] for each in anna.post("/search", {"q": NUMBER}).json()["items"]]
    assert "OH-MINE" in hits
    assert "OH-COPY" not in hits
    assert compared(house) == []


def test_a_rebuild_keeps_the_numbers(house, frida, anna):
    opening = fresh("OH-KEEP")
    assert registered(house, frida, opening)["state"] == "valid"
    house.stop_backend()
    backend = house.backend

    async def rebuild():
        await rebuilding.rebuild(
            backend.database,
            backend.parts.source,
            channel=house.connection.channel,
            chaincode="pol",
            batch_transactions=50,
        )

    house.run(rebuild())
    house.run(backend.database.close())
    house.start_backend()
    house.wait_mirrored()
    assert unmask(anna, "OH-KEEP").json()["value"] == NUMBER


def test_the_log_says_who_saw_a_number_and_not_which(house, anna):
    assert unmask(anna, "OH-DRN-0417").status_code == 200

    async def read():
        async with house.backend.database.read() as database:
            return (await database.scalars(select(AuditRow))).all()

    audit = house.run(read())
    assert [row.subject for row in audit if row.act == "unmask"] == ["drone/OH-DRN-0417"]
    assert not [row for row in audit if NUMBER in str(vars(row))]


async def test_an_error_of_the_database_does_not_tell_what_was_to_be_stored(database):
    row = {"commitment": "c", "uav_id": "u", "number": NUMBER, "salt": "s3cret", "stored_ms": 1, "stored_by": "x"}
    with pytest.raises(IntegrityError) as caught:
        async with database.write() as connection:
            await connection.execute(insert(RegistrationNumberRow), [row])
            await connection.execute(insert(RegistrationNumberRow), [row])
    assert NUMBER not in str(caught.value)
    assert "s3cret" not in str(caught.value)
