"""Who may: roles from certificate attributes, and whose pad or drone it is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from wonderland.proofs.errors import RecordError
from wonderland.proofs.records.pads import Pad
from wonderland.proofs.records.sessions import Session
from wonderland.proofs.records.transactions import (
    ADMIN,
    INSPECTOR,
    MSP_OF_ROLE,
    PAD,
    PAD_OPERATOR,
    ROLES,
    UAV,
    UavById,
)
from wonderland.proofs.records.uavs import Uav
from wonderland_chaincode.contract.errors import not_allowed
from wonderland_chaincode.stub import Creator

MAX_NAME: Final = 120


def require_role(who: Creator, roles: Sequence[str], function: str) -> None:
    """The creator has one of these roles, from an organisation that can give it. Raises ContractError (403)."""
    if who.role not in ROLES:
        raise not_allowed(
            "ROLE_MISSING",
            f"the certificate of {who.common_name!r} has no attribute pol.role that this contract knows; "
            f"enrol again with one of {', '.join(ROLES)}",
        )
    organisation = MSP_OF_ROLE.get(who.role)
    if organisation is not None and who.msp_id != organisation:
        raise not_allowed(
            "ROLE_OF_OTHER_ORGANISATION", f"only {organisation} gives the role {who.role}, not {who.msp_id}"
        )
    if who.role not in roles:
        raise not_allowed(
            "ROLE_NOT_ALLOWED", f"{function} is for {', '.join(roles)}; this certificate's role is {who.role}"
        )


def is_authority(who: Creator) -> bool:
    """Whether the creator acts for the authority; ``require_role`` has seen to the organisation."""
    return who.role in {ADMIN, INSPECTOR}


def require_pad_owner(who: Creator, pad: Pad) -> None:
    """An admin, or an operator of the organisation that owns the pad."""
    if who.role != ADMIN and who.msp_id != pad.msp_id:
        raise not_allowed("PAD_OF_OTHER_ORGANISATION", f"pad {pad.pad_id} belongs to {pad.msp_id}, not {who.msp_id}")


def require_pad_itself(who: Creator, pad_id: str, msp_id: str) -> None:
    """The pad's own certificate: ``pol.id`` is the pad, the organisation is the pad's."""
    if who.role != PAD or who.pol_id != pad_id or who.msp_id != msp_id:
        raise not_allowed(
            "NOT_THIS_PAD",
            f"only pad {pad_id} of {msp_id} may do this; the certificate is {who.role} {who.pol_id!r} of {who.msp_id}",
        )


def require_uav_owner(who: Creator, uav: Uav) -> None:
    """The authority, or an operator of the organisation that owns the drone."""
    if not is_authority(who) and who.msp_id != uav.msp_id:
        raise not_allowed("UAV_OF_OTHER_ORGANISATION", f"drone {uav.uav_id} belongs to {uav.msp_id}, not {who.msp_id}")


def uav_id_of(who: Creator) -> str:
    """The drone's identifier in its own certificate, checked to be one before it becomes part of a key."""
    try:
        return UavById.parse({"uav_id": who.pol_id}).uav_id
    except RecordError as error:
        raise not_allowed(
            "IDENTITY_WITHOUT_ID", f"the certificate's attribute pol.id names no drone ({error}); enrol with pol.id"
        ) from None


def name_of(who: Creator) -> str:
    """The creator's common name, fit for a record."""
    name = who.common_name
    if not 1 <= len(name) <= MAX_NAME or not name.isprintable():
        raise not_allowed(
            "IDENTITY_WITHOUT_NAME",
            f"the certificate has no common name of 1 to {MAX_NAME} printable characters; enrol again",
        )
    return name


def part_in(who: Creator, session: Session) -> str:
    """The creator's part in a session: ``pad``, ``uav``, ``operator`` (of the pad) or ``authority``.

    Raises ContractError (403) for none.
    """
    if who.role == PAD_OPERATOR and who.msp_id == session.pad.msp_id:
        return "operator"
    if who.role == PAD and (who.pol_id, who.msp_id) == (session.pad_id, session.pad.msp_id):
        return "pad"
    if who.role == UAV and (who.pol_id, who.msp_id) == (session.uav_id, session.uav.msp_id):
        return "uav"
    if who.role == ADMIN:
        return "authority"
    raise not_allowed(
        "NOT_YOUR_SESSION",
        f"session {session.session_id[:12]}… is between pad {session.pad_id} and drone {session.uav_id}; "
        f"the certificate is {who.role} {who.pol_id!r} of {who.msp_id}",
    )
