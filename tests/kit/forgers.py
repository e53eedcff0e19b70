"""What forgers of a ledger's blocks do to a transaction, and whose keys they may have."""

from __future__ import annotations

from fabric_protos.common import common_pb2
from fabric_protos.gateway import gateway_pb2
from fabric_protos.peer import transaction_pb2

from wonderland.proofs import encoding
from wonderland_fabric_gateway.identity import Identity, SigningIdentity
from wonderland_fabric_gateway.signing import key_file_signer


def opened(envelope):
    payload = common_pb2.Payload.FromString(envelope.payload)
    transaction = transaction_pb2.Transaction.FromString(payload.data)
    action = transaction_pb2.ChaincodeActionPayload.FromString(transaction.actions[0].payload)
    return payload, transaction, action


def closed(envelope, payload, transaction, action):
    transaction.actions[0].payload = action.SerializeToString()
    payload.data = transaction.SerializeToString()
    envelope.payload = payload.SerializeToString()


def without_endorsements(envelope):
    payload, transaction, action = opened(envelope)
    del action.action.endorsements[1:]
    closed(envelope, payload, transaction, action)


def one_endorsement_more(envelope):
    """By a peer that never signed it: of no use to anybody, and no reason to doubt the others."""
    payload, transaction, action = opened(envelope)
    more = action.action.endorsements.add()
    more.CopyFrom(action.action.endorsements[0])
    more.signature = action.action.endorsements[-2].signature[:-1] + b"\x01"
    closed(envelope, payload, transaction, action)


def other_outcome(envelope):
    """The verdict's bytes exchanged in answer, event and write alike."""
    payload, transaction, action = opened(envelope)
    response = action.action.proposal_response_payload
    assert b'"verified"' in response
    action.action.proposal_response_payload = response.replace(b'"verified"', b'"rerified"')
    closed(envelope, payload, transaction, action)


def signing(msp_id, certificate, key):
    return SigningIdentity(Identity.from_file(msp_id, certificate), key_file_signer(key))


def endorsed_by_nobody(envelope):
    """One endorsement more, by no identity at all."""
    payload, transaction, action = opened(envelope)
    action.action.endorsements.add(endorser=b"\xff\x00nobody", signature=b"\x30\x00")
    closed(envelope, payload, transaction, action)


async def submitted_changed(person, changes, function, argument):
    """What its sender did to a transaction after it was endorsed, signed by him: its status, the contract's answer."""
    endorsed = await person.endorsed(function, argument)
    prepared = gateway_pb2.PreparedTransaction.FromString(endorsed.to_bytes())
    for change in changes:
        change(prepared.envelope)
    prepared.envelope.signature = b""
    commit = await person.gateway.new_transaction(prepared.SerializeToString()).submit()
    status = await commit.status()
    await person.people.everywhere(status.block_number)
    return status, encoding.decode(endorsed.payload)
