"""network.yaml: a Fabric network described once. Its check and its JSON Schema are the same definition."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Final, Self

import yaml

from wonderland.proofs.errors import RecordError
from wonderland.proofs.records.schema import Choice, Described, Integer, Items, Record, Text
from wonderland_fabric_gateway.files import PUBLIC, read_bounded, write_atomic
from wonderland_fabric_network.endorsement import EndorsementPolicy, parse_endorsement
from wonderland_fabric_network.errors import DescriptionError
from wonderland_fabric_network.strict_yaml import YamlError, read_yaml

MSP_ID: Final = r"[A-Za-z][A-Za-z0-9.-]{0,62}"
CHANNEL_NAME: Final = r"[a-z][a-z0-9.-]{0,248}"
PADS: Final = "pads"
KINDS: Final = ("authority", PADS, "fleet")
ONE: Final = "one"
EACH: Final = "each"
MAX_YAML_BYTES: Final = 1 << 20
BFT_MINIMUM: Final = 4

_MspId = Annotated[str, Text(63, MSP_ID, "The organisation's name on the channel, for example PadMSP")]


@dataclass(frozen=True, kw_only=True)
class Organisation(Record):
    """An organisation that uses the channel, with its own CA and peers."""

    RECORD = "NetworkOrganisation"
    msp_id: _MspId
    kind: Annotated[
        str, Choice(KINDS, "What it does: authority, operator of pads, operator of a fleet; it decides on the roles")
    ]
    peers: Annotated[int, Integer(1, 20, "How many peers it runs")] = 1


@dataclass(frozen=True, kw_only=True)
class OrderingOrganisation(Record):
    """An organisation that orders blocks, with its own CA."""

    msp_id: _MspId
    orderers: Annotated[int, Integer(1, 20, "How many orderers it runs")] = 1


@dataclass(frozen=True, kw_only=True)
class Ordering(Record):
    """How transactions become blocks."""

    consensus: Annotated[
        str, Choice(("raft", "bft"), "raft bears crashes of a minority; bft also lies of less than a third")
    ] = "raft"
    organisations: Annotated[tuple[OrderingOrganisation, ...], Items(1, 20, "Who runs the orderers")] = (
        OrderingOrganisation(msp_id="OrdererMSP"),
    )
    batch_timeout_ms: Annotated[
        int, Integer(1, 60_000, "How long a transaction waits at most for others to share its block")
    ] = 20
    batch_count: Annotated[int, Integer(1, 10_000, "Transactions that fill a block")] = 500

    @property
    def count(self) -> int:
        """How many orderers there are, of all organisations."""
        return sum(each.orderers for each in self.organisations)

    def validate(self, path: str) -> None:
        """BFT needs 3f + 1 orderers, f at least 1."""
        if self.consensus == "bft" and self.count < BFT_MINIMUM:
            raise RecordError(
                f"{path}.organisations", f"{self.count} orderers; bft needs at least {BFT_MINIMUM} to bear one traitor"
            )


@dataclass(frozen=True, kw_only=True)
class ContractDescription(Record):
    """The contract that the organisations agree on."""

    name: Annotated[str, Text(64, r"[A-Za-z0-9]+([_-][A-Za-z0-9]+)*", "Its name on the channel", 1)] = "pol"
    package: Annotated[
        str, Text(64, r"[A-Za-z0-9_.-]+", "The installed contract (entry point wonderland.contracts)", 1)
    ] = "pol"
    endorsement: Annotated[
        str, Text(4_000, description="Who must sign each transaction: AND, OR, OutOf(n, …) of 'MSP.role'", min_length=1)
    ] = "AND('AuthorityMSP.peer', 'PadMSP.peer')"

    @property
    def policy(self) -> EndorsementPolicy:
        """The parsed endorsement policy."""
        return parse_endorsement(self.endorsement)


@dataclass(frozen=True, kw_only=True)
class Certificates(Record):
    """What the organisations' CAs issue."""

    valid_days: Annotated[int, Integer(1, 1_825, "How long a certificate is valid")] = 365
    revocation_list_days: Annotated[int, Integer(1, 365, "How long a revocation list says that it is current")] = 30


