"""Every transaction leaves its record, its event, and nothing else; who listens misses none and sees none twice."""

import asyncio

import pytest
from kit.scenario_world import also_with_the_node_client

from wonderland.proofs import encoding
from wonderland.proofs.records.transactions import TRANSACTIONS
from wonderland_fabric_gateway.checkpoints import Checkpoint, FileCheckpointer
from wonderland_fabric_gateway.gateway import Gateway, StreamError, UnknownTransactionError
from wonderland_fabric_gateway.identity import Identity

pytestmark = pytest.mark.timeout(300)


class Listener:
    """Somebody who hears the contract's events from a block on."""

    def __init__(self, people, start_block):
        self._stream = people["mirror"].network.chaincode_events(people.connection.chaincode, start_block=start_block)

    async def __aenter__(self):
        await self._stream.__aenter__()
        self._events = aiter(self._stream)
        return self

    async def __aexit__(self, *error):
        await self._stream.__aexit__(*error)

    async def next(self):
        return await asyncio.wait_for(anext(self._events), 60)


async def height(people):
    return await people["mirror"].network.height()


@also_with_the_node_client
async def test_every_transaction_has_its_event(people, site):
    """A pad, a drone, a policy and an asset, from their beginning to their end."""
    start = await height(people)
    told = set()
    pad_id, uav_id = f"{site.pad_id}-b", f"{site.uav_id}-b"
    scene = site.scene()
    valid = {"valid_from_ms": people.now_ms - 60_000, "valid_until_ms": people.now_ms + 10**10}
    pad = await people.enrol("pad", pad_id)
    uav = await people.enrol("uav", uav_id)
    operator, fleet, admin, inspector = site.operator, site.fleet, site.admin, people["inspector"]
    asset = {"id": f"asset-{uav_id}", "type": "std_msgs/msg/String", "media_type": "text/plain"}
    landing = {"pad_id": pad_id, "action": "land"}
    async with Listener(people, start) as listener:

        async def happens(who, function, argument=None, /, **fields):
            """Submitted and committed: the record that the event tells of is the one that was answered."""
            done, answer = await who.submitted(function, argument, **fields)
            event = await listener.next()
            assert (event.name, event.tx_id) == (TRANSACTIONS[function].event, done.tx_id)
            assert event.block_number == done.block_number
            payload = encoding.decode(event.payload)
            assert (payload["kind"], payload["tx_id"]) == (event.name, done.tx_id)
            (transaction,) = [
                each for each in (await people.block(done.block_number)).transactions if each.tx_id == done.tx_id
            ]
            assert transaction.timestamp_ms == payload["t_ms"]
            assert transaction.event.payload == event.payload
            told.add(function)
            return answer, payload["record"]

        async def tells(who, function, argument=None, /, **fields):
            answer, record = await happens(who, function, argument, **fields)
            assert record == answer
            return answer

        await tells(operator, "RegisterPad", scene.pad_argument(pad_id))
        await tells(operator, "UpdatePad", pad_id=pad_id, note="Mind the crane")
        await tells(operator, "CommissionPad", pad_id=pad_id, commissioning=scene.commissioning(**valid))
        await tells(operator, "SetSitePlan", pad_id=pad_id, site_plan_sha256="1" * 64)
        prekeys = [{"prekey_id": f"k{index}", "public_key": scene.point(90 + index)} for index in range(2)]
        await tells(pad, "PublishPrekeys", pad_id=pad_id, prekeys=prekeys)
        _, proposed = await happens(
            admin, "ProposePolicy", landing, policy={"buffer_mm": 1500, "reservation_ms": 600_000}
        )
        assert (proposed["state"], proposed["policy"]["policy"]["buffer_mm"]) == ("open", 1500)
        assert await admin.query("ReadChange", change_id=proposed["change_id"]) == proposed
        _, approved = await happens(people["inspector"], "ApproveChange", scene.approval(proposed))
        assert (approved["state"], approved["policy"]["pad_id"]) == ("approved", pad_id)
        _, other = await happens(admin, "ProposePolicy", landing, policy={"buffer_mm": 1600})
        await tells(admin, "WithdrawChange", change_id=other["change_id"], reason="too wide")

        until_ms = valid["valid_until_ms"]
        await tells(admin, "SetClosures", pad_id=pad_id, closures=[], valid_until_ms=until_ms)

        await tells(fleet, "RegisterUav", scene.uav_argument(uav_id))
        maintenance = {"performed_ms": people.now_ms - 60_000, "valid_until_ms": valid["valid_until_ms"]}
        await tells(fleet, "RecordMaintenance", scene.maintenance(uav_id=uav_id, **maintenance))
        await tells(inspector, "GrantAuthorisation", scene.authorisation(uav_id=uav_id, pad_id=pad_id, **valid))

        span = {"from_ms": people.now_ms, "until_ms": people.now_ms + 600_000}
        (kept,) = (await tells(fleet, "ReservePad", pad_id=pad_id, uav_id=uav_id, **span))["reservations"]
        await tells(operator, "CancelReservation", pad_id=pad_id, reservation_id=kept["reservation_id"])

        session = await tells(uav, "RequestProof", site.scene().request_argument("k0", pad_id=pad_id))
        evidence = site.scene().evidence(session, signer=uav)
        people.later(2_500)
        verdict = await tells(pad, "SubmitProof", session_id=session["session_id"], evidence=evidence)
        assert verdict["permission"] == "granted"
        await tells(uav, "CompleteInteraction", session_id=session["session_id"], result="done")
        await tells(operator, "RecordDeparture", session_id=session["session_id"], note="carried away")
        here = {"uav_id": uav_id, "pad_id": pad_id}
        measured = scene.calibration(session["session_id"], **here, valid_until_ms=people.now_ms + 10**9)
        await tells(operator, "CalibrateUav", measured)
        await tells(fleet, "WithdrawCalibration", here, reason="another antenna")
        session = await tells(uav, "RequestProof", site.scene().request_argument("k1", pad_id=pad_id))
        await tells(operator, "GivePrecedence", session_id=session["session_id"], reason="a patient")
        await tells(uav, "CancelProof", session_id=session["session_id"], reason="operator")
        await tells(uav, "ReportLanding", pad_id=pad_id, cause="pilot", claim=site.scene().claim())

        await tells(inspector, "SetUavStatus", uav_id=uav_id, status="suspended", reason="inspection")
        _, lifted = await happens(inspector, "ProposeReinstatement", uav_id=uav_id, reason="inspected")
        await happens(admin, "ApproveChange", scene.approval(lifted))
        await tells(inspector, "RevokeAuthorisation", uav_id=uav_id, authorisation_id="a1", reason="over")
        await tells(fleet, "SetUavStatus", uav_id=uav_id, status="retired", reason="sold")
        await tells(operator, "RetirePad", pad_id=pad_id, reason="the roof is sold")

        created, record = await happens(uav, "CreateAsset", asset, value="1")
        assert "value" not in record
        assert len(record["value_sha256"]) == 64
        await happens(uav, "UpdateAsset", id=asset["id"], value="2")
        await happens(uav, "DeleteAsset", id=asset["id"])
        assert created["value"] == "1"
        log = {"log": f"log-{uav_id}", "seq": 7, "sha256": "2" * 64}
        mirror = await people.enrol("mirror", f"mirror-{uav_id}")
        anchored = await tells(mirror, "AnchorAuditLog", log)
        about = {"anchored_by": anchored["anchored_by"]}
        assert (await site.mirror.query("ListAuditHeads", about))["heads"] == [anchored]
    with_a_witness = {"WitnessProof"}  # in test_endorsement
    assert told | with_a_witness == {name for name, each in TRANSACTIONS.items() if each.event}
    assert (await site.mirror.query("ReadPolicy", landing))["buffer_mm"] == 1500
    assert (await site.mirror.query("ReadPad", pad_id=pad_id))["status"] == "retired"
    await operator.is_refused(422, "PAD_RETIRED", "UpdatePad", pad_id=pad_id, note="x")


