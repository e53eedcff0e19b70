"""Changing the channel's configuration: new revocation lists, as a CONFIG transaction with its signed update.

The transaction carries the whole new configuration and, as `last_update`, the CONFIG_UPDATE that led to it, signed by
an admin of each organisation whose MSP changes. Source: Fabric ``common/configtx`` and ``configtx.proto``.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from fabric_protos.common import common_pb2, configtx_pb2
from fabric_protos.msp import msp_config_pb2

from wonderland_fabric_gateway.channel_groups import serialise
from wonderland_fabric_gateway.embedded.msp import OrganisationTrust
from wonderland_fabric_gateway.errors import BlockError
from wonderland_fabric_gateway.identity import SigningIdentity
from wonderland_fabric_gateway.protobuf import decode
from wonderland_fabric_gateway.revocation import check_revocation_list

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from wonderland_fabric_gateway.channel_config import ChannelConfig

__all__ = ["ConfigSigners", "SigningIdentity", "config_data", "revocation_transaction", "trust_of"]

NONCE_BYTES: Final = 24


@dataclass(frozen=True)
class ConfigSigners:
    """Who signs a configuration change: per MSP id an admin of that organisation, and the orderer."""

    admins: Mapping[str, SigningIdentity]
    orderer: SigningIdentity


def revocation_transaction(
    channel: str,
    config_envelope: bytes,
    lists: Mapping[str, Sequence[bytes]],
    signers: ConfigSigners,
    *,
    timestamp_ms: int,
    random: Callable[[int], bytes],
) -> tuple[str, bytes, bytes] | None:
    """A CONFIG transaction that gives organisations these revocation lists (PEM), or None when nothing changes.

    `config_envelope` is the data of the last config transaction, `lists` goes by MSP id (organisations that it does
    not name keep theirs), `random(n)` gives n random bytes. Returns transaction id, envelope, and the envelope's data.
    Raises `RevocationListError` for a list that must not get onto the channel.
    """
    config = decode(configtx_pb2.ConfigEnvelope, config_envelope, "channel configuration", BlockError).config
    root = config.channel_group
    read_set = configtx_pb2.ConfigGroup(version=root.version)
    write_set = configtx_pb2.ConfigGroup(version=root.version)
    changed: dict[str, None] = {}
    for section, group in root.groups.items():
        for name, organisation in group.groups.items():
            value = organisation.values["MSP"]
            msp_id, new_value = _with_lists(value.value, lists)
            if new_value is None:
                continue
            value.value = new_value
            value.version += 1
            for update in (read_set, write_set):
                update.groups[section].version = group.version
                update.groups[section].groups[name].version = organisation.version
            write_set.groups[section].groups[name].values["MSP"].CopyFrom(value)
            changed[msp_id] = None
    if not changed:
        return None
    config.sequence += 1
    update_bytes = serialise(configtx_pb2.ConfigUpdate(channel_id=channel, read_set=read_set, write_set=write_set))
    admins = [signers.admins[msp_id] for msp_id in changed]
    update = configtx_pb2.ConfigUpdateEnvelope(config_update=update_bytes)
    for admin in admins:
        header = serialise(common_pb2.SignatureHeader(creator=admin.creator, nonce=random(NONCE_BYTES)))
        update.signatures.add(signature_header=header, signature=admin.sign(header + update_bytes))
    _, last_update = _envelope(
        common_pb2.CONFIG_UPDATE,
        channel,
        serialise(update),
        admins[0],
        timestamp_ms=timestamp_ms,
        nonce=random(NONCE_BYTES),
    )
    data = serialise(configtx_pb2.ConfigEnvelope(config=config, last_update=last_update))
    tx_id, envelope = _envelope(
        common_pb2.CONFIG, channel, data, signers.orderer, timestamp_ms=timestamp_ms, nonce=random(NONCE_BYTES)
    )
    return tx_id, serialise(envelope), data


def trust_of(config: ChannelConfig) -> tuple[OrganisationTrust, ...]:
    """The organisations of a parsed configuration, as `ChannelMembership` takes them."""
    return tuple(
        OrganisationTrust(
            msp_id=organisation.msp_id,
            root_certs=organisation.root_certs,
            intermediate_certs=organisation.intermediate_certs,
            revocation_lists=organisation.revocation_lists,
            application="Application" in organisation.sections,
        )
        for organisation in config.organisations.values()
    )


def config_data(envelope: bytes) -> bytes:
    """The ``common.ConfigEnvelope`` bytes inside a config transaction's envelope. Raises `BlockError`."""
    outer = decode(common_pb2.Envelope, envelope, "config transaction", BlockError)
    return bytes(decode(common_pb2.Payload, outer.payload, "config transaction", BlockError).data)


def _with_lists(msp_value: bytes, lists: Mapping[str, Sequence[bytes]]) -> tuple[str, bytes | None]:
    """The MSP id, and the MSP's configuration with the new lists, or None where they are the ones it has."""
    wrapper = decode(msp_config_pb2.MSPConfig, msp_value, "channel configuration: MSP", BlockError)
    msp = decode(msp_config_pb2.FabricMSPConfig, wrapper.config, "channel configuration: MSP", BlockError)
    new = lists.get(msp.name)
    if new is None or list(new) == list(msp.revocation_list):
        return msp.name, None
    for crl_pem in new:
        check_revocation_list(crl_pem, (*msp.root_certs, *msp.intermediate_certs))
    msp.revocation_list[:] = list(new)
    return msp.name, serialise(msp_config_pb2.MSPConfig(type=wrapper.type, config=serialise(msp)))


def _envelope(
    kind: int, channel: str, data: bytes, signer: SigningIdentity, *, timestamp_ms: int, nonce: bytes
) -> tuple[str, common_pb2.Envelope]:
    tx_id = hashlib.sha256(nonce + signer.creator).hexdigest()
    channel_header = common_pb2.ChannelHeader(type=kind, version=1, channel_id=channel, tx_id=tx_id)
    channel_header.timestamp.seconds, milliseconds = divmod(timestamp_ms, 1000)
    channel_header.timestamp.nanos = milliseconds * 1_000_000
    header = common_pb2.Header(
        channel_header=serialise(channel_header),
        signature_header=serialise(common_pb2.SignatureHeader(creator=signer.creator, nonce=nonce)),
    )
    payload = serialise(common_pb2.Payload(header=header, data=data))
    return tx_id, common_pb2.Envelope(payload=payload, signature=signer.sign(payload))
