"""What a node refuses of a session's configuration. Pure."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Final

from wonderland_fira_uci.uci.airtime import RSTU_PER_MS, frame_us, slot_us
from wonderland_fira_uci.uci.config import (
    AppConfig,
    DeviceType,
    ParameterId,
    RangingUsage,
    UciParameterError,
    decode_time_base,
    least_slots,
)
from wonderland_fira_uci.uci.status import Status
from wonderland_simulator.uci_node.profiles import BPRF_CODES, NodeProfile

_DEFERRED: Final = (RangingUsage.DS_TWR_DEFERRED, RangingUsage.SS_TWR_DEFERRED)
_BPRF_SFDS: Final = (0, 2)
_HPRF_SFDS: Final = (1, 2, 3)
"""Start-of-frame delimiters by pulse rate, as NXP's radio test lists them."""


def accepted(profile: NodeProfile, parameters: Mapping[int, bytes], handles: Collection[int]) -> AppConfig:
    """The configuration that all parameters of a session make. ``handles``: of the node's sessions.

    Raises ``UciParameterError`` naming the first parameter that the node refuses, and the status that it answers.
    """
    order = list(parameters)
    for address in (ParameterId.DEVICE_MAC_ADDRESS, ParameterId.DST_MAC_ADDRESS):
        if address in parameters and ParameterId.MAC_ADDRESS_MODE not in order[: order.index(address)]:
            raise _refused(address, "the address mode must come before")
    app = AppConfig.from_parameters(list(parameters.items()))
    _check_values(profile.accepts, app, "this node does not do it")
    if app.ranging_usage is RangingUsage.UL_TDOA:
        _check_values(profile.blinks_need, app, "not with UL-TDoA")
    base = parameters.get(ParameterId.SESSION_TIME_BASE)
    reference = None if base is None else decode_time_base(base)
    if profile.checks_timing:
        if reference is not None and reference[0] not in handles:
            raise _refused(ParameterId.SESSION_TIME_BASE, f"there is no session {reference[0]:#010x}")
        _check_radio(profile, app)
    return app


def _check_values(wanted: Mapping[ParameterId, frozenset[int]], app: AppConfig, why: str) -> None:
    values = dict(app.parameters())
    for identifier, allowed in wanted.items():
        value = int.from_bytes(values[identifier], "little")
        if value not in allowed:
            raise _refused(identifier, f"{value}: {why}")


def _check_radio(profile: NodeProfile, app: AppConfig) -> None:
    """Whether a radio could keep to it."""
    if app.sfd_id not in (_BPRF_SFDS if app.preamble_code in BPRF_CODES else _HPRF_SFDS):
        raise _refused(ParameterId.SFD_ID, f"{app.sfd_id}: not with preamble code {app.preamble_code}")
    least_us = max(slot_us(profile.least_slot_rstu), frame_us(app.rframe_config) + profile.turn_us)
    if slot_us(app.slot_duration_rstu) < least_us:
        raise _refused(ParameterId.SLOT_DURATION, f"at least {least_us:.0f} µs are needed", Status.INVALID_RANGE)
    if app.ranging_usage in _DEFERRED and app.device_type is DeviceType.CONTROLLER:
        needed = least_slots(len(app.destination_macs), app.round_control)
        if app.slots_per_round < needed:
            raise _refused(ParameterId.SLOTS_PER_RR, f"{needed} slots are needed")
    if app.slots_per_round * app.slot_duration_rstu > app.interval_ms * RSTU_PER_MS:
        raise _refused(ParameterId.RANGING_INTERVAL, "the round does not fit")


def _refused(identifier: int, why: str, status: Status = Status.INVALID_PARAMETER) -> UciParameterError:
    return UciParameterError(identifier, status, why)