@dataclass(frozen=True, kw_only=True)
class NetworkDescription(Record):
    """A Fabric network: who takes part, how blocks are made, and which contract runs."""

    RECORD = "Network"
    channel: Annotated[str, Text(249, CHANNEL_NAME, "The channel's name", 1)] = "wonderland"
    organisations: Annotated[tuple[Organisation, ...], Items(1, 50, "Who uses the channel")] = (
        Organisation(msp_id="AuthorityMSP", kind="authority"),
        Organisation(msp_id="PadMSP", kind="pads"),
        Organisation(msp_id="FleetMSP", kind="fleet"),
    )
    ordering: Annotated[Ordering, Described("How transactions become blocks")] = Ordering()
    contract: Annotated[ContractDescription, Described("The contract that the organisations agree on")] = (
        ContractDescription()
    )
    certificates: Annotated[Certificates, Described("What the organisations' CAs issue")] = Certificates()
    hosts: Annotated[
        str,
        Choice(
            (ONE, EACH),
            "one: everything is on this machine, at host; each: every component has a host of its own, named like "
            "peer0.padmsp, and something else runs it (containers, system services)",
        ),
    ] = ONE
    host: Annotated[
        str,
        Text(
            253,
            r"[A-Za-z0-9]([A-Za-z0-9.:-]*[A-Za-z0-9])?",
            "Address at which all components listen, where hosts is one",
            1,
        ),
    ] = "127.0.0.1"
    first_port: Annotated[
        int,
        Integer(
            0, 60_000, "Ports are counted up from here, where hosts is one; 0 chooses free ones once and keeps them"
        ),
    ] = 0

    def validate(self, path: str) -> None:
        """Names that must be there, and only once."""
        del path
        seen: dict[str, str] = {}
        places = [(f"organisations[{i}].msp_id", each.msp_id) for i, each in enumerate(self.organisations)]
        places += [
            (f"ordering.organisations[{i}].msp_id", each.msp_id) for i, each in enumerate(self.ordering.organisations)
        ]
        for place, msp_id in places:
            # Directories and certificates' host names do not tell upper from lower case everywhere.
            if msp_id.lower() in seen:
                raise RecordError(
                    place, f"{msp_id!r} is also {seen[msp_id.lower()]}; each organisation needs its own name"
                )
            seen[msp_id.lower()] = place
        if sum(each.kind == "authority" for each in self.organisations) != 1:
            raise RecordError("organisations", "exactly one must have kind authority")
        known = {each.msp_id for each in self.organisations}
        try:
            policy = self.contract.policy
        except DescriptionError as error:
            raise RecordError("contract.endorsement", str(error)) from error
        for msp_id in policy.organisations:
            if msp_id not in known:
                raise RecordError(
                    "contract.endorsement", f"names {msp_id}, which is none of {', '.join(sorted(known))}"
                )

    def require_pads_endorse(self) -> None:
        """Raise `DescriptionError` unless every operator of pads may endorse.

        A pad's own records need its organisation's signature (decision 0005); without one they could never change.
        """
        named = self.contract.policy.organisations
        silent = [each.msp_id for each in self.organisations if each.kind == PADS and each.msp_id not in named]
        if silent:
            raise DescriptionError(
                f"contract.endorsement: {self.contract.endorsement} leaves {', '.join(silent)} without a signature, so "
                "that nothing of its pads could ever change. Next: write "
                f"{standard_endorsement(self.organisations)}"
            )

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a description. Raises `DescriptionError`, which names the file and the field."""
        return cls.from_yaml(read_bounded(path, DescriptionError, "network description", MAX_YAML_BYTES), str(path))

    @classmethod
    def from_yaml(cls, data: bytes, source: str = "network.yaml") -> Self:
        """Parse a description. Raises `DescriptionError`."""
        try:
            document = read_yaml(data).document
        except YamlError as cause:
            raise DescriptionError(f"{source}: {cause}") from cause
        try:
            return cls.parse({} if document is None else document)
        except RecordError as cause:
            raise DescriptionError(f"{source}: {cause}") from cause

    def to_yaml(self) -> bytes:
        """The description as YAML; reading it back gives the same."""
        text: str = yaml.safe_dump(self.to_json(), sort_keys=False, allow_unicode=True)
        return text.encode()

    def save(self, path: Path) -> None:
        """Write it. Raises `FileWriteError`."""
        write_atomic(path, self.to_yaml(), PUBLIC)

    def with_ordering(self, consensus: str | None = None, orderers: int | None = None) -> Self:
        """The same network with another consensus, or another number of orderers of the first ordering organisation."""
        ordering = self.ordering
        first, *others = ordering.organisations
        if orderers is None and consensus == "bft" and ordering.count < BFT_MINIMUM:
            orderers = BFT_MINIMUM - sum(each.orderers for each in others)
        changed = replace(
            ordering,
            consensus=consensus or ordering.consensus,
            organisations=(replace(first, orderers=orderers or first.orderers), *others),
        )
        return self._checked(replace(self, ordering=changed))

    def with_hosts(self, hosts: str) -> Self:
        """The same network on one host, or with each component on its own. Raises `DescriptionError`."""
        return self._checked(replace(self, hosts=hosts))

    def with_endorsement(self, endorsement: str) -> Self:
        """The same network with another endorsement policy. Raises `DescriptionError`."""
        return self._checked(replace(self, contract=replace(self.contract, endorsement=endorsement)))

    def with_organisation(self, organisation: Organisation) -> Self:
        """The same network with one more organisation. Raises `DescriptionError`."""
        return self._checked(replace(self, organisations=(*self.organisations, organisation)))

    def without_organisation(self, msp_id: str) -> Self:
        """The same network without one. Raises `DescriptionError`."""
        kept = tuple(each for each in self.organisations if each.msp_id != msp_id)
        return self._checked(replace(self, organisations=kept))

    def with_batching(self, timeout_ms: int, count: int) -> Self:
        """The same network with other blocks. Raises `DescriptionError`."""
        ordering = replace(self.ordering, batch_timeout_ms=timeout_ms, batch_count=count)
        return self._checked(replace(self, ordering=ordering))

    def _checked(self, changed: Self) -> Self:
        try:
            return type(self).parse(changed.to_json())
        except RecordError as cause:
            raise DescriptionError(str(cause)) from cause

    def organisation(self, msp_id: str) -> Organisation:
        """The organisation of that name. Raises `DescriptionError`."""
        for each in self.organisations:
            if each.msp_id == msp_id:
                return each
        raise DescriptionError(
            f"{msp_id} is no organisation of this network; there are "
            f"{', '.join(each.msp_id for each in self.organisations)}"
        )


def standard_endorsement(organisations: Sequence[Organisation]) -> str:
    """The policy of a network like that: the authority, and one of the operators of pads."""
    (authority,) = [f"'{each.msp_id}.peer'" for each in organisations if each.kind == "authority"]
    pads = [f"'{each.msp_id}.peer'" for each in organisations if each.kind == PADS]
    operators = f"OR({', '.join(pads)})" if len(pads) > 1 else "".join(pads)
    return f"AND({', '.join(filter(None, (authority, operators)))})"


def extended_endorsement(description: NetworkDescription) -> str | None:
    """The standard policy with all operators of pads, where the present one is the standard one without some.

    None where the present one names them all. Raises `DescriptionError` for a policy that only people can extend.
    """
    present = description.contract.policy
    silent = [
        each for each in description.organisations if each.kind == PADS and each.msp_id not in present.organisations
    ]
    if not silent:
        return None
    before = [each for each in description.organisations if each not in silent]
    standard = standard_endorsement(description.organisations)
    if present.envelope() != parse_endorsement(standard_endorsement(before)).envelope():
        names = ", ".join(each.msp_id for each in silent)
        raise DescriptionError(
            f"{names} operates pads, whose records need its signature, and the endorsement policy {present.text} is "
            f"one of your own. Next: say with --endorsement what it becomes, for example {standard}"
        )
    return standard


def json_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of network.yaml."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **NetworkDescription.json_schema()}


__all__ = [
    "EACH",
    "ONE",
    "Certificates",
    "ContractDescription",
    "NetworkDescription",
    "Ordering",
    "OrderingOrganisation",
    "Organisation",
    "extended_endorsement",
    "json_schema",
    "standard_endorsement",
]
