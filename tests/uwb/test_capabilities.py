"""What nodes say that they can do: real answers, hostile ones, and which assurance they bear."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland.uwb.reach import reach
from wonderland_fira_uci.uci.capabilities import (
    Capabilities,
    DeviceRoles,
    DeviceTypes,
    MultiNodeModes,
    RangingMethods,
    RframeConfigs,
    ScheduleModes,
    StsConfigs,
    decode_capabilities,
)
from wonderland_fira_uci.uci.config import decode_parameters, encode_parameters
from wonderland_fira_uci.uci.errors import UciDecodeError
from wonderland_simulator.uci_node import IDEAL as IDEAL_PROFILE
from wonderland_simulator.uci_node import PICA as PICA_PROFILE

# The first 18 of 26 parameters that a Qorvo DWM3001CDK (QM33 SDK, UCI 2.0.0) answered, as captured in the public
# repository EstebanMenti/i-mop-qorvo-uci-script; the rest is not at hand here.
DWM3001CDK = bytes.fromhex(
    "12 00020301 0102ff00 020402000200 030402000200 040103 05020300 06021e00 070119 080103 090102 0a0102 0b0101"
    "0c0101 0d0101 0e0109 0f010a 100101 11013f"
)
# What google/pica (e6fd445) answers, read off its port: it announces UCI 2.0 and numbers as UCI 1 does.
PICA = bytes.fromhex(
    "1b 000401010103 010401010103 020103 03011f 04011f 0501ff 060101 070101 080100 090101 0a0101 0b01ff 0c01ff 0d01ff"
    "0e01ff 0f01ff 1001ff e30101 110101 a4020100 a50100 a60100 a70400000000 a001ff a104ffffffff a301ff a201ff"
)
IDEAL = decode_capabilities(encode_parameters(list(IDEAL_PROFILE.capabilities)))
BOARD = decode_capabilities(DWM3001CDK)


def test_the_captured_answer_of_a_dwm3001cdk() -> None:
    wanted = Capabilities(
        max_message_octets=0x0103,
        max_data_payload_octets=255,
        phy_versions=("2.0", "2.0"),
        mac_versions=("2.0", "2.0"),
        device_types=DeviceTypes.CONTROLLER | DeviceTypes.CONTROLEE,
        device_roles=DeviceRoles.RESPONDER | DeviceRoles.INITIATOR,
        ranging_methods=RangingMethods.SS_TWR_DEFERRED
        | RangingMethods.DS_TWR_DEFERRED
        | RangingMethods.SS_TWR
        | RangingMethods.DS_TWR,
        sts_configs=StsConfigs.STATIC | StsConfigs.PROVISIONED | StsConfigs.PROVISIONED_RESPONDER_KEY,
        multi_node_modes=MultiNodeModes.UNICAST | MultiNodeModes.ONE_TO_MANY,
        time_structures=2,
        schedule_modes=ScheduleModes.TIME_SCHEDULED,
        hopping=True,
        block_striding=True,
        initiation_time=True,
        channels=(5, 9),
        rframe_configs=RframeConfigs.SP1 | RframeConfigs.SP3,
        constraint_lengths=(3,),
        bprf_sets=(1, 2, 3, 4, 5, 6),
    )
    said = decode_capabilities(DWM3001CDK)
    assert said == wanted
    assert said.prf_modes == ("bprf",)


def test_the_numbers_of_uci_1_are_told_by_their_shape_whatever_version_is_announced() -> None:
    said = decode_capabilities(PICA, 0x0002)
    assert said.phy_versions == ("1.1", "1.3")
    assert said.device_roles == DeviceRoles.RESPONDER | DeviceRoles.INITIATOR
    assert said.channels == (5, 6, 8, 9, 10, 12, 13, 14)
    assert said.device_types is None
    assert (said.unknown, said.skipped) == ((), 9)
    nothing_of_versions = encode_parameters([(0x0B, b"\x08")])
    assert decode_capabilities(nothing_of_versions, 0x1001).channels == (9,)
    assert decode_capabilities(nothing_of_versions, 0x0002).channels is None


def test_values_in_place_of_bits_are_told_by_what_no_node_can_be() -> None:
    """pica says schedule mode 1 and time structure 1, and means the values: time-scheduled, blocks."""
    assert decode_parameters(PICA) == list(PICA_PROFILE.capabilities)
    said = decode_capabilities(PICA, 0x0002)
    assert (said.schedule_modes, said.time_structures) == (ScheduleModes.TIME_SCHEDULED, 2)
    found = reach({"A1": said}, said)
    assert found.level == 2
    assert {each.capability for each in found.missing} == {
        "the role of an UL-TDoA synchronisation anchor",
        "the role of an UL-TDoA tag",
    }
    # Bits stay bits: a node that has blocks, and contention only, has no time-scheduled ranging.
    contention = PICA.replace(bytes.fromhex("060101"), bytes.fromhex("060102"))
    assert decode_capabilities(contention, 0x0002).schedule_modes == ScheduleModes.CONTENTION
    assert "time-scheduled" in str(reach({"A1": decode_capabilities(contention, 0x0002)}).missing[0])


def test_what_is_not_known_is_kept_and_what_is_a_vendors_is_skipped() -> None:
    said = decode_capabilities(
        encode_parameters([(0x05, b"\xff\xff"), (0x7F, b"new"), (0xA0, b""), (0xFF, bytes(255))])
    )
    assert said.unknown == ((0x7F, b"new"),)
    assert said.skipped == 2
    assert said.device_roles == 0xFFFF  # bits of a later standard stay


@pytest.mark.parametrize(
    ("body", "why"),
    [
        ("", "count octet is missing"),
        ("01", "ends beyond"),
        ("01 05", "ends beyond"),
        ("01 05 02 03", "ends beyond"),
        ("01 05 ff 03", "ends beyond"),
        ("ff 05 01 03", "number 2 of 255"),
        ("00 05 01 03", "octets follow"),
        ("01 05 00", "device_roles has 0 octets"),
        ("01 05 09 000000000000000000", "device_roles has 9 octets"),
        ("01 02 03 010101", "phy_versions has 3 octets"),
        ("01 0b 02 0101", "hopping has 2 octets"),
        ("01 1d 05 0102030405", "min_slot_rstu has 5 octets"),
        ("02 05 01 03 05 01 1f", "comes twice"),
        ("02 02 04 01010200 01 05 0101020000", "max_data_payload_octets has 5 octets"),
    ],
)
def test_answers_that_contradict_themselves(body: str, why: str) -> None:
    with pytest.raises(UciDecodeError, match=why):
        decode_capabilities(bytes.fromhex(body))


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=300), st.none() | st.integers(0, 0xFFFF))
def test_any_octets_are_capabilities_or_a_decode_error(body: bytes, version: int | None) -> None:
    try:
        said = decode_capabilities(body, version)
    except UciDecodeError:
        return
    assert said.skipped + len(said.unknown) <= body[0]
    reach({"A1": said}, said, {"W1": said})


@settings(max_examples=100, deadline=None)
@given(st.integers(0, len(DWM3001CDK) - 1), st.integers(0, 255))
def test_every_truncation_and_every_lying_octet_of_a_real_answer(at: int, octet: int) -> None:
    with pytest.raises(UciDecodeError):
        decode_capabilities(DWM3001CDK[:at])
    try:
        decode_capabilities(DWM3001CDK[:at] + bytes((octet,)) + DWM3001CDK[at + 1 :])
    except UciDecodeError as error:
        assert str(error)  # noqa: PT017 - any text, and no other exception


@settings(max_examples=200, deadline=None)
@given(st.dictionaries(st.integers(0x20, 0xFF), st.binary(max_size=20), max_size=8))
def test_parameters_of_others_change_nothing(extra: dict[int, bytes]) -> None:
    parameters = [*IDEAL_PROFILE.capabilities, *extra.items()]
    said = decode_capabilities(encode_parameters(parameters))
    assert said.unknown == tuple((i, v) for i, v in extra.items() if i < 0xA0)
    assert replace(said, unknown=(), skipped=0) == IDEAL


# --- which assurance they bear ---------------------------------------------------------------------------------------


def test_able_nodes_reach_everything() -> None:
    found = reach({"A1": IDEAL, "A2": IDEAL, "A3": IDEAL}, IDEAL, {"W1": IDEAL, "W2": IDEAL})
    assert (found.level, found.missing) == (4, ())


def test_a_dwm3001cdk_bears_two_and_says_what_it_lacks_for_three() -> None:
    found = reach({"A1": BOARD, "A2": BOARD})
    assert found.level == 2
    assert [str(each) for each in found.missing] == [
        "assurance 3: A1 cannot do UL-TDoA",
        "assurance 3: A1 cannot do the role of an UL-TDoA synchronisation anchor",
        "assurance 3: A2 cannot do UL-TDoA",
        "assurance 3: A2 cannot do the role of an UL-TDoA anchor",
    ]


def test_one_node_of_several_is_named() -> None:
    static = replace(IDEAL, sts_configs=StsConfigs.STATIC)
    found = reach({"A1": IDEAL, "A2": static}, IDEAL)
    assert found.level == 1
    assert [(each.node, each.capability) for each in found.missing] == [("A2", "provisioned STS")]
    found = reach({"A1": IDEAL}, BOARD)
    assert found.level == 2
    assert {each.node for each in found.missing} == {"the drone's node"}
    found = reach({"A1": IDEAL}, IDEAL, {"W1": IDEAL, "W2": BOARD})
    assert found.level == 3
    assert {each.node for each in found.missing} == {"W2 of the witness"}


def test_only_the_node_that_speaks_has_to_initiate() -> None:
    responder = replace(IDEAL, device_roles=IDEAL.device_roles & ~DeviceRoles.INITIATOR)
    assert reach({"A1": IDEAL, "A2": responder}, words="initiator").level == 4
    assert reach({"A1": responder, "A2": IDEAL}, words="initiator").level == 0
    assert reach({"A1": responder, "A2": responder}).level == 4  # its words ride in responses
    assert reach({}, responder).level == 0


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"ranging_methods": RangingMethods.UL_TDOA}, "deferred DS-TWR"),
        ({"multi_node_modes": MultiNodeModes.UNICAST}, "one-to-many"),
        ({"schedule_modes": ScheduleModes.CONTENTION}, "time-scheduled"),
        ({"rframe_configs": RframeConfigs.SP0}, "frames SP1"),
        ({"rframe_configs": RframeConfigs.SP3}, "frames SP1"),
        ({"channels": ()}, "channel"),
        ({"bprf_sets": ()}, "base pulse rate"),
        ({"device_roles": DeviceRoles.INITIATOR}, "the role of a responder"),
        ({"device_types": DeviceTypes.CONTROLLER}, "the part of a controlee"),
        ({"min_slot_rstu": 25_000}, "slots of 20 ms"),
        ({"max_data_payload_octets": 20}, "data of 48 octets"),
        ({"max_message_octets": 60}, "data of 48 octets"),
    ],
)
def test_what_two_way_ranging_needs(change: dict[str, object], word: str) -> None:
    found = reach({"A1": replace(IDEAL, **change)})  # type: ignore[arg-type]
    assert found.level == 0
    assert word in str(found.missing[0])


def test_nodes_range_on_whatever_channel_all_of_them_have() -> None:
    five = replace(IDEAL, channels=(5,))
    assert reach({"A1": five, "A2": IDEAL}, five).level == 4
    found = reach({"A1": five, "A2": IDEAL}, replace(IDEAL, channels=(9,)))
    assert found.level == 0
    assert "a channel that all have" in str(found.missing[0])
    assert "channel 9" in str(reach({"A1": five}, channel=9).missing[0])
    assert reach({"A1": five}, region="EU").level == 4
    assert "region JP" in str(reach({"A1": five}, region="JP").missing[0])


def test_a_node_that_says_nothing_is_not_taken_for_able() -> None:
    found = reach({"A1": Capabilities()})
    assert found.level == 0
    assert not any(each.told for each in found.missing)
    assert "does not say" in str(found.missing[0])
