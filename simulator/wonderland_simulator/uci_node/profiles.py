"""Real nodes as data: what each says of itself, what it refuses, how it behaves. A virtual node is one of them.

Where a fact comes from stands behind it: [C] bytes captured from the board and published (repository
EstebanMenti/i-mop-qorvo-uci-script: DWM3001CDK, QM33 SDK 1.1.1, UCI 2.0.0), [S] published sources, documentation or
forum posts (google/pica at e6fd445, Qorvo's UCI stack and forum, NXP's demos), [M] measured by this project on the
wire, [I] inferred: nobody here has seen it, so a board has to confirm it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from wonderland_fira_uci.uci.capabilities import Capabilities, decode_capabilities
from wonderland_fira_uci.uci.config import (
    DeviceRole,
    MultiNodeMode,
    ParameterId,
    RangingUsage,
    RframeConfig,
    ScheduleMode,
    StsConfig,
    encode_parameters,
)
from wonderland_fira_uci.uci.session import DeviceInfo

P = ParameterId
BPRF_CODES: Final = frozenset(range(9, 25))
HPRF_CODES: Final = frozenset(range(25, 33))


@dataclass(frozen=True, slots=True, kw_only=True)
class Quirks:
    """Ways in which nodes differ from each other and from the standard. The default has none.

    Boot: ``no_ready``: no device READY after a reset. ``ready_first``: one before the answer to the reset as well.
    ``tells_cleared``: sessions that a reset ends are announced.
    ``vendor_notifications``: packets that follow it.
    Sessions: ``handle_offset``: the handle differs from the id by that much. ``handles_from``: handles are counted from
    there instead. ``announces_first``: the state INIT comes before the answer that tells the handle.
    ``keeps_duplicate``: a second INIT does not remove the session. ``deinit_retry``: the first DEINIT of a session is
    answered by a generic error that asks to send it again. ``names_unknown``: unknown parameters are refused by their
    ids, else the whole command counts as malformed.
    Ranging: ``drift``: relative error of the interval (0.005: one millisecond in 200). ``report_failures``: a peer that
    is not heard is reported with an error status, else it is missing. ``cuts_to_cm``: distances lose their millimetres,
    else they are rounded. ``tells_nlos``. ``tells_negative``: a distance below zero is reported as an error, else as
    zero. ``checks_keys``: frames of another key are noticed. ``one_radio``: it does one thing at a time.
    ``obeys_time_base``: a session's blocks follow those of another one if told so.
    Data: ``responder_data``: its response frames carry data, too. ``data_in_sp3``. ``empty_data``: an empty data packet
    every round. ``transfer_status``: success of data is reported. ``max_data_octets``, ``frames_per_round``,
    ``data_queue``: limits.
    """

    no_ready: bool = False
    ready_first: bool = False
    tells_cleared: bool = False
    vendor_notifications: tuple[bytes, ...] = ()
    handle_offset: int = 0
    handles_from: int | None = None
    announces_first: bool = False
    keeps_duplicate: bool = False
    deinit_retry: bool = False
    names_unknown: bool = False
    knows_get_state: bool = True
    drift: float = 0.0
    report_failures: bool = True
    cuts_to_cm: bool = False
    tells_nlos: bool = True
    tells_negative: bool = True
    checks_keys: bool = True
    one_radio: bool = True
    obeys_time_base: bool = True
    responder_data: bool = True
    data_in_sp3: bool = False
    empty_data: bool = False
    transfer_status: bool = False
    max_data_octets: int = 84
    frames_per_round: int = 1
    data_queue: int = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeProfile:
    """One kind of node.

    ``known``: parameters of SESSION_SET_APP_CONFIG that it knows. ``accepts``: what it takes for some of them.
    ``blinks_need``: the same, for an UL-TDoA session. ``checks_timing``: refuses slots and rounds that its radio could
    not keep; ``least_slot_rstu`` and ``turn_us``: its shortest slot, and its time from one frame to the next.
    ``clock_ppm``: how far its crystal may be off.
    """

    name: str
    info: DeviceInfo
    capabilities: tuple[tuple[int, bytes], ...]
    known: frozenset[int]
    accepts: Mapping[ParameterId, frozenset[int]]
    blinks_need: Mapping[ParameterId, frozenset[int]] = field(default_factory=dict)
    checks_timing: bool = True
    least_slot_rstu: int = 1_200
    turn_us: int = 200
    max_sessions: int = 8
    clock_ppm: float = 0.0
    quirks: Quirks = Quirks()

    def said(self) -> Capabilities:
        """What a host reads in its answer to GET_CAPS_INFO."""
        return decode_capabilities(encode_parameters(list(self.capabilities)), self.info.uci_version)


def _capabilities(text: str) -> tuple[tuple[int, bytes], ...]:
    """``id length value`` in hexadecimal, one behind the other."""
    octets, at = bytes.fromhex(text), 0
    out: list[tuple[int, bytes]] = []
    while at < len(octets):
        end = at + 2 + octets[at + 1]
        out.append((octets[at], octets[at + 2 : end]))
        at = end
    return tuple(out)


_BLINK_PARAMETERS: Final = frozenset(
    (
        P.UL_TDOA_TX_INTERVAL,
        P.UL_TDOA_RANDOM_WINDOW,
        P.UL_TDOA_NTF_REPORT_CONFIG,
        P.UL_TDOA_DEVICE_ID,
        P.UL_TDOA_TX_TIMESTAMP,
    )
)
_TWO_WAY_PARAMETERS: Final = frozenset(ParameterId) - _BLINK_PARAMETERS
_EVERY_TWO_WAY_METHOD: Final = frozenset(RangingUsage) - {RangingUsage.UL_TDOA}
_TWO_WAY_ROLES: Final = frozenset((DeviceRole.RESPONDER, DeviceRole.INITIATOR))

IDEAL: Final = NodeProfile(
    name="ideal",
    info=DeviceInfo(0x0002, 0x0002, 0x0002, 0x0001, b""),
    capabilities=(
        (0x00, b"\xef\x07"),
        (0x01, b"\xff\x00"),
        (0x02, b"\x01\x01\x02\x00"),
        (0x03, b"\x01\x01\x02\x00"),
        (0x04, b"\x03"),
        (0x05, b"\x1f\x00"),
        (0x06, b"\x1f\x00"),
        (0x07, b"\x1f"),
        (0x08, b"\x03"),
        (0x09, b"\x02"),
        (0x0A, b"\x03"),
        (0x0E, b"\xff"),
        (0x0F, b"\x0b"),
        (0x11, b"\x3f"),
        (0x12, b"\xff"),
    ),
    known=frozenset(ParameterId),
    accepts={},
)
"""No node that one can buy: every role and method that a proof needs, and no manners of its own."""

PICA: Final = NodeProfile(
    name="pica",
    info=DeviceInfo(0x0002, 0x3001, 0x3001, 0x1001, b""),  # [S] device.rs
    # [M] all 27; [S] device.rs: announces UCI 2.0, numbers as UCI 1 does; 01 of the schedule modes is a value (time-
    # scheduled), where the bit would be "contention only", and so is 01 of the time structures (blocks).
    capabilities=_capabilities(
        "0004 01010103 0104 01010103 0201 03 0301 1f 0401 1f 0501 ff 0601 01 0701 01 0801 00 0901 01 0a01 01 0b01 ff"
        "0c01 ff 0d01 ff 0e01 ff 0f01 ff 1001 ff e301 01 1101 01 a402 0100 a501 00 a601 00 a704 00000000 a001 ff"
        "a104 ffffffff a301 ff a201 ff"
    ),
    known=_TWO_WAY_PARAMETERS - {P.RESPONDER_SLOT_INDEX},  # [S] app_config.rs; [M] UL-TDoA is rejected
    accepts={
        P.RANGING_ROUND_USAGE: _EVERY_TWO_WAY_METHOD,  # [S] 0 is not in its enumeration
        P.CHANNEL_NUMBER: frozenset((5, 6, 8, 9, 10, 12, 13, 14)),  # [S]
        P.DEVICE_ROLE: _TWO_WAY_ROLES,  # [I] from its capabilities
    },
    checks_timing=False,  # [S] slots, rounds and codes are stored, not looked at
    max_sessions=255,  # [S]
    quirks=Quirks(
        names_unknown=True,  # [S] INVALID_PARAM for each
        cuts_to_cm=True,  # [M]
        tells_negative=False,  # [S] distances come from a map
        report_failures=False,  # [M] no record, and the sequence goes on
        checks_keys=False,  # [S]
        one_radio=False,  # [S] it has no airtime
        obeys_time_base=False,  # [S] stored, not looked at
        responder_data=False,  # [M] data goes from the initiator only
        data_in_sp3=True,  # [M]
        max_data_octets=1024,  # [I]
    ),
)
"""google/pica, the virtual controller: no radio stands behind it, so it takes what no chip does."""

_QORVO_ACCEPTS: Final[Mapping[ParameterId, frozenset[int]]] = {
    # What its captured capabilities say [C]; that everything else is refused, and by INVALID_PARAM [I].
    P.RANGING_ROUND_USAGE: _EVERY_TWO_WAY_METHOD,
    P.DEVICE_ROLE: _TWO_WAY_ROLES,
    P.STS_CONFIG: frozenset((StsConfig.STATIC, StsConfig.PROVISIONED, StsConfig.PROVISIONED_RESPONDER_KEY)),
    P.MULTI_NODE_MODE: frozenset((MultiNodeMode.UNICAST, MultiNodeMode.ONE_TO_MANY)),
    P.SCHEDULE_MODE: frozenset((ScheduleMode.TIME_SCHEDULED,)),
    P.CHANNEL_NUMBER: frozenset((5, 9)),
    P.RFRAME_CONFIG: frozenset((RframeConfig.SP1, RframeConfig.SP3)),
    P.PREAMBLE_CODE_INDEX: BPRF_CODES,
}

DWM3001CDK: Final = NodeProfile(
    name="DWM3001CDK",
    info=DeviceInfo(  # [C] all 62 octets
        0x0002,
        0x0002,
        0x0002,
        0x1001,
        bytes.fromhex("0101" + 15 * "00" + "5056345832300ee0ca09" + 20 * "00" + "0203cade00"),
    ),
    capabilities=_capabilities(  # [C] all 26
        "00020301 0102ff00 020402000200 030402000200 040103 05020300 06021e00 070119 080103 090102 0a0102 0b0101"
        "0c0101 0d0101 0e0109 0f010a 100101 11013f 12050000000000 130100 140100 150100 160102 170100 180100 190100"
    ),
    known=_TWO_WAY_PARAMETERS,  # [S] its UCI source names them; [C] it took 25 of them
    accepts=_QORVO_ACCEPTS,
    least_slot_rstu=1_200,  # [I] 2,400 is what everybody runs
    max_sessions=5,  # [I]
    clock_ppm=5.0,  # [I] trimmed crystal
    quirks=Quirks(
        ready_first=True,  # [C]
        tells_cleared=True,  # [C]
        handles_from=1,  # [C] handle 1 for session 7; [I] that it goes on counting
        tells_nlos=False,  # [C] ff
        names_unknown=True,  # [I]
        max_data_octets=84,  # [S]
    ),
)
"""Qorvo's DWM3001C development kit (QM33, formerly DW3110) with the UCI firmware of the QM33 SDK."""

