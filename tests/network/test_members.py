"""Members who found a network together: cards that lie or are mixed up, and three of them with Fabric's own servers."""

from __future__ import annotations

import asyncio
import json
import os
import re
import subprocess
import sys
from dataclasses import replace

import pytest

from wonderland.proofs import encoding
from wonderland_fabric_gateway.ca.local import Kind, LocalCa
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_fabric_network.agreement import ContractDiffersError
from wonderland_fabric_network.cards import keep_cards, load_membership
from wonderland_fabric_network.description import NetworkDescription
from wonderland_fabric_network.errors import DescriptionError, DirectoryStateError
from wonderland_fabric_network.layout import NetworkDirectory
from wonderland_fabric_network.lifecycle import Definition
from wonderland_fabric_network.membership import MemberCard, Membership, shared_sha256
from wonderland_fabric_network.network import Network
from wonderland_fabric_network.peers import CommittedDefinition
from wonderland_fabric_network.ports import Ports
from wonderland_fabric_network.with_others import WithOthers

YAML = b"""
organisations:
- {msp_id: AuthorityMSP, kind: authority}
- {msp_id: PadMSP, kind: pads}
- {msp_id: FleetMSP, kind: fleet}
ordering:
  organisations: [{msp_id: AuthorityOrdererMSP}, {msp_id: PadOrdererMSP}, {msp_id: FleetOrdererMSP}]
"""
DESCRIPTION = NetworkDescription.from_yaml(YAML)
PARTS = ("Authority", "Pad", "Fleet")


@pytest.fixture(scope="module")
def cards(tmp_path_factory):
    """Of all six organisations, by CAs of our own."""
    found = {}
    for part in PARTS:
        for msp_id, orderers in ((f"{part}MSP", 0), (f"{part}OrdererMSP", 1)):
            ca = LocalCa.create(tmp_path_factory.mktemp("ca") / msp_id, msp_id)
            tls = ca.enrol("orderer0", node_ou="orderer", kind=Kind.TLS, hosts=["127.0.0.1"]).certificate_pem.decode()
            identity = ca.enrol("orderer0", node_ou="orderer").certificate_pem.decode()
            document = {
                "msp_id": msp_id,
                "network_sha256": shared_sha256(DESCRIPTION),
                "contract": {"version": "1.0", "sha256": "a" * 64},
                "t_s": 1_790_000_000 + len(found),
                "host": "127.0.0.1",
                "root": ca.root_pem().decode(),
                "tls_root": ca.root_pem(Kind.TLS).decode(),
                "peers": [] if orderers else [{"port": 7051}],
                "orderers": [{"port": 7050, "tls_certificate": tls, "identity": identity}] * orderers,
            }
            found[msp_id] = MemberCard.parse(document)
    return found


def changed(card, **fields):
    return encoding.encode(card.to_json() | fields)


def test_a_card_says_nothing_secret_and_is_read_as_it_was_written(cards):
    for card in cards.values():
        assert MemberCard.read(card.to_bytes(), "x") == card
        assert b"PRIVATE" not in card.to_bytes()


def test_everybody_makes_the_same_block_of_the_same_cards_and_another_one_of_others(cards):
    whole = Membership(("PadMSP",)).with_cards(cards.values(), DESCRIPTION)
    backwards = Membership(("FleetMSP",)).with_cards(reversed(list(cards.values())), DESCRIPTION)
    assert whole.missing(DESCRIPTION) == ()
    assert whole.founding() == backwards.founding()
    for name, value in {
        "host": "10.0.0.9",
        "peers": [{"port": 9}],
        "t_s": 5,
        "tls_root": cards["PadMSP"].tls_root,
    }.items():
        liar = MemberCard.read(changed(cards["FleetMSP"], **{name: value}), "x")
        lied_to = Membership(("PadMSP",)).with_cards([*({**cards, "FleetMSP": liar}).values()], DESCRIPTION)
        assert lied_to.founding()[1] != whole.founding()[1], name


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"network_sha256": "b" * 64}, "for another description"),
        ({"contract": {"version": "1.1", "sha256": "b" * 64}}, "has contract 1.1"),
        ({"msp_id": "OtherMSP"}, "no such organisation"),
        ({"peers": []}, "network.yaml has 1 and 0"),
        ({"peers": [{"port": 7051}] * 2}, "network.yaml has 1 and 0"),
        ({"t_s": 7}, "is another than the one that is known"),
    ],
)
def test_a_card_that_does_not_fit_is_refused(cards, fields, says):
    known = Membership(("PadMSP",)).with_cards(
        [cards["PadMSP"], *([cards["FleetMSP"]] if "t_s" in fields else [])], DESCRIPTION
    )
    liar = MemberCard.read(changed(cards["FleetMSP"], **fields), "x")
    with pytest.raises(DescriptionError, match=re.escape(says)):
        known.with_cards([liar], DESCRIPTION)


