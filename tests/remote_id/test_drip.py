"""DRIP: entity tags and authentication against the RFCs' own examples, then every way in which one can lie."""

from __future__ import annotations

import contextlib
import json

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland.telemetry import Drip
from wonderland_edge_agent.receiver import Assembler
from wonderland_remote_id import (
    Authentication,
    AuthenticationType,
    BasicId,
    IdType,
    Location,
    Pack,
    RemoteIdError,
    decode,
    encode,
    parse_serial_number,
)
from wonderland_remote_id.drip import (
    Det,
    DripError,
    Link,
    Manifest,
    Observer,
    PageAssembler,
    Registry,
    SamType,
    Wrapper,
    paginate,
    parse_sam,
)
from wonderland_remote_id.drip.det import cshake128, message_hash
from wonderland_remote_id.drip.formats import endorse, manifest_evidence, sign_evidence, verify

T0 = 1_800_000_000_000
# RFC 9575, appendix: one drone's tag and key, its messages, a Wrapper and a Manifest with parity.
DET = Det.parse("2001:3f:fe00:105:a29b:3ff4:2226:c04e")
KEY = bytes.fromhex("b5fef530d450dedb59ebafa18b00d7f5ed0ac08a81975034297bea2b00041813")
MESSAGES = [
    bytes.fromhex(line)
    for line in (
        "0240012001003ffe000105a29b3ff42226c04e000000000000",
        "12000000000000000000000000000000000000000060220000",
        "32004578616d706c652053656c662049440000000000000000",
        "420000000000000000000100000000000000000010ea510900",
        "52004578616d706c65204f70657261746f7220494400000000",
    )
]
WRAPPER = [
    "2250078b10ea510902e0dd7c6560115e671200000000000000",
    "22510000000000000000000000000060220000420000000000",
    "2252000000000100000000000000000010ea5109002001003f",
    "2253fe000105a29b3ff42226c04ef0ecad581a030ca790152a",
    "22542f08df5762a463e24a742d1c530ec977bbe0d113697e2b",
    "2255b909d6c7557bdaf1227ce86154b030daadda4a6b8474de",
    "22569a62f6c375020826000000000000000000000000000000",
    "2257f5e8eebcb04f8c2197526053e66c010d5d7297ff7c1fe0",
]
MANIFEST = [
    "225008b110ea510903e0dd7c6560115e670000000000000000",
    "2251d57594875f8608b4d61dc9224ecf8b842bd4862734ed01",
    "22522ca2e5f2b8a3e61547b81704766ba3eeb651be7eafc928",
    "22538884e3e28a24fd5529bc2bd4862734ed012ca2e5f2b8a3",
    "2254e61547b81704766ba3eeb62001003ffe000105a29b3ff4",
    "22552226c04efb729846e7d110903797066fd96f49a77c5a48",
    "2256c4c3b330be05bc4a958e9641718aaa31aeabad368386a2",
    "22579ed2dce2769120da83edbcdc0858dd1e357755e7860317",
    "2258e7c06a5918ea62a937391cbfe0983539de1b2e688b7c83",
]


def assembled(lines, lost=()):
    pages = PageAssembler()
    found = [pages.feed(decode(bytes.fromhex(line)), T0) for number, line in enumerate(lines) if number not in lost]
    return next((message for message in found if message is not None), None)


def test_cshake_is_nists() -> None:
    expected = "c1c36925b6409a04f1b504fcbca9d82b4017277cb5ed2b2065fc1d3814d5aaf5"
    assert cshake128(bytes(range(4)), b"Email Signature", 32).hex() == expected


def test_entity_tags_of_the_rfcs() -> None:
    assert DET.belongs_to(KEY)
    assert not DET.belongs_to(KEY[::-1])
    assert Det.of(KEY, raa=DET.raa, hda=DET.hda) == DET
    example = Det.parse("2001:30:280:1405:a3ad:1952:ad0:a69e")  # RFC 9374, section 5
    assert (example.raa, example.hda, example.suite) == (10, 20, 5)
    assert example.serial_number("8653") == "8653F02T7B8RA85D19LX"
    assert parse_serial_number(example.serial_number("8653")).manufacturer == "8653"
    assert Det.of_session_id(decode(MESSAGES[0]).uas_id) == DET
    assert Det.of_session_id(DET.session_id) == DET
    for wrong in ("02" + DET.session_id[2:], "zz", "", "01" + 38 * "0"):
        assert Det.of_session_id(wrong) is None
    for wrong in ("::1", "2001:40::", "nonsense"):
        with pytest.raises(DripError):
            Det.parse(wrong)
    with pytest.raises(DripError):
        Det.of(KEY, raa=1 << 14, hda=0)