async def test_a_query_changes_nothing_even_when_it_is_submitted(people, site):
    done, answer = await people["mirror"].submitted("ReadPad", pad_id=site.pad_id)
    assert answer["pad_id"] == site.pad_id
    (transaction,) = [each for each in (await people.block(done.block_number)).transactions if each.tx_id == done.tx_id]
    assert list(transaction.writes) == []
    assert transaction.event is None


async def test_a_listener_goes_on_where_it_stopped(people, site, tmp_path):
    """Nothing is missed and nothing heard twice, wherever between two events it ends; also in the middle of a block."""
    start = await height(people)
    written = [f"{site.pad_id}-{number}" for number in range(6)]
    asset = {"type": "std_msgs/msg/String", "media_type": "text/plain", "value": "1"}
    await asyncio.gather(*(site.uav.submit("CreateAsset", asset, id=name) for name in written))
    checkpointer = FileCheckpointer(tmp_path / "checkpoint.json")
    heard = []
    for _ in range(6):
        stream = people["mirror"].network.chaincode_events(
            people.connection.chaincode, start_block=start, checkpointer=checkpointer
        )
        async with stream:
            event = await asyncio.wait_for(anext(aiter(stream)), 60)
            heard.append(encoding.decode(event.payload)["record"]["id"])
            checkpointer.save(event.checkpoint)
    assert sorted(heard) == written


async def test_a_checkpoint_of_another_ledger_is_said(people, tmp_path):
    checkpointer = FileCheckpointer(tmp_path / "checkpoint.json")
    checkpointer.save(Checkpoint(1, "00" * 32))
    stream = people["mirror"].network.chaincode_events(people.connection.chaincode, checkpointer=checkpointer)
    with pytest.raises(UnknownTransactionError):
        async with asyncio.timeout(60), stream:
            await anext(aiter(stream))


async def test_blocks_form_one_chain_and_their_outlines_agree(people, site):
    top = await height(people)
    previous = None
    network = people["mirror"].network
    async with network.blocks(start_block=0) as whole, network.filtered_blocks(start_block=0) as outlined:
        blocks, outlines = aiter(whole), aiter(outlined)
        for number in range(top):
            block, outline = await anext(blocks), await anext(outlines)
            assert block.number == outline.number == number
            if previous is not None:
                block.require_follows(previous.header)
            previous = block
            assert [(each.tx_id, each.validation_code) for each in block.transactions] == [
                (each.tx_id, each.validation_code) for each in outline.transactions
            ]
    assert previous is not None


async def test_nobody_hears_blocks_who_is_not_of_the_channel(people, site):
    """A certificate of one organisation under another one's name."""
    forged = Identity.from_file("PadMSP", people.connection.identities["uav"].certificate)
    signer = people.connection.signer("uav")
    network = Gateway(people.channel, forged, signer).network(people.connection.channel)
    with pytest.raises(StreamError):
        async with asyncio.timeout(60), network.blocks(start_block=0) as stream:
            await anext(aiter(stream))