def test_nobody_takes_ones_own_name(cards):
    known = Membership(("PadMSP",)).with_cards([cards["PadMSP"]], DESCRIPTION)
    with pytest.raises(DescriptionError, match="another than this directory's own"):
        known.with_cards([replace(cards["PadMSP"], root=cards["FleetMSP"].root)], DESCRIPTION)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "no card"),
        (b"[]", "no card"),
        (b"x" * 300_000, "no card"),
        (b"-----BEGIN CERTIFICATE-----", "no card"),
    ],
)
def test_what_is_no_card_is_refused(data, says):
    with pytest.raises(DescriptionError, match=f"a.card: {says}"):
        MemberCard.read(data, "a.card")


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"root": "-----BEGIN CERTIFICATE-----"}, "root: no PEM certificate"),
        ({"msp_id": "../../x"}, "msp_id"),
        ({"host": "-x"}, "host"),
        ({"key": "secret"}, "key: unknown field"),
        ({"peers": [{"port": 0}]}, "port"),
    ],
)
def test_a_card_with_nonsense_names_the_field(cards, fields, says):
    with pytest.raises(DescriptionError, match=re.escape(says)):
        MemberCard.read(changed(cards["PadMSP"], **fields), "x")


def test_servers_of_another_ca_are_refused(cards):
    orderer = cards["PadOrdererMSP"].to_json()["orderers"][0]
    for field in ("identity", "tls_certificate"):
        foreign = orderer | {field: cards["FleetOrdererMSP"].to_json()["orderers"][0][field]}
        with pytest.raises(DescriptionError, match=f"orderers\\[0\\].{field}: was not issued by the root"):
            MemberCard.read(changed(cards["PadOrdererMSP"], orderers=[foreign]), "x")


def test_a_directory_knows_whose_keys_it_has(cards, tmp_path):
    directory = NetworkDirectory(tmp_path)
    assert load_membership(directory) is None
    directory.mine_file.write_text('{"mine": ["PadMSP"]}')
    keep_cards(directory, cards.values())
    found = load_membership(directory)
    assert (found.mine, dict(found.cards)) == (("PadMSP",), cards)
    directory.mine_file.write_text('{"mine": []}')
    with pytest.raises(DirectoryStateError, match="whose keys are here"):
        load_membership(directory)


class Peer:
    """Its channel has agreed on something."""

    def __init__(self, *, sequence, version, parameter):
        self.committed = CommittedDefinition(sequence, version, parameter, {})

    async def definition(self, *_):
        return self.committed


@pytest.mark.parametrize(
    ("version", "parameter", "same"), [("1.0", b"x", True), ("1.1", b"x", False), ("1.0", b"y", False)]
)
async def test_what_others_agreed_on_meanwhile_is_not_taken_for_ones_own(tmp_path, version, parameter, same):
    part = Network(NetworkDirectory(tmp_path), DESCRIPTION, Ports({}), membership=Membership(("FleetMSP",)))
    waiting = WithOthers(part, lambda *_: None)
    wanted = Definition("pol", 2, "1.0", b"x")
    assert not await waiting._committed(Peer(sequence=1, version="0.9", parameter=b"z"), wanted)
    peer = Peer(sequence=2, version=version, parameter=parameter)
    if same:
        assert await waiting._committed(peer, wanted)
    else:
        with pytest.raises(ContractDiffersError, match="the others agreed on another version or endorsement policy"):
            await waiting._committed(peer, wanted)


# --- with Fabric's own servers -----------------------------------------------------------------------------------------


