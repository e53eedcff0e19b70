"""Whom a channel trusts: the organisations' MSPs as a config block carries them.

Sources: ``common.Config`` (groups.Application and groups.Orderer, then one group per organisation, its value
"MSP" an ``msp.MSPConfig`` of type 0 with a ``msp.FabricMSPConfig``), Fabric's "Membership Service Providers".
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from fabric_protos.common import configtx_pb2, configuration_pb2, policies_pb2
from fabric_protos.msp import msp_config_pb2

from wonderland_fabric_gateway.errors import BlockError
from wonderland_fabric_gateway.protobuf import decode

if TYPE_CHECKING:
    from collections.abc import Mapping

MAX_ORGANISATIONS: Final = 1_000
_FABRIC_MSP: Final = 0
_SECTIONS: Final = ("Application", "Orderer")


@dataclass(frozen=True, slots=True)
class Organisation:
    """An MSP of the channel. Certificates and revocation lists are PEM, as they stand in the config.

    `node_ous` maps client, peer, admin, orderer to the organisational unit that marks them; empty when the MSP
    does not tell kinds of members apart. `sections` says where it stands: Application, Orderer or both.
    """

    msp_id: str
    sections: tuple[str, ...]
    root_certs: tuple[bytes, ...]
    intermediate_certs: tuple[bytes, ...]
    revocation_lists: tuple[bytes, ...]
    admin_certs: tuple[bytes, ...]
    tls_root_certs: tuple[bytes, ...]
    node_ous: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class ChannelConfig:
    """A channel's configuration, as far as trust hangs on it: the sequence number and the organisations by MSP id."""

    sequence: int
    organisations: Mapping[str, Organisation]


def parse_channel_config(config_envelope: bytes) -> ChannelConfig:
    """Read a ``common.ConfigEnvelope`` (the data of a CONFIG transaction). Raises `BlockError`."""
    envelope = decode(configtx_pb2.ConfigEnvelope, config_envelope, "config transaction", BlockError)
    groups = envelope.config.channel_group.groups
    organisations: dict[str, Organisation] = {}
    for section in _SECTIONS:
        if section not in groups:
            continue
        members = groups[section].groups
        if len(members) > MAX_ORGANISATIONS:
            raise BlockError(f"config: {len(members)} organisations in {section}; the limit is {MAX_ORGANISATIONS}")
        for name in sorted(members):
            organisation = _organisation(name, section, members[name])
            known = organisations.get(organisation.msp_id)
            organisations[organisation.msp_id] = organisation if known is None else _both(known, organisation)
    if not organisations:
        raise BlockError("config: no organisation, so that nobody could be trusted")
    return ChannelConfig(sequence=int(envelope.config.sequence), organisations=MappingProxyType(organisations))


def orderer_addresses(config_envelope: bytes) -> tuple[str, ...]:
    """The ``host:port`` of all orderers that the organisations name, in order. Raises `BlockError`."""
    envelope = decode(configtx_pb2.ConfigEnvelope, config_envelope, "config transaction", BlockError)
    groups = envelope.config.channel_group.groups
    found: list[str] = []
    if "Orderer" in groups:
        members = groups["Orderer"].groups
        for name in sorted(members):
            values = members[name].values
            if "Endpoints" in values:
                what = f"config: endpoints of {name}"
                found += decode(
                    configuration_pb2.OrdererAddresses, values["Endpoints"].value, what, BlockError
                ).addresses
    return tuple(found)


def endorsement_policy(config_envelope: bytes) -> policies_pb2.SignaturePolicyEnvelope:
    """Who must endorse a transaction: the application's policy "Endorsement". Raises `BlockError`.

    Only a policy that counts signatures is understood; one of sub-policies (ImplicitMeta) raises, too.
    """
    envelope = decode(configtx_pb2.ConfigEnvelope, config_envelope, "config transaction", BlockError)
    policy = envelope.config.channel_group.groups["Application"].policies["Endorsement"].policy
    if policy.type != policies_pb2.Policy.SIGNATURE:
        raise BlockError("config: the application's endorsement policy is none that counts signatures")
    return decode(policies_pb2.SignaturePolicyEnvelope, policy.value, "config: endorsement policy", BlockError)


def _organisation(name: str, section: str, group: Any) -> Organisation:
    if "MSP" not in group.values:
        raise BlockError(f"config: organisation {name} in {section} has no MSP")
    wrapper = decode(msp_config_pb2.MSPConfig, group.values["MSP"].value, f"config: MSP of {name}", BlockError)
    if wrapper.type != _FABRIC_MSP:
        raise BlockError(f"config: the MSP of {name} has type {wrapper.type}; only X.509 MSPs (type 0) are understood")
    msp = decode(msp_config_pb2.FabricMSPConfig, wrapper.config, f"config: MSP of {name}", BlockError)
    if not msp.name or not msp.root_certs:
        raise BlockError(f"config: the MSP of {name} has no name or no root certificate")
    return Organisation(
        msp_id=msp.name,
        sections=(section,),
        root_certs=tuple(msp.root_certs),
        intermediate_certs=tuple(msp.intermediate_certs),
        revocation_lists=tuple(msp.revocation_list),
        admin_certs=tuple(msp.admins),
        tls_root_certs=tuple(msp.tls_root_certs),
        node_ous=MappingProxyType(_node_ous(msp.fabric_node_ous)),
    )


def _node_ous(units: Any) -> dict[str, str]:
    if not units.enable:
        return {}
    named = {
        "client": units.client_ou_identifier.organizational_unit_identifier,
        "peer": units.peer_ou_identifier.organizational_unit_identifier,
        "admin": units.admin_ou_identifier.organizational_unit_identifier,
        "orderer": units.orderer_ou_identifier.organizational_unit_identifier,
    }
    return {kind: unit for kind, unit in named.items() if unit}


def _both(first: Organisation, second: Organisation) -> Organisation:
    """One organisation that stands in two sections. Fabric demands that both say the same."""
    if (first.root_certs, first.intermediate_certs, first.node_ous) != (
        second.root_certs,
        second.intermediate_certs,
        second.node_ous,
    ):
        raise BlockError(f"config: {first.msp_id} stands in two sections with different certificates")
    revoked = first.revocation_lists + tuple(x for x in second.revocation_lists if x not in first.revocation_lists)
    return Organisation(
        msp_id=first.msp_id,
        sections=first.sections + second.sections,
        root_certs=first.root_certs,
        intermediate_certs=first.intermediate_certs,
        revocation_lists=revoked,
        admin_certs=first.admin_certs,
        tls_root_certs=first.tls_root_certs,
        node_ous=first.node_ous,
    )
