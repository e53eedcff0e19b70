"""Taking a certificate's power: at the CA, and, since that alone changes nothing there, on the channel.

A revocation list is checked before it is sent: Fabric would silently ignore one that was signed by another key, and one
without its issuer's key identifier makes every identity of the organisation invalid, its administrators included.
"""

from __future__ import annotations

from contextlib import AsyncExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from cryptography import x509
from fabric_protos.msp import msp_config_pb2

from wonderland_fabric_gateway.ca.certificates import REASONS
from wonderland_fabric_gateway.ca.errors import CaRequestError, UnknownCertificateError
from wonderland_fabric_gateway.certificates import revocation_list_of
from wonderland_fabric_gateway.channel_groups import serialise
from wonderland_fabric_gateway.errors import RevocationListError
from wonderland_fabric_gateway.protobuf import decode
from wonderland_fabric_gateway.revocation import check_revocation_list
from wonderland_fabric_network import certificates
from wonderland_fabric_network.config_update import update_channel
from wonderland_fabric_network.errors import ChannelUpdateError
from wonderland_fabric_network.layout import MSP_ADMIN

if TYPE_CHECKING:
    from collections.abc import Iterable

    from wonderland_fabric_network.network import Network

_SECTIONS: Final = ("Application", "Orderer")


@dataclass(frozen=True)
class Revocation:
    """What was revoked (serial numbers, lower-case hex), and since which block the channel refuses it."""

    msp_id: str
    serials: tuple[str, ...]
    block: int | None

    def as_json(self) -> dict[str, Any]:
        """JSON values, as `--json` prints them."""
        return {"msp_id": self.msp_id, "revoked": list(self.serials), "block": self.block}


async def revoke(
    network: Network, msp_id: str, *, name: str = "", serial: str = "", reason: str = "unspecified"
) -> Revocation:
    """Revoke all certificates of a name, which can then never enrol again, or one certificate. Raises `LedgerError`.

    The channel refuses them from the block on that it names. May be repeated, should only the CA have got to know.
    """
    if bool(name) == bool(serial):
        raise CaRequestError("say either the name or the serial number of what is to be revoked")
    if reason not in REASONS:
        raise CaRequestError(f"reason {reason!r} is none of {', '.join(REASONS)}")
    wanted = serial.lower().replace(":", "").removeprefix("0x").lstrip("0")
    async with network.authority(msp_id) as authority:
        registrar = await authority.registrar()
        issued = [each.certificate for each in await authority.ca.certificates(registrar, name)]
        meant = [each for each in issued if not wanted or f"{each.serial_number:x}" == wanted]
        if not meant:
            raise UnknownCertificateError(f"{msp_id}: its CA never issued a certificate to {name or serial}")
        _require_no_lock_out(network, msp_id, {each.serial_number for each in meant})
        known = await _revoked_already(authority.ca, registrar)
        if any(each.serial_number not in known for each in meant):
            if wanted:
                await authority.ca.revoke(registrar, certificate=meant[0], reason=reason)
            else:
                await authority.ca.revoke(registrar, name=name, reason=reason)
        crl_pem = await authority.ca.revocation_list(registrar)
    meant_serials = {each.serial_number for each in meant}
    block = await set_revocation_list(network, msp_id, crl_pem, must_hold=meant_serials, refresh=False)
    return Revocation(msp_id, tuple(sorted(f"{each.serial_number:x}" for each in meant)), block)


async def set_revocation_list(
    network: Network, msp_id: str, crl_pem: bytes, *, must_hold: Iterable[int] = (), refresh: bool = True
) -> int | None:
    """Put an organisation's revocation list on the channel; its block, None when it is there already.

    Without `refresh`, a list there that names the same certificates stays, although it is older.
    Raises `RevocationListError` for one that must not get there, `ChannelUpdateError`.
    """
    administrator = certificates.signing_identity(msp_id, network.directory.organisation(msp_id).identity(MSP_ADMIN))

    def change(root: Any) -> None:
        found = False
        for section in _SECTIONS:
            for group in root.groups[section].groups.values():
                wrapper = decode(
                    msp_config_pb2.MSPConfig, group.values["MSP"].value, "the channel's MSP", ChannelUpdateError
                )
                msp = decode(msp_config_pb2.FabricMSPConfig, wrapper.config, "the channel's MSP", ChannelUpdateError)
                if msp.name != msp_id:
                    continue
                found = True
                crl = _require_harmless(network, msp_id, crl_pem, msp, must_hold)
                if not refresh and _names_the_same(crl, msp.revocation_list):
                    continue
                msp.revocation_list[:] = [crl_pem]
                wrapper.config = serialise(msp)
                group.values["MSP"].value = serialise(wrapper)
        if not found:
            raise ChannelUpdateError(f"{msp_id} is no organisation of channel {network.channel}")

    async with AsyncExitStack() as stack:
        peers = await network.peer_admins(stack)
        return await update_channel(network, peers, change, [administrator])


def _require_harmless(
    network: Network, msp_id: str, crl_pem: bytes, msp: Any, must_hold: Iterable[int]
) -> x509.CertificateRevocationList:
    crl = check_revocation_list(crl_pem, (*msp.root_certs, *msp.intermediate_certs))
    serials = {entry.serial_number for entry in crl}
    _require_no_lock_out(network, msp_id, serials)
    missing = set(must_hold) - serials
    if missing:
        raise RevocationListError(
            f"{msp_id}: the list lacks {', '.join(f'{each:x}' for each in sorted(missing))}; have the CA make a new one"
        )
    if list(msp.revocation_list) == [crl_pem]:
        return crl
    now = network.now()
    for former_pem in msp.revocation_list:
        former = revocation_list_of(former_pem)
        if former.last_update_utc > crl.last_update_utc:
            raise RevocationListError(
                f"{msp_id}: the channel's list is newer ({former.last_update_utc:%Y-%m-%d %H:%M:%S} UTC) than this one "
                f"({crl.last_update_utc:%Y-%m-%d %H:%M:%S} UTC), which could un-revoke; have the CA make a new one"
            )
    if crl.next_update_utc is not None and crl.next_update_utc < now:
        raise RevocationListError(
            f"{msp_id}: the list was to be replaced by {crl.next_update_utc:%Y-%m-%d}; have the CA make a new one"
        )
    return crl


def _names_the_same(crl: x509.CertificateRevocationList, there: Iterable[bytes]) -> bool:
    known = {entry.serial_number for pem in there for entry in revocation_list_of(pem)}
    return known == {entry.serial_number for entry in crl}


def _require_no_lock_out(network: Network, msp_id: str, serials: set[int]) -> None:
    """Refuse what would leave the organisation without administrator or servers."""
    own = {f"its administrator {MSP_ADMIN}": network.directory.organisation(msp_id).identity(MSP_ADMIN).certificate}
    for member in (*network.orderers, *network.peers):
        if member.msp_id == msp_id:
            own[member.component] = network.node(member).identity.certificate
    for who, path in own.items():
        if path.exists() and certificates.load(path).serial_number in serials:
            raise RevocationListError(
                f"{msp_id}: that would revoke the certificate by which {who} works, and lock the organisation out. "
                f"Next: `wonderland network renew` gives it a new one; then revoke the former by --serial"
            )


async def _revoked_already(ca: Any, registrar: Any) -> set[int]:
    """Serial numbers that the CA has revoked."""
    return {entry.serial_number for entry in revocation_list_of(await ca.revocation_list(registrar))}