class Part:
    """One member's machine: a directory of its own."""

    def __init__(self, root, name, first_port):
        self.directory, self.cards, self.name, self.root = root / name, root / f"{name}-cards", name, root
        self.first_port = first_port
        self.msp_ids = (f"{name}MSP", f"{name}OrdererMSP")

    def arguments(self, *arguments):
        return [sys.executable, "-m", "wonderland.cli", "network", *map(str, arguments), "--dir", str(self.directory)]

    def run(self, *arguments, code=0):
        answer = subprocess.run(self.arguments(*arguments), capture_output=True, text=True, timeout=120, check=False)
        assert answer.returncode == code, answer.stdout + answer.stderr
        return answer.stdout + answer.stderr

    def card(self, yaml):
        self.run("card", *self.msp_ids, "--file", yaml, "--first-port", self.first_port, "--to", self.cards)

    async def start(self, *arguments):
        return await asyncio.create_subprocess_exec(
            *self.arguments(*arguments), stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT
        )

    async def submit(self, identity, function, *arguments):
        connection = Connection.load(self.directory / "connection.json")
        async with connection.open_channel() as channel:
            gateway = Gateway(channel, connection.identity(identity), connection.signer(identity))
            contract = gateway.network(connection.channel).contract(connection.chaincode)
            return await contract.submit_with_retry(function, *arguments)

    @property
    def block(self):
        return (self.directory / "channel.block").read_bytes()


async def founded(parts):
    """All of them at once, as on as many machines."""

    async def meets(part):
        others = [str(path) for each in parts if each is not part for path in sorted(each.cards.iterdir())]
        process = await part.start("meet", "--yes", *others)
        said = (await process.communicate())[0].decode()
        assert process.returncode == 0, said
        return said

    return await asyncio.gather(*(meets(part) for part in parts))


@pytest.fixture(scope="module")
def parts(fabric, tmp_path_factory):
    root = tmp_path_factory.mktemp("members")
    yaml = root / "network.yaml"
    yaml.write_bytes(YAML)
    first = 10_000 + 150 * (os.getpid() % 33)  # below the ports that other networks of the tests choose at random
    found = [Part(root, name, first + 30 * index) for index, name in enumerate(PARTS)]
    try:
        for part in found:
            part.card(yaml)
        yield found
    finally:
        for part in found:
            subprocess.run(part.arguments("down"), capture_output=True, timeout=60, check=False)


@pytest.mark.fabric
@pytest.mark.timeout(240)
async def test_three_members_found_a_network_and_none_has_anothers_keys(parts):
    authority, pads, fleet = parts
    early = pads.run("up", code=1)
    assert "the cards of AuthorityMSP, FleetMSP, AuthorityOrdererMSP, FleetOrdererMSP are not here yet" in early
    assert "missing yet" in pads.run("meet", *sorted(fleet.cards.iterdir()))
    said = await founded(parts)
    prints = {re.search(r"first block  (\S+)", each)[1] for each in said}
    assert len(prints) == 1
    assert authority.block == pads.block == fleet.block
    for part in parts:
        for key in [*part.directory.rglob("*.key"), *part.directory.rglob("keystore/*")]:
            owner = key.relative_to(part.directory / "organisations").parts[0]
            assert owner in part.msp_ids, key
        assert set(Connection.load(part.directory / "connection.json").authorities) == {part.msp_ids[0]}

    pad = {"pad_id": "pad-1", "name": "Roof", "operator_id": "skyport", "lat_e7": 604_500_000, "lon_e7": 222_600_000}
    await pads.submit("pad_operator", "RegisterPad", json.dumps(pad | {"height_mm": 12_000}))
    assert "network  up" in pads.run("up"), "once more"
    assert "decided with the others" in authority.run("add-org", "Pad2MSP", "--kind", "pads", code=1)
    assert "nothing to agree on" in authority.run("upgrade")
    assert "PadMSP.peer0" in pads.run("status")


@pytest.mark.fabric
@pytest.mark.timeout(240)
async def test_a_member_whose_machine_is_away_keeps_nobody_and_comes_back(parts):
    _, pads, fleet = parts
    fleet.run("down")
    pad = {"pad_id": "pad-2", "name": "Roof", "operator_id": "skyport", "lat_e7": 604_500_000, "lon_e7": 222_600_000}
    await pads.submit("pad_operator", "RegisterPad", json.dumps(pad | {"height_mm": 12_000}))
    fleet.run("up")
    heights = [json.loads(part.run("status", "--json")) for part in (pads, fleet)]
    tall = [next(each["height"] for each in found["components"] if each["kind"] == "peer") for found in heights]
    assert tall[0] == tall[1] >= 6


async def ended(process):
    async with asyncio.timeout(100):
        said = (await process.communicate())[0].decode()
    assert process.returncode == 0, said
    return said


