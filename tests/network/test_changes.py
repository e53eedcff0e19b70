"""Changes of a channel as its members sign them: what each computes, who counts, and files that lie."""

from __future__ import annotations

import os
import time
from dataclasses import replace

import pytest
from fabric_protos.common import common_pb2, configtx_pb2
from fabric_protos.orderer import configuration_pb2 as orderer_pb2
from fabric_protos.orderer.smartbft import configuration_pb2 as bft_pb2

from wonderland.proofs import encoding
from wonderland_fabric_gateway.ca.local import Kind, LocalCa
from wonderland_fabric_gateway.channel_groups import OrganisationDescription
from wonderland_fabric_gateway.identity import SigningIdentity
from wonderland_fabric_gateway.signing import key_file_signer
from wonderland_fabric_gateway.verification.channel_trust import ChannelTrust
from wonderland_fabric_network.changes import (
    Batching,
    ChannelChange,
    count,
    require_same,
    require_true_cards,
    sha256,
    signed,
    update_of,
)
from wonderland_fabric_network.description import NetworkDescription, Ordering, OrderingOrganisation, Organisation
from wonderland_fabric_network.errors import ChannelUpdateError, DescriptionError
from wonderland_fabric_network.genesis import ChannelPlan, Consenter, first_block
from wonderland_fabric_network.membership import MemberCard

NOW_S = int(time.time())  # which the CAs go by
MEMBERS = ("AuthorityMSP", "PadMSP", "FleetMSP")
EMPTY = ChannelChange(channel="wonderland", update_sha256="0" * 64, remove="FleetMSP")


class Organisations:
    """Some, with CAs of their own."""

    def __init__(self, root):
        self.root, self.cas = root, {}
        for msp_id in (*MEMBERS, "Pad2MSP", "OrdererMSP"):
            self.cas[msp_id] = LocalCa.create(root / msp_id, msp_id)
        self.admins = {msp_id: self.enrolled(msp_id, "admin") for msp_id in self.cas}

        ca = self.cas["OrdererMSP"]
        self.consenters = tuple(
            Consenter(
                number + 1,
                "OrdererMSP",
                "127.0.0.1",
                7050 + number,
                ca.enrol(f"orderer{number}", node_ou="orderer", kind=Kind.TLS).certificate_pem,
                ca.enrol(f"orderer{number}", node_ou="orderer").certificate_pem,
            )
            for number in range(4)
        )

    def enrolled(self, msp_id, unit):
        name = f"its-{unit}-{len(list(self.root.iterdir()))}"
        enrolment = self.cas[msp_id].enrol(name, node_ou=unit)
        enrolment.write(self.root, f"{msp_id}-{unit}")
        return SigningIdentity(enrolment.identity, key_file_signer(self.root / f"{msp_id}-{unit}.key"))

    def described(self, msp_id):
        ca = self.cas[msp_id]
        return OrganisationDescription(msp_id, ca.root_pem(), ca.root_pem(Kind.TLS))

    def trust(self, members, ordering=None):
        consenters = self.consenters[: (ordering or Ordering()).count]
        plan = ChannelPlan(
            "wonderland",
            tuple(self.described(each) for each in members),
            (self.described("OrdererMSP"),),
            consenters,
            ordering or Ordering(),
        )
        block = common_pb2.Block.FromString(first_block(plan, NOW_S, bytes(24)))
        return ChannelTrust.of(0, block.data.data[0])

    def card(self, msp_id, **fields):
        ca = self.cas[msp_id]
        document = {
            "msp_id": msp_id,
            "network_sha256": "a" * 64,
            "contract": {"version": "1.0", "sha256": "a" * 64},
            "t_s": NOW_S,
            "host": "pads2.example",
            "root": ca.root_pem().decode(),
            "tls_root": ca.root_pem(Kind.TLS).decode(),
            "kind": "pads",
            "peers": [{"port": 7051}],
        }
        return MemberCard.parse(document | fields)


@pytest.fixture(scope="module")
def organisations(tmp_path_factory):
    return Organisations(tmp_path_factory.mktemp("organisations"))


@pytest.fixture(scope="module")
def trust(organisations):
    return organisations.trust(MEMBERS)


def change_of(trust, **what):
    change = replace(EMPTY, **{"remove": None, **what})
    update = update_of(change, trust, Ordering())
    return replace(change, update_sha256=sha256(update)), update


