"""What a verdict rests on, from block to block: which transaction wrote what another one read.

Endorsers sign the version (block and position) of every key that a transaction read, and a ledger commits it only
while these versions are the newest. So a read names the one transaction whose write it saw: nothing older can be put
in its place, and nothing newer was left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from fabric_protos.peer.lifecycle import chaincode_definition_pb2, db_pb2

from wonderland.proofs.records import keys
from wonderland_evidence.errors import NotCheckedError, StepError
from wonderland_fabric_gateway.errors import BlockError
from wonderland_fabric_gateway.protobuf import decode
from wonderland_fabric_gateway.signature_policies import VALIDATION_PARAMETER

if TYPE_CHECKING:
    from collections.abc import Iterator

    from wonderland_evidence.case import Case
    from wonderland_fabric_gateway.transactions import Invocation, Read, Version

LIFECYCLE: Final = "_lifecycle"
WITH_OWN_POLICY: Final = frozenset({keys.SESSION, keys.PAD, keys.PREKEY, keys.TESTIMONY})
"""Records that the contract gives their organisation's own endorsement policy, and never without having read them."""
JUDGED: Final = ("RequestProof", "WitnessProof", "SubmitProof")
MAX_LINKS: Final = 256


@dataclass(frozen=True)
class Definition:
    """What the channel had agreed on for a contract: its version and who must endorse (``peer.ApplicationPolicy``)."""

    sequence: int
    policy: bytes
    agreed: tuple[Version, ...]
    """The transactions in which it was agreed."""


def reads(invocation: Invocation, namespace: str) -> Iterator[Read]:
    """All that a transaction read in a namespace, ranges included, but for those recorded as a summary only."""
    for access in invocation.accesses:
        if access.namespace != namespace:
            continue
        yield from access.reads
        for query in access.range_queries:
            yield from query.reads or ()


def version_read(invocation: Invocation, namespace: str, key: str) -> tuple[bool, Version | None]:
    """Whether a key was read, and the version that was found."""
    for each in reads(invocation, namespace):
        if each.key == key:
            return True, each.version
    return False, None


def written(invocation: Invocation, namespace: str, key: str) -> bytes | None:
    """What a transaction wrote under a key; None where it wrote nothing or deleted it."""
    for where, write in ((access.namespace, write) for access in invocation.accesses for write in access.writes):
        if (where, write.key) == (namespace, key):
            return None if write.is_delete else write.value
    return None


def value_at(case: Case, place: Version, namespace: str, key: str) -> bytes:
    """The value of a key after a transaction that wrote it. Raises `StepError` where it did not."""
    value = written(case.transaction(place, f"{name_of(key)} was read as written there").invocation, namespace, key)
    if value is None:
        raise StepError(f"{name_of(key)} was read as of block {place.block}, and that transaction did not write it")
    return value


def definition(case: Case, place: Version) -> Definition:
    """The contract's definition under which a transaction was endorsed; on Fabric every one reads its sequence."""
    chaincode = case.bundle.chaincode
    prefix = f"namespaces/fields/{chaincode}/"
    invocation = case.transaction(place, "the session").invocation
    found, agreed = version_read(invocation, LIFECYCLE, prefix + "Sequence")
    if not found or agreed is None:
        raise StepError("a transaction that does not say under which definition of its contract it was endorsed")
    sequence, at = _field(case, agreed, prefix + "Sequence")
    information, where = _field(case, agreed, prefix + "ValidationInfo")
    validation = decode(
        chaincode_definition_pb2.ChaincodeValidationInfo, information.Bytes, "contract definition", BlockError
    )
    if validation.validation_plugin != "vscc":
        raise StepError(f"the contract is validated by {validation.validation_plugin!r}, which nobody here knows")
    return Definition(int(sequence.Int64), validation.validation_parameter, tuple(dict.fromkeys((at, where))))