async def together(parts, *arguments):
    """The same command on each machine at once."""
    return await asyncio.gather(*[ended(await part.start(*arguments)) for part in parts])


@pytest.mark.fabric
@pytest.mark.timeout(240)
async def test_a_pad_is_enrolled_and_renewed_and_its_keys_never_leave_it(parts, tmp_path):
    """By the CA of its organisation; each file that travels is one that anybody may read."""
    _, pads, _ = parts

    def enrol(*arguments, code=0):
        command = [sys.executable, "-m", "wonderland.cli", "enrol", *map(str, arguments)]
        answer = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
        assert answer.returncode == code, answer.stdout + answer.stderr
        return answer.stdout + answer.stderr

    place = tmp_path / "machine"
    asked = enrol("request", "roofs", "--role", "pad_operator", "--dir", place)
    shown = re.search(r"its code   (\S+)", asked)[1]
    file = pads.root / "roofs.request"
    file.write_bytes((place / "roofs.request").read_bytes())
    assert shown in pads.run("admit", file, "--yes")
    admission = pads.root / "roofs.admission"
    enrol("accept", admission, "--dir", place, "--yes")
    assert b"PRIVATE" not in file.read_bytes() + admission.read_bytes()
    keys = {path.name: path.read_bytes() for path in place.glob("*.key")}
    assert set(keys) == {"roofs.key", "client-tls.key"}
    everything = b"".join(path.read_bytes() for path in pads.directory.rglob("*") if path.is_file())
    assert not [name for name, key in keys.items() if key in everything]

    machine = Part(tmp_path, "machine", 0)
    await machine.submit("roofs", "RegisterPad", pad("pad-11"))
    before = {name: (place / name).read_bytes() for name in ("roofs.pem", "client-tls.pem")}
    assert "nothing ends within 30 days" in enrol("renew", "--dir", place)
    renewed = enrol("renew", "--dir", place, "--days", 3_650)
    assert renewed.count("renewed") == 2
    assert all((place / name).read_bytes() != pem for name, pem in before.items())
    assert keys == {path.name: path.read_bytes() for path in place.glob("*.key")}
    await machine.submit("roofs", "RegisterPad", pad("pad-12"))

    enrol("request", "roofs", "--role", "pad", "--dir", tmp_path / "other")
    assert "another role or id" in pads.run("admit", tmp_path / "other" / "roofs.request", "--yes", code=1)
    enrol("request", "peer0", "--role", "pad", "--dir", tmp_path / "node")
    assert "belongs to the network itself" in pads.run("admit", tmp_path / "node" / "peer0.request", "--yes", code=1)
    pads.run("revoke", "roofs")
    refused = enrol("renew", "--dir", place, "--days", 3_650, code=1)
    assert "the certificate is not (or no longer) one that this CA accepts" in refused
    enrol("request", "roofs", "--role", "pad_operator", "--dir", tmp_path / "again")
    again = pads.run("admit", tmp_path / "again" / "roofs.request", "--yes", code=1)
    assert "roofs" in again
    assert not (tmp_path / "again" / "roofs.admission").exists()


@pytest.fixture(scope="module")
def newcomer(parts):
    """Another operator of pads, with a machine of its own, that has read a roster and given its card."""
    part = Part(parts[0].root, "Pad2", parts[0].first_port + 90)
    part.msp_ids = ("Pad2MSP",)
    roster = part.root / "wonderland.roster"
    told = parts[2].run("roster", "--to", roster)
    try:
        said = part.run(
            *("card", "Pad2MSP", "--roster", roster, "--kind", "pads", "--yes"),
            *("--first-port", part.first_port, "--to", part.cards),
        )
        assert re.search(r"first block  (\S+)", said)[1] == re.search(r"first block  (\S+)", told)[1]
        yield part
    finally:
        subprocess.run(part.arguments("down"), capture_output=True, timeout=60, check=False)


def pad(pad_id):
    place = {"operator_id": "skyport", "lat_e7": 604_500_000, "lon_e7": 222_600_000, "height_mm": 12_000}
    return json.dumps({"pad_id": pad_id, "name": "Roof", **place})


