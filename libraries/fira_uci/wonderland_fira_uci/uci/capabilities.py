"""What a node says that it can do: the answer to CORE_GET_CAPS_INFO as a record. Pure.

Source: FiRa UCI, "Device capability parameters": a count octet, then ``id length value`` for each, integers and bit
masks little-endian. UCI 1 and UCI 2 and 3 number the parameters differently (UCI 2 put the two sizes and the device
type in front), and google/pica announces UCI 2.0 with the numbers of UCI 1; so the numbering is told by where the two
version ranges stand, which alone have four octets, and by the node's UCI version only where neither is there.
pica also answers with the *values* of two parameters where bits are due (schedule mode 1, time-scheduled; time
structure 1, blocks). As bits both together would be a node that ranges in no way that FiRa still has: they are read as
values.
Ids from 0xA0 belong to the CCC, to Aliro, to platforms and to vendors: they are skipped, with whatever is in them.
Nothing in the answer names preamble codes: they follow from the parameter sets of the two pulse rates.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag
from typing import Final

from wonderland_fira_uci.uci.config import decode_parameters
from wonderland_fira_uci.uci.errors import UciDecodeError

FIRST_FOREIGN_ID: Final = 0xA0
MAX_MASK_OCTETS: Final = 8
"""Masks grow with the standard (roles: one octet in UCI 1, two since); more than this is no mask."""
MAX_SIZE_OCTETS: Final = 4
_VERSIONS_OCTETS: Final = 4
_VALUE_FOR_BIT: Final = 1
_CHANNELS: Final = (5, 6, 8, 9, 10, 12, 13, 14)


class DeviceTypes(IntFlag):
    """Who may decide about a session."""

    CONTROLLER = 1
    CONTROLEE = 2


class DeviceRoles(IntFlag):
    """What the node can be in a round; UT: uplink, DT: downlink time difference of arrival."""

    RESPONDER = 1
    INITIATOR = 2
    UT_SYNCHRONISATION_ANCHOR = 4
    UT_ANCHOR = 8
    UT_TAG = 16
    ADVERTISER = 32
    OBSERVER = 64
    DT_ANCHOR = 128
    DT_TAG = 256


class RangingMethods(IntFlag):
    """One-way (OWR), single-sided (SS) and double-sided (DS) two-way ranging."""

    UL_TDOA = 1
    SS_TWR_DEFERRED = 2
    DS_TWR_DEFERRED = 4
    SS_TWR = 8
    DS_TWR = 16
    DL_TDOA = 32
    OWR_AOA = 64
    ESS_TWR_CONTENTION = 128
    ADS_TWR_CONTENTION = 256
    DATA_TRANSFER = 512


class StsConfigs(IntFlag):
    """How the scrambled time-stamp sequence can be keyed."""

    STATIC = 1
    DYNAMIC = 2
    DYNAMIC_RESPONDER_KEY = 4
    PROVISIONED = 8
    PROVISIONED_RESPONDER_KEY = 16


class MultiNodeModes(IntFlag):
    """Topologies; the third is many to many in UCI 1 and 2, one to many with data in UCI 3."""

    UNICAST = 1
    ONE_TO_MANY = 2
    THIRD = 4


class ScheduleModes(IntFlag):
    """Who may speak when."""

    CONTENTION = 1
    TIME_SCHEDULED = 2
    HYBRID = 4


class RframeConfigs(IntFlag):
    """Packet forms: SP0 has no scrambled sequence, SP3 no payload."""

    SP0 = 1
    SP1 = 2
    SP2 = 4
    SP3 = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Capabilities:
    """What a node said. None: it did not say. Bits that no name is known for stay in the masks."""

    phy_versions: tuple[str, str] | None = None
    """Lowest and highest FiRa PHY version, ``"1.1"`` (``"1.1.2"`` with a maintenance number)."""
    mac_versions: tuple[str, str] | None = None
    """The same of the MAC."""
    device_types: DeviceTypes | None = None
    """UCI 1 has no such parameter."""
    device_roles: DeviceRoles | None = None
    ranging_methods: RangingMethods | None = None
    sts_configs: StsConfigs | None = None
    multi_node_modes: MultiNodeModes | None = None
    time_structures: int | None = None
    """Mask: bit 0 intervals, bit 1 blocks."""
    schedule_modes: ScheduleModes | None = None
    hopping: bool | None = None
    """Whether rounds can hop within their block."""
    block_striding: bool | None = None
    """Whether blocks can be left out."""
    initiation_time: bool | None = None
    """Whether a session's first round can be given a time."""
    channels: tuple[int, ...] | None = None
    rframe_configs: RframeConfigs | None = None
    constraint_lengths: tuple[int, ...] | None = None
    """Of the convolutional code: 3, 7."""
    bprf_sets: tuple[int, ...] | None = None
    """Parameter sets at the base pulse repetition frequency (preamble codes 9 to 24, 6.8 Mb/s), from 1."""
    hprf_sets: tuple[int, ...] | None = None
    """The same at the higher one (preamble codes 25 to 32, up to 31.2 Mb/s)."""
    angle_of_arrival: int | None = None
    """Mask: azimuth ±90°, azimuth ±180°, elevation, figure of merit."""
    extended_mac: bool | None = None
    """Whether 64-bit addresses are known."""
    suspend_ranging: bool | None = None
    session_key_lengths: int | None = None
    """Mask of keys of 256 bits: bit 0 for dynamic, bit 1 for provisioned STS."""
    dt_anchor_rounds: int | None = None
    """Active rounds as a downlink anchor; 0: not one."""
    dt_tag_rounds: int | None = None
    """The same as a downlink tag."""
    dt_tag_block_skipping: bool | None = None
    psdu_lengths: int | None = None
    """Mask: 2047, 4095 octets."""
    logical_links: int | None = None
    """Mask and counts of the link layer, as sent."""
    bypass_mode: bool | None = None
    """Whether data can go without the link layer."""
    min_slot_rstu: int | None = None
    """Shortest slot, in ranging scheduling time units (1200 in a millisecond)."""
    link_layer_version: int | None = None
    """Major in the upper half of the octet, minor in the lower."""
    max_message_octets: int | None = None
    """Largest data message of UCI that the node takes."""
    max_data_payload_octets: int | None = None
    """Largest payload of one data packet of UCI. How much goes into one frame on air no node says."""
    unknown: tuple[tuple[int, bytes], ...] = ()
    """Parameters of the standard's range that are not known here, as sent."""
    skipped: int = 0
    """How many parameters were the CCC's, Aliro's, a platform's or a vendor's."""

    @property
    def prf_modes(self) -> tuple[str, ...] | None:
        """``"bprf"``, ``"hprf"``: pulse repetition modes with at least one parameter set; None: nothing was said."""
        if self.bprf_sets is None and self.hprf_sets is None:
            return None
        return ("bprf",) * bool(self.bprf_sets) + ("hprf",) * bool(self.hprf_sets)