def test_members_who_have_the_same_channel_compute_the_same_update(organisations, trust):
    card = organisations.card("Pad2MSP")
    change, update = change_of(trust, admit=card)
    again = ChannelChange.read(change.to_bytes(), "x")
    assert again == change
    assert update_of(again, organisations.trust(MEMBERS), Ordering()) != b""
    assert update_of(again, trust, Ordering()) == update
    require_same(again, update)
    parsed = configtx_pb2.ConfigUpdate.FromString(update)
    assert set(parsed.write_set.groups["Application"].groups) == {*MEMBERS, "Pad2MSP"}
    assert not parsed.write_set.groups["Application"].policies["Admins"].policy.value, "no policy is changed"
    assert not parsed.write_set.groups["Orderer"].values


def test_what_is_so_already_needs_no_update(organisations):
    with_it = organisations.trust((*MEMBERS, "Pad2MSP"))
    change = replace(EMPTY, remove=None, admit=organisations.card("Pad2MSP"))
    assert update_of(change, with_it, Ordering()) is None
    assert update_of(replace(EMPTY, remove="Pad2MSP"), organisations.trust(MEMBERS), Ordering()) is None
    assert update_of(replace(EMPTY, remove="Pad2MSP"), with_it, Ordering()) is not None


def test_a_majority_of_administrators_is_enough_and_nobody_counts_twice(organisations, trust):
    change, update = change_of(trust, admit=organisations.card("Pad2MSP"))
    pads, fleet = organisations.admins["PadMSP"], organisations.admins["FleetMSP"]
    change = signed(change, update, [pads], os.urandom)
    assert signed(change, update, [pads], os.urandom) == change
    found = count(change, update, trust, NOW_S * 1_000)
    assert (found.signed, found.missing, found.enough) == (("PadMSP",), ("AuthorityMSP", "FleetMSP"), False)
    other = signed(replace(change, signatures=()), update, [pads], os.urandom)
    twice = change.merged(other)
    assert len(twice.signatures) == 2
    assert not count(twice, update, trust, NOW_S * 1_000).enough
    assert count(signed(twice, update, [fleet], os.urandom), update, trust, NOW_S * 1_000).enough


@pytest.mark.parametrize(
    ("who", "unit", "says"),
    [
        ("FleetMSP", "client", "is no administrator"),
        ("Pad2MSP", "admin", "nobody who may sign this"),
        ("OrdererMSP", "admin", "no organisation of the section Application"),
    ],
)
def test_who_has_no_say_is_named(organisations, trust, who, unit, says):
    change, update = change_of(trust, remove="FleetMSP")
    change = signed(change, update, [organisations.enrolled(who, unit)], os.urandom)
    with pytest.raises(ChannelUpdateError, match=says):
        count(change, update, trust, NOW_S * 1_000)


def test_whose_certificate_has_ended_does_not_count(organisations, trust):
    change, update = change_of(trust, remove="FleetMSP")
    change = signed(change, update, [organisations.admins["PadMSP"]], os.urandom)
    with pytest.raises(ChannelUpdateError, match="nobody who may sign this"):
        count(change, update, trust, (NOW_S + 20 * 366 * 86_400) * 1_000)


def test_a_change_that_was_altered_after_it_was_signed_is_refused(organisations, trust):
    change, update = change_of(trust, admit=organisations.card("Pad2MSP"))
    change = signed(change, update, [organisations.admins["PadMSP"]], os.urandom)
    lie = replace(change, admit=organisations.card("Pad2MSP", host="203.0.113.9"))
    other = update_of(lie, trust, Ordering())
    with pytest.raises(ChannelUpdateError, match="does not say what its signatures are for"):
        require_same(lie, other)
    lie = replace(lie, update_sha256=sha256(other))
    with pytest.raises(ChannelUpdateError, match="the signature of PadMSP is not one over this change"):
        count(lie, other, trust, NOW_S * 1_000)
    with pytest.raises(DescriptionError, match="different changes"):
        change.merged(lie)


def test_a_newcomer_with_anothers_roots_or_name_is_refused(organisations, trust):
    theirs = organisations.card("FleetMSP")
    with pytest.raises(ChannelUpdateError, match="shows a root of FleetMSP"):
        change_of(trust, admit=organisations.card("Pad2MSP", root=theirs.root))
    with pytest.raises(ChannelUpdateError, match="shows a root of FleetMSP"):
        change_of(trust, admit=organisations.card("Pad2MSP", tls_root=theirs.tls_root))
    with pytest.raises(ChannelUpdateError, match="FleetMSP takes part already, with another root"):
        change_of(trust, admit=replace(organisations.card("Pad2MSP"), msp_id="FleetMSP"))


