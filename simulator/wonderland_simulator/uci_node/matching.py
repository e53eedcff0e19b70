"""Who hears whom: two configurations side by side. Pure."""

from __future__ import annotations

from wonderland_fira_uci.uci.config import AppConfig, DeviceRole, DeviceType, RangingUsage
from wonderland_fira_uci.uci.ranging import INVALID_DISTANCE_CM, LineOfSight, TwoWayMeasurement


def failed(mac: int, status: int) -> TwoWayMeasurement:
    """A round without a distance to that peer."""
    return TwoWayMeasurement(mac, status, LineOfSight.UNDETERMINED, INVALID_DISTANCE_CM)


def same_air(lead: AppConfig, follow: AppConfig) -> bool:
    """Whether the follower's receiver is set to what the leader sends, and they mean each other."""
    return (
        lead.device_role is DeviceRole.INITIATOR
        and follow.device_type is DeviceType.CONTROLEE
        and follow.device_role is DeviceRole.RESPONDER
        and lead.mac_address in follow.destination_macs
        and (
            lead.channel,
            lead.preamble_code,
            lead.sfd_id,
            lead.rframe_config,
            lead.slot_duration_rstu,
            lead.slots_per_round,
            lead.multi_node_mode,
            lead.ranging_usage,
            lead.schedule_mode,
        )
        == (
            follow.channel,
            follow.preamble_code,
            follow.sfd_id,
            follow.rframe_config,
            follow.slot_duration_rstu,
            follow.slots_per_round,
            follow.multi_node_mode,
            follow.ranging_usage,
            follow.schedule_mode,
        )
    )


def same_key(lead: AppConfig, follow: AppConfig) -> bool:
    """Whether both have the same scrambled sequence."""
    return (lead.sts_config, lead.session_key) == (follow.sts_config, follow.session_key)


def hears_blinks(tag: AppConfig, anchor: AppConfig) -> bool:
    """Whether an anchor listens for this tag's blinks, with its key."""
    return (
        tag.device_role is DeviceRole.UT_TAG
        and anchor.device_role in (DeviceRole.UT_ANCHOR, DeviceRole.UT_SYNCHRONISATION_ANCHOR)
        and anchor.ranging_usage is RangingUsage.UL_TDOA
        and tag.mac_address in anchor.destination_macs
        and (tag.channel, tag.preamble_code, tag.sfd_id, tag.rframe_config)
        == (anchor.channel, anchor.preamble_code, anchor.sfd_id, anchor.rframe_config)
        and same_key(tag, anchor)
    )


def parameter_of(app: AppConfig, identifier: int) -> int:
    """A number among the parameters that have no field of their own; 0 where it is not given."""
    return next((int.from_bytes(value, "little") for known, value in app.extra if known == identifier), 0)