@pytest.mark.parametrize("lost", [(), (0,), (3,), (6,), (7,)])
def test_the_rfcs_wrapper(lost) -> None:
    message = assembled(WRAPPER, lost)
    wrapper = parse_sam(message.data)
    assert isinstance(wrapper, Wrapper)
    assert wrapper.frames == (MESSAGES[1], MESSAGES[3])
    assert wrapper.signed.det == DET
    assert verify(KEY, wrapper.signed.signature, wrapper.signed.signed())
    assert message.restored == (lost in {(0,), (3,), (6,)})
    assert wrapper.signed.sam(SamType.WRAPPER) == message.data


def test_two_lost_pages_are_too_many() -> None:
    assert assembled(WRAPPER, (2, 3)) is None
    assert assembled(WRAPPER, (0, 7)) is None


def test_the_rfcs_manifest() -> None:
    manifest = parse_sam(assembled(MANIFEST).data)
    assert isinstance(manifest, Manifest)
    assert verify(KEY, manifest.signed.signature, manifest.signed.signed())
    assert manifest.is_consistent()
    assert {message_hash(frame) for frame in MESSAGES} <= set(manifest.message_hashes)


@pytest.mark.parametrize("length", [1, 16, 17, 18, 40, 63, 139, 177, 200, 201])
@pytest.mark.parametrize("parity", [False, True])
def test_pages_there_and_back(length, parity) -> None:
    data = bytes(range(1, length + 1))
    pages = paginate(data, T0, parity=parity)
    for lost in [None, *range(len(pages))] if parity else [None]:
        assembler = PageAssembler()
        found = [assembler.feed(decode(encode(page)), T0) for page in pages if page.page != lost]
        assert {message.data for message in found if message is not None} == {data}


def test_the_rfcs_padding() -> None:
    pages = paginate(assembled(WRAPPER).data, T0, parity=True)
    assert [encode(page).hex()[4:] for page in pages[1:6]] == [line[4:] for line in WRAPPER[1:6]]
    with pytest.raises(DripError):
        paginate(bytes(202), T0)


class Party:
    def __init__(self, raa: int, hda: int) -> None:
        self._private = Ed25519PrivateKey.generate()
        self.key = self._private.public_key().public_bytes_raw()
        self.det = Det.of(self.key, raa=raa, hda=hda)
        self.sign = self._private.sign


@pytest.fixture(name="world")
def _world():
    authority, drone = Party(10, 20), Party(10, 20)
    entry = {"det": str(authority.det), "host_identity": authority.key.hex(), "name": "HDA 20"}
    registry = Registry.parse({"registries": [entry]})
    link = endorse(drone.det, drone.key, authority.det, (T0 - 10_000, T0 + 86_400_000), authority.sign)
    return authority, drone, registry, link


def pack(*messages) -> bytes:
    return encode(Pack(messages=tuple(messages)))


def place(lat_e7: int = 601_700_000) -> Location:
    return Location(lat_e7=lat_e7, lon_e7=249_400_000)


def listen(observer: Observer, sam: bytes, *messages, now_ms: int = T0):
    pages = paginate(sam, T0)
    frame = pack(*messages, *pages)
    return observer.feed(frame, (*messages, *pages), now_ms)


def wrapped(drone: Party, *messages, times=(T0 - 1_000, T0 + 120_000), detached: bool = False) -> bytes:
    evidence = b"".join(encode(message) for message in messages)
    signed = sign_evidence(evidence, drone.det, times, drone.sign)
    if detached:
        return (
            bytes((SamType.WRAPPER,))
            + signed.sam(SamType.WRAPPER)[1:9]
            + signed.sam(SamType.WRAPPER)[9 + len(evidence) :]
        )
    return signed.sam(SamType.WRAPPER)