def test_a_roster_with_a_false_card_is_found_out_on_the_channel(organisations, trust):
    cards = [organisations.card(each) for each in MEMBERS]
    require_true_cards([*cards, organisations.card("Pad2MSP")], trust)
    for field in ("root", "tls_root"):
        lie = replace(cards[2], **{field: cards[1].root})
        with pytest.raises(DescriptionError, match="the card of FleetMSP shows a root that is not the one"):
            require_true_cards([*cards[:2], lie], trust)


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"kind": None}, "does not say what it will do"),
        ({"peers": ()}, "or has no peers"),
        ({"msp_id": "padmsp"}, "each organisation needs its own name"),
        ({"kind": "authority"}, "exactly one must have kind authority"),
    ],
)
def test_a_card_that_is_no_newcomers_changes_no_description(organisations, fields, says):
    card = replace(organisations.card("Pad2MSP"), **fields)
    with pytest.raises(DescriptionError, match=says):
        replace(EMPTY, remove=None, admit=card).applied(NetworkDescription())


@pytest.mark.parametrize("consensus", ["raft", "bft"])
def test_other_blocks_are_decided_by_who_orders_them(organisations, consensus):
    ordering = Ordering(consensus=consensus, organisations=(OrderingOrganisation(msp_id="OrdererMSP", orderers=4),))
    trust = organisations.trust(MEMBERS, ordering)
    change = replace(EMPTY, remove=None, batching=Batching(timeout_ms=50, count=100))
    update = update_of(change, trust, ordering)
    values = configtx_pb2.ConfigUpdate.FromString(update).write_set.groups["Orderer"].values
    assert orderer_pb2.BatchTimeout.FromString(values["BatchTimeout"].value).timeout == "50ms"
    size = orderer_pb2.BatchSize.FromString(values["BatchSize"].value)
    assert (size.max_message_count, size.preferred_max_bytes > 0) == (100, True)
    if consensus == "bft":
        kind = orderer_pb2.ConsensusType.FromString(values["ConsensusType"].value)
        options = bft_pb2.Options.FromString(kind.metadata)
        assert (options.request_batch_max_interval, options.request_batch_max_count) == ("50ms", 100)
    else:
        assert "ConsensusType" not in values
    change = signed(change, update, [organisations.admins["OrdererMSP"]], os.urandom)
    assert count(change, update, trust, NOW_S * 1_000).enough
    same = replace(change, batching=Batching(timeout_ms=20, count=500))
    assert update_of(same, trust, ordering) is None


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({}, "no change of a channel"),
        ({"remove": "FleetMSP", "batching": {"timeout_ms": 1, "count": 1}}, "exactly one of admit, remove, batching"),
        ({"remove": "Fleet MSP"}, "remove: 'Fleet MSP' does not match"),
        ({"batching": {"timeout_ms": 0, "count": 1}}, "batching.timeout_ms: 0 is outside"),
        ({"remove": "FleetMSP", "signatures": [{"header": "?", "signature": "AA"}]}, r"signatures\[0\].header"),
        ({"remove": "FleetMSP", "update": "AA"}, "update: unknown field"),
    ],
)
def test_a_file_that_is_no_change_says_why(fields, says):
    document = {"channel": "wonderland", "update_sha256": "0" * 64} | fields
    with pytest.raises(DescriptionError, match=says):
        ChannelChange.read(encoding.encode(document), "a.change")


def test_a_header_of_nonsense_is_said_to_be_none(organisations, trust):
    change, update = change_of(trust, remove="FleetMSP")
    change = signed(change, update, [organisations.admins["PadMSP"]], os.urandom)
    broken = replace(change, signatures=(replace(change.signatures[0], header=encoding.to_base64url(b"\xff" * 9)),))
    with pytest.raises(ChannelUpdateError, match="header"):
        count(broken, update, trust, NOW_S * 1_000)


def test_the_description_of_a_change(organisations):
    before = NetworkDescription()
    admit = replace(EMPTY, remove=None, admit=organisations.card("Pad2MSP"))
    after = admit.applied(before)
    assert after.organisations[-1] == Organisation(msp_id="Pad2MSP", kind="pads", peers=1)
    assert replace(EMPTY, remove="Pad2MSP").applied(after) == before