def _field(case: Case, place: Version, key: str) -> tuple[db_pb2.StateData, Version]:
    """A field of a definition as of the transaction that agreed on it; an unchanged one was written earlier."""
    for _ in range(MAX_LINKS):
        invocation = case.transaction(place, f"the channel agreed on {key} there").invocation
        value = written(invocation, LIFECYCLE, key)
        if value is not None:
            return decode(db_pb2.StateData, value, "contract definition", BlockError), place
        found, before = version_read(invocation, LIFECYCLE, key)
        if not found or before is None:
            break
        place = before
    raise StepError(f"{key} was never agreed on")


def own_policy(case: Case, place: Version, key: str) -> tuple[bytes | None, tuple[Version, ...]]:
    """Who must endorse when a transaction writes a key, None where the contract's policy says it, and where it is set.

    The places are the transactions that say so, back to the one that set the policy.
    """
    if keys.split(key)[0] not in WITH_OWN_POLICY:
        return None, ()
    chaincode = case.bundle.chaincode
    invocation = case.transaction(place, "the session").invocation
    passed: list[Version] = []
    for _ in range(MAX_LINKS):
        found, before = version_read(invocation, chaincode, key)
        if not found or before is None:
            return None, tuple(passed)
        passed.append(before)
        invocation = case.transaction(before, f"{name_of(key)} was written there").invocation
        for access in invocation.accesses:
            for each in access.metadata_writes if access.namespace == chaincode else ():
                if each.key == key:
                    return dict(each.entries).get(VALIDATION_PARAMETER), tuple(passed)
        if written(invocation, chaincode, key) is None:
            return None, tuple(passed)
    raise NotCheckedError(f"{name_of(key)} was changed more than {MAX_LINKS} times")


def rests_on(case: Case) -> dict[Version, str]:
    """Every transaction that the session rests on, with what it gave; raises `MissingBlockError` for the first absent.

    An exporter fetches what is missed until nothing is.
    """
    chaincode = case.bundle.chaincode
    found: dict[Version, str] = {}
    for place, function in case.session.items():
        found[place] = function
        invocation = case.transaction(place, function).invocation
        for read in reads(invocation, chaincode):
            if read.version is not None and (function in JUDGED or keys.split(read.key)[0] in WITH_OWN_POLICY):
                case.transaction(read.version, f"{name_of(read.key)} was written there")
                found.setdefault(read.version, name_of(read.key))
                if keys.split(read.key)[0] == keys.PAD and function in JUDGED:
                    for at in _commissioned(case, read.version, read.key):
                        found.setdefault(at, f"commissioning of {name_of(read.key)}")
    waiting = list(found)
    while waiting:
        place = waiting.pop()
        more: dict[Version, str] = {}
        invocation = case.transaction(place, found[place]).invocation
        for key in keys_written(invocation, chaincode):
            more.update(dict.fromkeys(own_policy(case, place, key)[1], f"who must endorse {name_of(key)}"))
        if not case.is_embedded and invocation.chaincode == chaincode:
            more.update(dict.fromkeys(definition(case, place).agreed, "definition of the contract"))
        waiting += [each for each in more if each not in found]
        found = {**more, **found}
    return found


def keys_written(invocation: Invocation, namespace: str) -> list[str]:
    """The keys of which a transaction changes the value or who must endorse."""
    found: dict[str, None] = {}
    for access in invocation.accesses:
        if access.namespace == namespace:
            found.update(dict.fromkeys(each.key for each in access.writes))
            found.update(dict.fromkeys(each.key for each in access.metadata_writes))
    return list(found)


def _commissioned(case: Case, place: Version, key: str) -> Iterator[Version]:
    """From a pad's newest record back to the transaction that commissioned it."""
    for _ in range(MAX_LINKS):
        yield place
        invocation = case.transaction(place, f"{name_of(key)} was written there").invocation
        if invocation.function in {"CommissionPad", "RegisterPad"}:
            return
        found, before = version_read(invocation, case.bundle.chaincode, key)
        if not found or before is None:
            return
        place = before


def name_of(key: str) -> str:
    """A ledger key for people."""
    kind, attributes = keys.split(key)
    return " ".join((kind, *(each if len(each) < 40 else f"{each[:12]}…" for each in attributes))).strip()