def test_a_drone_that_its_registry_vouches_for(world) -> None:
    _, drone, registry, link = world
    observer = Observer(registry)
    assert listen(observer, wrapped(drone, place())).state == "unknown_signer"
    first = listen(observer, link.sam())
    assert (first.state, first.format, first.signer) == ("endorsed", "link", "HDA 20")
    observer.feed(encode(place()), (place(),), T0)
    second = listen(observer, wrapped(drone, place()))
    assert (second.state, second.format, second.det, second.covers_location) == (
        "verified",
        "wrapper",
        str(drone.det),
        True,
    )
    assert not listen(observer, wrapped(drone, place(1))).covers_location, "a position that nobody broadcast"
    identity = BasicId(uas_id=drone.det.session_id, id_type=IdType.SPECIFIC_SESSION)
    third = listen(observer, wrapped(drone, identity, place(), detached=True), identity, place())
    assert (third.state, third.covers_location) == ("verified", True)
    assert listen(observer, wrapped(drone, identity, place(), detached=True), identity, place(5)).state == "refused"


def test_a_manifest_covers_what_was_heard(world) -> None:
    _, drone, registry, link = world
    observer = Observer(registry)
    listen(observer, link.sam())
    observer.feed(encode(place()), (place(),), T0)
    evidence = manifest_evidence(bytes(8), b"link", [encode(place()), b"another"])
    signed = sign_evidence(evidence, drone.det, (T0, T0 + 120_000), drone.sign)
    found = listen(observer, signed.sam(SamType.MANIFEST))
    assert (found.state, found.format, found.covers_location) == ("verified", "manifest", True)
    wrong = bytearray(evidence)
    wrong[8] ^= 1
    signed = sign_evidence(bytes(wrong), drone.det, (T0, T0 + 120_000), drone.sign)
    assert "own hash" in listen(observer, signed.sam(SamType.MANIFEST)).reason
    frame = sign_evidence(b"\x01data", drone.det, (T0, T0 + 120_000), drone.sign).sam(SamType.FRAME)
    assert listen(observer, frame).state == "verified"


def test_lies(world) -> None:
    authority, drone, registry, link = world
    observer = Observer(registry)
    forged = link.sam()[:-1] + bytes((link.sam()[-1] ^ 1,))
    assert "signature of HDA 20" in listen(observer, forged).reason
    stranger = Party(10, 20)
    stolen = endorse(drone.det, stranger.key, authority.det, (T0, T0 + 1), authority.sign)
    assert "not the hash" in listen(observer, stolen.sam()).reason
    old = endorse(drone.det, drone.key, authority.det, (T0 - 900_000, T0 - 800_000), authority.sign)
    assert "not valid" in listen(observer, old.sam()).reason
    unknown = endorse(drone.det, drone.key, stranger.det, (T0, T0 + 1), stranger.sign)
    assert listen(observer, unknown.sam()).state == "unknown_signer"
    listen(observer, link.sam())
    tampered = bytearray(wrapped(drone, place()))
    tampered[20] ^= 1
    assert "signature" in listen(observer, bytes(tampered)).reason
    replayed = wrapped(drone, place(), times=(T0 - 900_000, T0 - 780_000))
    assert "replay" in listen(observer, replayed).reason
    assert listen(observer, wrapped(drone, place()), now_ms=T0 + 2 * 86_400_000).state == "unknown_signer", (
        "key expired"
    )
    other = BasicId(uas_id=stranger.det.session_id, id_type=IdType.SPECIFIC_SESSION)
    observer.feed(encode(other), (other,), T0)
    assert "another entity tag" in listen(observer, wrapped(drone, place())).reason