@pytest.mark.fabric
@pytest.mark.timeout(300)
async def test_a_newcomer_is_admitted_by_a_majority_and_its_signature_counts(parts, newcomer):
    authority, pads, fleet = parts
    waiting = await newcomer.start("up")  # before anybody admitted it
    file, copy = authority.root / "admit.change", authority.root / "copy.change"
    card = newcomer.cards / "Pad2MSP.card"
    said = authority.run("propose", "--admit", card, "--yes", "--to", file)
    assert "joins        Pad2MSP: operates pads" in said
    assert "a majority   is 3 of 4 (was 2 of 3)" in said
    print_ = re.search(r"its card     (\S+),", said)[1]
    assert print_ == MemberCard.read(card.read_bytes(), "x").fingerprint
    assert "Not enough yet" in said
    assert "missing are FleetMSP, PadMSP" in fleet.run("submit", file, code=1)

    lie = json.loads(file.read_text())
    for field, value, why in (
        ("host", "203.0.113.9", "does not say what its signatures are for"),
        ("network_sha256", "b" * 64, "for another channel"),
        ("root", json.loads((fleet.cards / "FleetMSP.card").read_text())["root"], "shows a root of FleetMSP"),
    ):
        copy.write_bytes(encoding.encode(lie | {"admit": lie["admit"] | {field: value}}))
        assert why in pads.run("sign", copy, "--yes", code=1)
    copy.write_bytes(file.read_bytes())
    both = pads.run("sign", copy, "--yes")
    assert "That is enough" in both
    assert "signed by    AuthorityMSP, PadMSP" in both
    assert "made in block" in fleet.run("submit", file, copy)
    for part in (authority, pads):
        assert "noted here" in part.run("submit", copy)
        assert "noted here" in part.run("submit", copy), "twice"
    assert "Pad2MSP" in await ended(waiting)

    said = await together([*parts, newcomer], "upgrade")
    assert all("sequence 2, endorsement AND('AuthorityMSP.peer', OR('PadMSP.peer', 'Pad2MSP.peer'))" in x for x in said)
    assert "nothing to agree on" in fleet.run("upgrade")
    await newcomer.submit("pad_operator", "RegisterPad", pad("pad-9").replace("skyport", "roofs"))
    for key in [*newcomer.directory.rglob("*.key"), *newcomer.directory.rglob("keystore/*")]:
        assert key.relative_to(newcomer.directory / "organisations").parts[0] == "Pad2MSP"
    newcomer.run("down")
    newcomer.run("up")


@pytest.mark.fabric
@pytest.mark.timeout(300)
async def test_members_change_the_blocks_and_one_leaves_again(parts, newcomer):
    authority, pads, fleet = parts
    file = authority.root / "batching.change"
    assert "20 ms → 50 ms" in pads.run("propose", "--batch", 50, 100, "--yes", "--to", file)
    assert "Pad2MSP has no say" in newcomer.run("sign", file, "--yes", code=1)
    assert "That is enough" in fleet.run("sign", file, "--yes")
    assert "made in block" in authority.run("submit", file)
    for part in (pads, fleet, newcomer):
        assert "noted here" in part.run("submit", file)
        assert NetworkDescription.load(part.directory / "network.yaml").ordering.batch_timeout_ms == 50

    file = authority.root / "remove.change"
    named = "the endorsement policy names Pad2MSP"
    assert named in authority.run("propose", "--remove", "Pad2MSP", "--yes", "--to", file, code=1)
    policy = "AND('AuthorityMSP.peer', 'PadMSP.peer')"
    newcomer.run("down")  # it does not agree that it leaves, nor need it
    said = await together(parts, "upgrade", "--endorsement", policy, "--without", "Pad2MSP")
    assert all("sequence 3" in each for each in said)
    authority.run("propose", "--remove", "Pad2MSP", "--yes", "--to", file)
    pads.run("sign", file, "--yes")
    assert "missing are FleetMSP, Pad2MSP" in pads.run("submit", file, code=1)
    fleet.run("sign", file, "--yes")
    assert "made in block" in fleet.run("submit", file)
    assert "noted here" in authority.run("submit", file)
    assert "noted here" in pads.run("submit", file)
    assert "so already" in pads.run("propose", "--remove", "Pad2MSP", "--yes", "--to", file, code=1)
    await pads.submit("pad_operator", "RegisterPad", pad("pad-10"))
    policy = "AND('PadMSP.peer', 'AuthorityMSP.peer')"
    await together([authority, pads], "upgrade", "--endorsement", policy, "--without", "FleetMSP")
    assert f"sequence 4, endorsement {policy}" in fleet.run("upgrade"), "it was away, and takes what holds"
    assert NetworkDescription.load(fleet.directory / "network.yaml").contract.endorsement == policy
    fleet.run("down")
    fleet.run("up")