# Field, what it is, id in UCI 1 (−1: none), id since UCI 2.
_FIELDS: Final[tuple[tuple[str, str, int, int], ...]] = (
    ("max_message_octets", "size", 0x12, 0x00),
    ("max_data_payload_octets", "size", 0x13, 0x01),
    ("phy_versions", "versions", 0x00, 0x02),
    ("mac_versions", "versions", 0x01, 0x03),
    ("device_types", "mask", -1, 0x04),
    ("device_roles", "mask", 0x02, 0x05),
    ("ranging_methods", "mask", 0x03, 0x06),
    ("sts_configs", "mask", 0x04, 0x07),
    ("multi_node_modes", "mask", 0x05, 0x08),
    ("time_structures", "mask", 0x06, 0x09),
    ("schedule_modes", "mask", 0x07, 0x0A),
    ("hopping", "flag", 0x08, 0x0B),
    ("block_striding", "flag", 0x09, 0x0C),
    ("initiation_time", "flag", 0x0A, 0x0D),
    ("channels", "mask", 0x0B, 0x0E),
    ("rframe_configs", "mask", 0x0C, 0x0F),
    ("constraint_lengths", "mask", 0x0D, 0x10),
    ("bprf_sets", "mask", 0x0E, 0x11),
    ("hprf_sets", "mask", 0x0F, 0x12),
    ("angle_of_arrival", "mask", 0x10, 0x13),
    ("extended_mac", "flag", 0x11, 0x14),
    ("suspend_ranging", "flag", -1, 0x15),
    ("session_key_lengths", "mask", -1, 0x16),
    ("dt_anchor_rounds", "size", -1, 0x17),
    ("dt_tag_rounds", "size", -1, 0x18),
    ("dt_tag_block_skipping", "flag", -1, 0x19),
    ("psdu_lengths", "mask", -1, 0x1A),
    ("logical_links", "mask", -1, 0x1B),
    ("bypass_mode", "flag", -1, 0x1C),
    ("min_slot_rstu", "size", -1, 0x1D),
    ("link_layer_version", "size", -1, 0x1E),
)
_OCTETS: Final = {
    "size": range(1, MAX_SIZE_OCTETS + 1),
    "versions": range(_VERSIONS_OCTETS, _VERSIONS_OCTETS + 1),
    "mask": range(1, MAX_MASK_OCTETS + 1),
    "flag": range(1, 2),
}