def test_the_receiver_tells_who_signed_apart_from_the_position(world) -> None:
    _, drone, registry, link = world
    assembler = Assembler(T0, drip=registry)
    identity = BasicId(uas_id=drone.det.session_id, id_type=IdType.SPECIFIC_SESSION)

    def hear(*messages, now_ms: int):
        return assembler.feed(pack(*messages), source="ble:1", transport="ble5", now_ms=now_ms)

    hear(identity, *paginate(link.sam(), T0)[:8], now_ms=T0)
    for page in paginate(link.sam(), T0):
        assembler.feed(encode(page), source="ble:1", transport="ble4", now_ms=T0 + 50)
    heard = hear(identity, place(), now_ms=T0 + 100)
    assert heard.track.drip == Drip(
        state="endorsed",
        format="link",
        det=str(drone.det),
        t_ms=T0 + 50,
        signer="HDA 20",
        covers_location=False,
        bound=True,
    )
    for page in paginate(wrapped(drone, place()), T0):
        assembler.feed(encode(page), source="ble:1", transport="ble4", now_ms=T0 + 150)
    signed = hear(identity, place(601_700_001), now_ms=T0 + 160).track.drip
    assert (signed.state, signed.covers_location, signed.bound) == ("verified", True, True)
    for page in paginate(link.sam(), T0):
        assembler.feed(encode(page), source="ble:1", transport="ble4", now_ms=T0 + 170)
    assert hear(identity, place(601_700_002), now_ms=T0 + 180).track.drip == signed, "an endorsement takes nothing back"
    bad = bytearray(wrapped(drone, place()))
    bad[-1] ^= 1
    for page in paginate(bytes(bad), T0):
        assembler.feed(encode(page), source="ble:1", transport="ble4", now_ms=T0 + 200)
    assert [finding.body.kind for finding in assembler.findings()] == ["signature_bad"]
    assert hear(identity, place(601_700_003), now_ms=T0 + 300).track.drip.state == "refused"


def test_only_registries_endorse(world) -> None:
    """What the audit found: any drone that was endorsed could endorse others, of any registry."""
    authority, drone, registry, link = world
    assert registry.learn(link, T0).name == "HDA 20"
    times = (T0, T0 + 1_000)
    accomplice, foreigner = Party(10, 20), Party(10, 21)
    with pytest.raises(DripError, match="only registries"):
        registry.learn(endorse(accomplice.det, accomplice.key, drone.det, times, drone.sign), T0)
    with pytest.raises(DripError, match="another registry"):
        registry.learn(endorse(foreigner.det, foreigner.key, authority.det, times, authority.sign), T0)
    assert registry.find_identity(accomplice.det, T0) is None
    assert registry.find_identity(foreigner.det, T0) is None


def test_authority_comes_down_the_hierarchy() -> None:
    apex, raa, hda, drone = Party(0, 0), Party(10, 0), Party(10, 20), Party(10, 20)
    registry = Registry.parse({"registries": [{"det": str(apex.det), "host_identity": apex.key.hex(), "name": "Apex"}]})
    observer = Observer(registry)
    identity = BasicId(uas_id=drone.det.session_id, id_type=IdType.SPECIFIC_SESSION)
    observer.feed(encode(identity), (identity,), T0)
    for child, parent in ((raa, apex), (hda, raa)):
        link = endorse(child.det, child.key, parent.det, (T0, T0 + 1_000), parent.sign)
        assert listen(observer, link.sam()) is None, "it says nothing about the drone"
    own = endorse(drone.det, drone.key, hda.det, (T0, T0 + 1_000), hda.sign)
    assert listen(observer, own.sam()).state == "endorsed"
    skipping = endorse(hda.det, hda.key, apex.det, (T0, T0 + 1_000), apex.sign)
    assert "another registry" in listen(observer, skipping.sam()).reason


def test_a_link_that_somebody_repeats_proves_nothing(world) -> None:
    """What the audit found: a recorded Link made any serial number verified, without any key."""
    _, drone, registry, link = world
    assembler = Assembler(T0, drip=registry)
    borrowed = BasicId(uas_id="1581F5FKD229400A1234", id_type=IdType.SERIAL_NUMBER)

    def hear(*messages):
        return assembler.feed(pack(*messages), source="ble:1", transport="ble5", now_ms=T0).track.drip

    for page in paginate(link.sam(), T0):
        assembler.feed(pack(borrowed, page), source="ble:1", transport="ble5", now_ms=T0)
    vouched = hear(borrowed, place())
    assert (vouched.state, vouched.bound) == ("endorsed", False)
    made_of_it = BasicId(uas_id=drone.det.serial_number("1581"), id_type=IdType.SERIAL_NUMBER)
    for page in paginate(wrapped(drone, place()), T0):
        assembler.feed(pack(made_of_it, page), source="ble:2", transport="ble5", now_ms=T0)
    seen = assembler.feed(pack(made_of_it, place(1)), source="ble:2", transport="ble5", now_ms=T0).track.drip
    assert (seen.state, seen.bound) == ("verified", True)