QM35: Final = NodeProfile(
    name="QM35",
    info=DeviceInfo(0x0002, 0x0002, 0x0002, 0x1001, b""),  # [S] forum: FiRa 2.0; vendor information unknown
    # [I] as the DWM3001CDK, which has the same stack; no answer of this chip was published.
    capabilities=DWM3001CDK.capabilities,
    known=_TWO_WAY_PARAMETERS,
    accepts=_QORVO_ACCEPTS,
    least_slot_rstu=1_200,  # [I]
    max_sessions=5,  # [I]
    clock_ppm=5.0,  # [I]
    quirks=Quirks(
        ready_first=True,  # [I] as the DWM3001CDK
        handles_from=0x8000_0007,  # [S] forum.qorvo.com 25469: handle 0x80000007 for session 42
        announces_first=True,  # [S] the same trace: INIT is announced before the handle is known
        tells_nlos=False,  # [I]
        names_unknown=True,  # [I]
        max_data_octets=84,  # [S]
    ),
)
"""Qorvo's newer chip (QM35825), on HSSPI."""

SR150: Final = NodeProfile(
    name="SR150",
    info=DeviceInfo(0x0002, 0x3001, 0x3001, 0x1001, b""),  # [I]
    # [I] from what NXP's demos do: both roles of two-way ranging, UL-TDoA as synchronisation anchor, anchor and tag,
    # in-band data, channels 5 and 9, both pulse rates.
    capabilities=_capabilities(
        "0002ef07 0102ff00 020401010130 030401010130 040103 05021f00 06021f00 07011f 080103 090102 0a0103 0b0101"
        "0c0101 0d0101 0e0109 0f010b 100103 11013f 1201ff 130105 140101 a001 01"
    ),
    known=frozenset(ParameterId),  # [I] SESSION_TIME_BASE among them
    accepts={
        P.CHANNEL_NUMBER: frozenset((5, 9)),  # [S]
        P.PREAMBLE_CODE_INDEX: BPRF_CODES | HPRF_CODES,  # [S] its radio test names the codes of both rates
    },
    blinks_need={  # [S] NXP's demos do nothing else; [I] that anything else is refused. They use a static sequence:
        # whether blinks can have a provisioned one, as assurance 3 needs, is taken for granted here [I].
        P.RFRAME_CONFIG: frozenset((RframeConfig.SP1,)),
        P.SCHEDULE_MODE: frozenset((ScheduleMode.TIME_SCHEDULED,)),
        P.SFD_ID: frozenset((0,)),
    },
    max_sessions=5,  # [I]
    clock_ppm=5.0,  # [I]
    quirks=Quirks(
        handle_offset=0x0100_0000,  # [S] a handle of its own; [I] how it comes about
        vendor_notifications=(bytes.fromhex("6e000001 00"),),  # [I] NXP's own groups, of no concern to the standard
        deinit_retry=True,  # [S] its data demo: DEINIT after the end is answered by "send it again"
        names_unknown=True,  # [I]
        transfer_status=True,  # [I]
        max_data_octets=2_031,  # [S]
    ),
)
"""NXP's SR150 (Trimension), as on the MK UWB Shield 2 and Murata's 2BP: the only one here that time-stamps one way."""

PROFILES: Final = {profile.name: profile for profile in (DWM3001CDK, QM35, SR150, IDEAL)}
"""Those that people can ask for, by name."""