def decode_capabilities(body: bytes, uci_version: int | None = None) -> Capabilities:
    """The answer's body behind its status octet; ``uci_version`` as in ``DeviceInfo``.

    Raises ``UciDecodeError`` where a count or a length contradicts what is there, a known parameter has a length that
    it cannot have, or one comes twice.
    """
    parameters = decode_parameters(body)
    ours = [(identifier, value) for identifier, value in parameters if identifier < FIRST_FOREIGN_ID]
    values = dict(ours)
    if len(values) != len(ours):
        raise UciDecodeError("CORE_GET_CAPS_INFO: a parameter comes twice")
    old = _numbered_as_uci_1(values, uci_version)
    numbers: dict[str, int] = {}
    versions: dict[str, tuple[str, str]] = {}
    for name, kind, first, second in _FIELDS:
        value = values.pop(first if old else second, None)
        if value is None:
            continue
        if len(value) not in _OCTETS[kind]:
            raise UciDecodeError(f"CORE_GET_CAPS_INFO: {name} has {len(value)} octets")
        if kind == "versions":
            versions[name] = _version(value[:2]), _version(value[2:])
        else:
            numbers[name] = int.from_bytes(value, "little")
    if numbers.get("time_structures") == numbers.get("schedule_modes") == _VALUE_FOR_BIT:
        numbers |= dict.fromkeys(("time_structures", "schedule_modes"), 1 << _VALUE_FOR_BIT)
    return _record(numbers, versions, tuple(values.items()), len(parameters) - len(ours))


def _numbered_as_uci_1(values: dict[int, bytes], uci_version: int | None) -> bool:
    for identifier, old in ((0x02, False), (0x03, False), (0x00, True), (0x01, True)):
        if len(values.get(identifier, b"")) == _VERSIONS_OCTETS:
            return old
    return uci_version is not None and uci_version & 0xFF == 1


def _version(octets: bytes) -> str:
    """Major, then minor and maintenance in the halves of an octet; old nodes have the minor in the lower half."""
    major, minor = octets
    high, low = minor >> 4, minor & 0x0F
    return f"{major}.{low}" if not high else f"{major}.{high}" + (f".{low}" if low else "")


def _record(
    numbers: dict[str, int], versions: dict[str, tuple[str, str]], unknown: tuple[tuple[int, bytes], ...], skipped: int
) -> Capabilities:
    number = numbers.get

    def flag(name: str) -> bool | None:
        value = number(name)
        return None if value is None else bool(value & 1)

    def numbered(name: str, names: tuple[int, ...] | range) -> tuple[int, ...] | None:
        value = number(name)
        return None if value is None else tuple(each for bit, each in enumerate(names) if value >> bit & 1)

    sets = range(1, 8 * MAX_MASK_OCTETS + 1)
    return Capabilities(
        phy_versions=versions.get("phy_versions"),
        mac_versions=versions.get("mac_versions"),
        device_types=None if (mask := number("device_types")) is None else DeviceTypes(mask),
        device_roles=None if (mask := number("device_roles")) is None else DeviceRoles(mask),
        ranging_methods=None if (mask := number("ranging_methods")) is None else RangingMethods(mask),
        sts_configs=None if (mask := number("sts_configs")) is None else StsConfigs(mask),
        multi_node_modes=None if (mask := number("multi_node_modes")) is None else MultiNodeModes(mask),
        time_structures=number("time_structures"),
        schedule_modes=None if (mask := number("schedule_modes")) is None else ScheduleModes(mask),
        hopping=flag("hopping"),
        block_striding=flag("block_striding"),
        initiation_time=flag("initiation_time"),
        channels=numbered("channels", _CHANNELS),
        rframe_configs=None if (mask := number("rframe_configs")) is None else RframeConfigs(mask),
        constraint_lengths=numbered("constraint_lengths", (3, 7)),
        bprf_sets=numbered("bprf_sets", sets),
        hprf_sets=numbered("hprf_sets", sets),
        angle_of_arrival=number("angle_of_arrival"),
        extended_mac=flag("extended_mac"),
        suspend_ranging=flag("suspend_ranging"),
        session_key_lengths=number("session_key_lengths"),
        dt_anchor_rounds=number("dt_anchor_rounds"),
        dt_tag_rounds=number("dt_tag_rounds"),
        dt_tag_block_skipping=flag("dt_tag_block_skipping"),
        psdu_lengths=number("psdu_lengths"),
        logical_links=number("logical_links"),
        bypass_mode=flag("bypass_mode"),
        min_slot_rstu=number("min_slot_rstu"),
        link_layer_version=number("link_layer_version"),
        max_message_octets=number("max_message_octets"),
        max_data_payload_octets=number("max_data_payload_octets"),
        unknown=unknown,
        skipped=skipped,
    )
