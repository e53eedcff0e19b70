"""Endorsement policies as text: ``AND('AuthorityMSP.peer', OR('PadMSP.peer', 'Pad2MSP.peer'))``.

The language of Fabric's documentation ("Endorsement policies"): AND, OR, OutOf(n, …), and principals 'MSP.role' with
the roles member, admin, client, peer, orderer.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from fabric_protos.common import policies_pb2
from fabric_protos.msp import msp_principal_pb2
from fabric_protos.peer import policy_pb2

from wonderland_fabric_gateway.channel_groups import serialise
from wonderland_fabric_gateway.protobuf import decode
from wonderland_fabric_gateway.signature_policies import role_principal
from wonderland_fabric_network.errors import DescriptionError

if TYPE_CHECKING:
    from collections.abc import Iterator

ROLES: Final = ("member", "admin", "client", "peer", "orderer")
MAX_DEPTH: Final = 10
MAX_PRINCIPALS: Final = 200
_TOKEN: Final = re.compile(r"\s*(?:(?P<word>[A-Za-z]+|\d{1,4})|(?P<principal>'[^']*'|\"[^\"]*\")|(?P<mark>[(),]))")


@dataclass(frozen=True, slots=True)
class Principal:
    """Whoever has a role in an organisation."""

    msp_id: str
    role: str


@dataclass(frozen=True)
class EndorsementPolicy:
    """A parsed policy. `organisations` are the MSP ids that it names, in order, each once."""

    text: str
    rule: policies_pb2.SignaturePolicy
    principals: tuple[Principal, ...]

    @property
    def organisations(self) -> tuple[str, ...]:
        """The MSP ids that it names."""
        return tuple(dict.fromkeys(principal.msp_id for principal in self.principals))

    def envelope(self) -> policies_pb2.SignaturePolicyEnvelope:
        """``common.SignaturePolicyEnvelope``."""
        identities = [role_principal(principal.msp_id, principal.role) for principal in self.principals]
        return policies_pb2.SignaturePolicyEnvelope(version=0, identities=identities, rule=self.rule)

    def validation_parameter(self) -> bytes:
        """What a contract's definition carries: ``protos.ApplicationPolicy``."""
        return serialise(policy_pb2.ApplicationPolicy(signature_policy=self.envelope()))


def parse_endorsement(text: str) -> EndorsementPolicy:
    """Parse a policy. Raises `DescriptionError` that quotes the place."""
    parser = _Parser(text)
    rule = parser.rule(0)
    parser.end()
    return EndorsementPolicy(text, rule, tuple(parser.principals))


def organisations_of(validation_parameter: bytes) -> frozenset[str]:
    """The MSP ids that a committed definition's policy (``protos.ApplicationPolicy``) names."""
    return frozenset(principal.msp_id for principal in _principals(_committed(validation_parameter)))


def endorsement_text(validation_parameter: bytes) -> str:
    """A committed definition's policy as text; parsed again it is the same policy. Raises `DescriptionError`."""
    policy = _committed(validation_parameter)
    principals = _principals(policy)

    def said(rule: policies_pb2.SignaturePolicy, depth: int) -> str:
        if depth > MAX_DEPTH:
            raise DescriptionError(f"the committed endorsement policy is nested deeper than {MAX_DEPTH}")
        if rule.WhichOneof("Type") == "signed_by":
            who = principals[rule.signed_by]
            return f"'{who.msp_id}.{who.role}'"
        rules = [said(each, depth + 1) for each in rule.n_out_of.rules]
        if rule.n_out_of.n == len(rules):
            return f"AND({', '.join(rules)})"
        return f"OR({', '.join(rules)})" if rule.n_out_of.n == 1 else f"OutOf({rule.n_out_of.n}, {', '.join(rules)})"

    text = said(policy.rule, 0)
    if parse_endorsement(text).validation_parameter() != validation_parameter:
        raise DescriptionError(
            f"the committed endorsement policy is one that cannot be said as text exactly; {text} comes near. Next: "
            "say with --endorsement what is to hold"
        )
    return text


def _committed(validation_parameter: bytes) -> policies_pb2.SignaturePolicyEnvelope:
    found = decode(policy_pb2.ApplicationPolicy, validation_parameter, "endorsement policy", DescriptionError)
    return found.signature_policy


def _principals(policy: policies_pb2.SignaturePolicyEnvelope) -> list[Principal]:
    roles = [
        decode(msp_principal_pb2.MSPRole, each.principal, "endorsement policy", DescriptionError)
        for each in policy.identities
    ]
    return [Principal(str(each.msp_identifier), ROLES[each.role]) for each in roles]


@dataclass
class _Parser:
    text: str
    principals: list[Principal] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._tokens = list(self._split())
        self._at = 0

    def rule(self, depth: int) -> policies_pb2.SignaturePolicy:
        if depth > MAX_DEPTH:
            raise self._wrong(f"nested deeper than {MAX_DEPTH}")
        token = self._next("a rule")
        if token[0] in "'\"":
            return policies_pb2.SignaturePolicy(signed_by=self._principal(token[1:-1]))
        operator = token.upper()
        if operator not in {"AND", "OR", "OUTOF"}:
            raise self._wrong(f"{token!r} is none of AND, OR, OutOf, 'MSP.role'")
        self._expect("(")
        count = 0
        if operator == "OUTOF":
            number = self._next("a number")
            if not number.isdigit():
                raise self._wrong(f"OutOf takes a number first, not {number!r}")
            count = int(number)
            self._expect(",")
        rules = [self.rule(depth + 1)]
        while (mark := self._next("',' or ')'")) == ",":
            rules.append(self.rule(depth + 1))
        if mark != ")":
            raise self._wrong(f"',' or ')' should stand where {mark!r} does")
        needed = {"AND": len(rules), "OR": 1, "OUTOF": count}[operator]
        if not 1 <= needed <= len(rules):
            raise self._wrong(f"OutOf({needed}, …) over {len(rules)} rules")
        return policies_pb2.SignaturePolicy(n_out_of=policies_pb2.SignaturePolicy.NOutOf(n=needed, rules=rules))

    def end(self) -> None:
        if self._at < len(self._tokens):
            raise self._wrong(f"{self._tokens[self._at]!r} stands after its end")

    def _principal(self, text: str) -> int:
        msp_id, separator, role = text.rpartition(".")
        if not separator or not msp_id or role.lower() not in ROLES:
            raise self._wrong(f"{text!r} is no principal: 'MSP.role' with role {', '.join(ROLES)}")
        principal = Principal(msp_id, role.lower())
        if principal not in self.principals:
            if len(self.principals) == MAX_PRINCIPALS:
                raise self._wrong(f"more than {MAX_PRINCIPALS} principals")
            self.principals.append(principal)
        return self.principals.index(principal)

    def _split(self) -> Iterator[str]:
        at = 0
        text = self.text.rstrip()
        while at < len(text):
            found = _TOKEN.match(text, at)
            if found is None:
                raise DescriptionError(f"endorsement policy {self.text[:200]!r}: cannot read {text[at : at + 20]!r}")
            yield found["word"] or found["principal"] or found["mark"]
            at = found.end()

    def _next(self, what: str) -> str:
        if self._at == len(self._tokens):
            raise self._wrong(f"it ends where {what} should stand")
        self._at += 1
        return self._tokens[self._at - 1]

    def _expect(self, mark: str) -> None:
        token = self._next(repr(mark))
        if token != mark:
            raise self._wrong(f"{mark!r} should stand where {token!r} does")

    def _wrong(self, why: str) -> DescriptionError:
        return DescriptionError(f"endorsement policy {self.text[:200]!r}: {why}")