def test_the_strongest_signature_since_a_session_began(world) -> None:
    _, drone, registry, link = world
    assembler = Assembler(T0, drip=registry)
    identity = BasicId(uas_id=drone.det.session_id, id_type=IdType.SPECIFIC_SESSION)

    def send(sam: bytes, now_ms: int) -> None:
        for page in paginate(sam, T0):
            assembler.feed(pack(identity, place(), page), source="ble:1", transport="ble5", now_ms=now_ms)

    assert assembler.signature(drone.det.session_id, T0) is None
    send(link.sam(), T0)
    assert assembler.signature(drone.det.session_id, T0).state == "endorsed"
    send(wrapped(drone, place()), T0 + 100)
    send(wrapped(drone, place())[:-1] + b"x", T0 + 200)
    send(link.sam(), T0 + 300)
    found = assembler.signature(drone.det.session_id, T0)
    assert (found.state, found.t_ms, found.covers_location, found.refused) == (
        "verified", T0 + 100, True, 1,
    )  # fmt: skip
    assert assembler.signature(drone.det.session_id, T0 + 250).state == "endorsed", "the session began later"


def test_a_link_is_of_the_entity_tag_in_the_basic_id(world) -> None:
    authority, _, registry, link = world
    observer, other = Observer(registry), Party(10, 20)
    identity = BasicId(uas_id=other.det.session_id, id_type=IdType.SPECIFIC_SESSION)
    observer.feed(encode(identity), (identity,), T0)
    assert "another entity tag" in listen(observer, link.sam()).reason
    own = endorse(other.det, other.key, authority.det, (T0, T0 + 1_000), authority.sign)
    assert listen(observer, own.sam()).state == "endorsed"


@pytest.mark.parametrize(
    ("document", "says"),
    [
        ([], "registries"),
        ({"registries": [3]}, r"registries\[0\]"),
        ({"registries": [{"det": 3, "host_identity": "", "name": ""}]}, "texts"),
        ({"registries": [{"det": str(DET), "host_identity": "zz"}]}, "hexadecimal"),
        ({"registries": [{"det": "::1", "host_identity": KEY.hex()}]}, "2001:30"),
        ({"registries": [{"det": str(DET), "host_identity": KEY[::-1].hex()}]}, "hash"),
        ({"registries": [{"det": str(DET), "host_identity": KEY.hex(), "x": 1}]}, r"registries\[0\]"),
    ],
)
def test_registries_that_cannot_be_believed(document, says, tmp_path) -> None:
    file = tmp_path / "registries.json"
    file.write_text(json.dumps(document))
    with pytest.raises(DripError, match=says):
        Registry.load(file)
    file.write_text("{")
    with pytest.raises(DripError, match="no JSON"):
        Registry.load(file)
    with pytest.raises(DripError, match="absent"):
        Registry.load(tmp_path / "absent")


@settings(max_examples=300, deadline=None)
@given(
    data=st.binary(max_size=220),
    kind=st.integers(0, 6),
    pages=st.lists(
        st.tuples(st.integers(0, 15), st.binary(max_size=23), st.integers(0, 15), st.integers(0, 255)), max_size=20
    ),
)
def test_garbage(data, kind, pages) -> None:
    for piece in (data, bytes((kind,)) + data, bytes((kind,)) + assembled(WRAPPER).data[1:][: len(data)]):
        with contextlib.suppress(RemoteIdError):
            sam = parse_sam(piece)
            if isinstance(sam, Link):
                assert sam.sam() == piece
    observer = Observer(Registry({}))
    for number, (page, body, last, length) in enumerate(pages):
        with contextlib.suppress(RemoteIdError):
            head = {} if page else {"last_page": last, "length": length, "t_ms": T0}
            message = Authentication(
                authentication_type=AuthenticationType.SPECIFIC_AUTHENTICATION,
                page=page,
                data=body[: 23 if page else 17],
                **head,
            )
            message = decode(encode(message))
            observer.feed(encode(message), (message,), T0 + number)
