"""Signature policies: who must sign, as Fabric writes it down (``common.SignaturePolicyEnvelope``) and counts it.

Used for a contract's endorsement policy and for a key's own one (its metadata ``VALIDATION_PARAMETER``). Source:
``common/policies.proto``, Fabric ``common/cauthdsl`` for the counting.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from fabric_protos.common import policies_pb2
from fabric_protos.msp import msp_principal_pb2
from google.protobuf.message import DecodeError

if TYPE_CHECKING:
    from collections.abc import Sequence

VALIDATION_PARAMETER: Final = "VALIDATION_PARAMETER"
"""The entry of a key's metadata that holds its endorsement policy (``peer.MetaDataKeys``)."""
MEMBER: Final = "MEMBER"
PEER: Final = "PEER"
MAX_DEPTH: Final = 32


@dataclass(frozen=True, slots=True)
class Signer:
    """Who gave a signature that holds: organisation, and its role there (PEER, ORDERER, CLIENT, ADMIN)."""

    msp_id: str
    role: str = PEER
    creator: bytes = b""
    """Its serialised identity, where a policy may name it (BFT orderers); empty where none does."""


def role_principal(msp_id: str, role: str) -> msp_principal_pb2.MSPPrincipal:
    """Whoever has that role in that organisation."""
    role_number = msp_principal_pb2.MSPRole.MSPRoleType.Value(role.upper())
    return msp_principal_pb2.MSPPrincipal(
        principal_classification=msp_principal_pb2.MSPPrincipal.ROLE,
        principal=msp_principal_pb2.MSPRole(msp_identifier=msp_id, role=role_number).SerializeToString(),
    )


def one_of_each(role: str, *groups: Sequence[str]) -> policies_pb2.SignaturePolicyEnvelope:
    """A signature of that role from one organisation of each group: ``(A,), (B, C)`` is A and (B or C)."""
    principals: list[msp_principal_pb2.MSPPrincipal] = []

    def signed_by(msp_id: str) -> policies_pb2.SignaturePolicy:
        principals.append(role_principal(msp_id, role))
        return policies_pb2.SignaturePolicy(signed_by=len(principals) - 1)

    def out_of(count: int, rules: Sequence[policies_pb2.SignaturePolicy]) -> policies_pb2.SignaturePolicy:
        return policies_pb2.SignaturePolicy(n_out_of=policies_pb2.SignaturePolicy.NOutOf(n=count, rules=rules))

    rules = [
        signed_by(each[0]) if len(each) == 1 else out_of(1, [signed_by(msp_id) for msp_id in each]) for each in groups
    ]
    rule = out_of(len(rules), rules)
    return policies_pb2.SignaturePolicyEnvelope(version=0, rule=rule, identities=principals)


def key_policy(msp_ids: Sequence[str]) -> bytes:
    """What a key's metadata holds when peers of all these organisations must endorse its changes.

    Equal organisations give equal bytes, in whatever order they are named: endorsers must agree on them.
    """
    groups = ((msp_id,) for msp_id in sorted(set(msp_ids)))
    return bytes(one_of_each(PEER, *groups).SerializeToString(deterministic=True))


def parse_policy(data: bytes) -> policies_pb2.SignaturePolicyEnvelope | None:
    """The policy in a key's metadata; None for bytes that are none, which nobody can satisfy."""
    try:
        return policies_pb2.SignaturePolicyEnvelope.FromString(data)
    except DecodeError:
        return None


def satisfied(policy: policies_pb2.SignaturePolicyEnvelope, signers: Sequence[Signer]) -> bool:
    """Whether these signatures meet the policy. One signature counts for one principal of it, as on Fabric."""
    return _holds(policy.rule, policy, signers, [False] * len(signers), 0)


def _holds(
    rule: policies_pb2.SignaturePolicy,
    policy: policies_pb2.SignaturePolicyEnvelope,
    signers: Sequence[Signer],
    used: list[bool],
    depth: int,
) -> bool:
    """As Fabric's ``cauthdsl.compile``: rules in order, each takes the signatures that it needs."""
    if depth > MAX_DEPTH:
        return False
    kind = rule.WhichOneof("Type")
    if kind == "signed_by":
        if not 0 <= rule.signed_by < len(policy.identities):
            return False
        principal = policy.identities[rule.signed_by]
        for index, signer in enumerate(signers):
            if not used[index] and _is(signer, principal):
                used[index] = True
                return True
        return False
    if kind != "n_out_of":
        return False
    met = 0
    for each in rule.n_out_of.rules:
        trial = list(used)
        if _holds(each, policy, signers, trial, depth + 1):
            met += 1
            used[:] = trial
    return bool(met >= rule.n_out_of.n)


def _is(signer: Signer, principal: msp_principal_pb2.MSPPrincipal) -> bool:
    if principal.principal_classification == msp_principal_pb2.MSPPrincipal.IDENTITY:
        return bool(signer.creator) and bytes(principal.principal) == signer.creator
    if principal.principal_classification != msp_principal_pb2.MSPPrincipal.ROLE:
        return False
    try:
        wanted = msp_principal_pb2.MSPRole.FromString(principal.principal)
    except DecodeError:
        return False
    role: str = msp_principal_pb2.MSPRole.MSPRoleType.Name(wanted.role)
    msp_id: str = wanted.msp_identifier
    return msp_id == signer.msp_id and role in {MEMBER, signer.role}
