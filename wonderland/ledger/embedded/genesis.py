"""The channel's configuration: block 0, and the config transactions that change it later.

The shape is that of configtxgen, so that whoever reads Fabric's config blocks learns the trust roots here, too; the
consensus type says "embedded", and the endorsement policy is written out: AND of the endorsing organisations' peers.
Sources: Fabric ``internal/configtxgen/encoder``, ``common/configtx`` (sequence, versions), ``configtx.proto``.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from fabric_protos.common import common_pb2, configtx_pb2, configuration_pb2, policies_pb2
from fabric_protos.msp import msp_config_pb2, msp_principal_pb2
from fabric_protos.orderer import configuration_pb2 as orderer_pb2

from wonderland.ledger.blocks import BlockHeader, data_hash
from wonderland.ledger.embedded.errors import EmbeddedLedgerError
from wonderland.ledger.embedded.msp import OrganisationTrust, check_revocation_list
from wonderland.ledger.errors import LedgerError
from wonderland.ledger.protobuf import decode

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from wonderland.ledger.channel_config import ChannelConfig
    from wonderland.ledger.identity import Identity
    from wonderland.ledger.signing import Signer

CONSENSUS_TYPE: Final = "embedded"
METADATA_SLOTS: Final = 5
PREFERRED_MAX_BYTES: Final = 2 << 20
ABSOLUTE_MAX_BYTES: Final = 10 << 20
_ADMINS: Final = "Admins"
_NONCE_BYTES: Final = 24


@dataclass(frozen=True)
class OrganisationDescription:
    """An organisation as it goes into block 0 (certificates PEM)."""

    msp_id: str
    root_cert: bytes
    tls_root_cert: bytes
    endpoints: tuple[str, ...] = ()
    """Orderer addresses, for the ordering organisation."""


@dataclass(frozen=True)
class ChannelDescription:
    """What block 0 says. `endorsing` names the organisations that must all endorse."""

    channel: str
    applications: tuple[OrganisationDescription, ...]
    orderer: OrganisationDescription
    endorsing: tuple[str, ...]
    batch_ms: int
    batch_count: int


@dataclass(frozen=True)
class SigningIdentity:
    """An identity together with its key."""

    identity: Identity
    sign: Signer

    @property
    def creator(self) -> bytes:
        """The SerializedIdentity."""
        return self.identity.creator


def genesis_block(description: ChannelDescription, timestamp_s: int, nonce: bytes) -> tuple[BlockHeader, bytes]:
    """Block 0: header and ``common.Block`` bytes. `timestamp_s` since the epoch; `nonce` 24 random bytes."""
    channel_header = common_pb2.ChannelHeader(
        type=common_pb2.CONFIG, version=1, channel_id=description.channel, tx_id=hashlib.sha256(nonce).hexdigest()
    )
    channel_header.timestamp.seconds = timestamp_s
    payload = common_pb2.Payload(
        header=common_pb2.Header(
            channel_header=_bytes(channel_header),
            signature_header=_bytes(common_pb2.SignatureHeader(nonce=nonce)),
        ),
        data=_bytes(configtx_pb2.ConfigEnvelope(config=configtx_pb2.Config(channel_group=_channel(description)))),
    )
    envelope = _bytes(common_pb2.Envelope(payload=_bytes(payload)))
    header = BlockHeader(0, b"", data_hash([envelope]))
    metadata = [b""] * METADATA_SLOTS
    last_config = common_pb2.LastConfig(index=0)
    metadata[common_pb2.SIGNATURES] = _bytes(
        common_pb2.Metadata(value=_bytes(common_pb2.OrdererBlockMetadata(last_config=last_config)))
    )
    metadata[common_pb2.LAST_CONFIG] = _bytes(common_pb2.Metadata(value=_bytes(last_config)))
    metadata[common_pb2.TRANSACTIONS_FILTER] = b"\x00"
    block = common_pb2.Block(
        header=common_pb2.BlockHeader(number=0, data_hash=header.data_hash),
        data=common_pb2.BlockData(data=[envelope]),
        metadata=common_pb2.BlockMetadata(metadata=metadata),
    )
    return header, _bytes(block)


def revocation_transaction(
    config_envelope: bytes,
    lists: Mapping[str, Sequence[bytes]],
    admins: Mapping[str, SigningIdentity],
    orderer: SigningIdentity,
    timestamp_ms: int,
    nonces: Sequence[bytes],
) -> tuple[str, bytes] | None:
    """A CONFIG transaction that gives organisations these revocation lists (PEM), or None when nothing changes.

    `config_envelope` is the last config transaction's data; `lists` and `admins` go by MSP id; each admin signs for
    its own organisation, the orderer signs the transaction; `nonces` are one per signature, 24 random bytes each.
    Returns transaction id and envelope. Raises `RevocationListError` for a list that must not be on the channel.
    """
    config = decode(configtx_pb2.ConfigEnvelope, config_envelope, "channel configuration", LedgerError).config
    channel_id = ""
    read_set = configtx_pb2.ConfigGroup(version=config.channel_group.version)
    write_set = configtx_pb2.ConfigGroup(version=config.channel_group.version)
    changed: list[str] = []
    for section, group in config.channel_group.groups.items():
        for name, organisation in group.groups.items():
            value = organisation.values["MSP"]
            new = _with_lists(value.value, lists)
            if new is None:
                continue
            msp_id, value.value = new
            value.version += 1
            for update, written in ((read_set, False), (write_set, True)):
                target = update.groups[section]
                target.version = group.version
                target.groups[name].version = organisation.version
                if written:
                    target.groups[name].values["MSP"].CopyFrom(value)
            changed.append(msp_id)
    if not changed:
        return None
    config.sequence += 1
    signers = [admins[msp_id] for msp_id in dict.fromkeys(changed)]
    headers = [
        _bytes(common_pb2.SignatureHeader(creator=signer.creator, nonce=nonce))
        for signer, nonce in zip(signers, nonces, strict=False)
    ]
    if len(headers) < len(signers) or len(nonces) <= len(signers):
        raise EmbeddedLedgerError("too few nonces for the config transaction's signatures")
    channel_id = _channel_of(config)
    update_bytes = _bytes(configtx_pb2.ConfigUpdate(channel_id=channel_id, read_set=read_set, write_set=write_set))
    update = configtx_pb2.ConfigUpdateEnvelope(
        config_update=update_bytes,
        signatures=[
            configtx_pb2.ConfigSignature(signature_header=header, signature=signer.sign(header + update_bytes))
            for signer, header in zip(signers, headers, strict=True)
        ],
    )
    del channel_id
    last_update = _envelope(common_pb2.CONFIG_UPDATE, "", _bytes(update), signers[0], timestamp_ms, nonces[0])
    data = _bytes(configtx_pb2.ConfigEnvelope(config=config, last_update=last_update))
    return _tx_id(nonces[-1], orderer), _bytes(
        _envelope(common_pb2.CONFIG, "", data, orderer, timestamp_ms, nonces[-1])
    )


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
