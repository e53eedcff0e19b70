/**
 * What one sees is what one signs: the bytes that the server gave to sign are taken apart, and must carry exactly the
 * function and argument that the form made, by this very certificate, for this channel and contract. Nothing else.
 */
import { concat, fromUtf8, hex, same, sha256, utf8 } from "./bytes";
import { one, ProtobufError, read, type Message } from "./protobuf";

/** The bytes are not what was asked for: nothing is signed. */
export class ForeignBytesError extends Error {
  override readonly name = "ForeignBytesError";
}

/** What the bytes must say. `argument` is canonical. */
export type Intent = {
  tx_id: string;
  channel: string;
  chaincode: string;
  msp_id: string;
  certificate: string;
  name: string;
  argument: Uint8Array;
};

/** What the peers have made of it. */
export type Outcome = { status: number; result: string; endorsers: string[] };

const bytes = (name: string): { name: string; kind: "bytes" } => ({ name, kind: "bytes" });
const number = (name: string): { name: string; kind: "number" } => ({ name, kind: "number" });
const many = (name: string): { name: string; kind: "bytes"; many: true } => ({ name, kind: "bytes", many: true });

// As in Fabric's protocol buffers: common.proto, proposal.proto, chaincode.proto, identities.proto, transaction.proto.
const PROPOSAL: Message = { 1: bytes("header"), 2: bytes("payload") };
const HEADER: Message = { 1: bytes("channel_header"), 2: bytes("signature_header") };
const CHANNEL_HEADER: Message = {
  1: number("type"),
  3: bytes("timestamp"),
  4: bytes("channel_id"),
  5: bytes("tx_id"),
  7: bytes("extension"),
  8: bytes("tls_cert_hash"),
};
const HEADER_EXTENSION: Message = { 2: bytes("chaincode_id") };
const SIGNATURE_HEADER: Message = { 1: bytes("creator"), 2: bytes("nonce") };
const IDENTITY: Message = { 1: bytes("mspid"), 2: bytes("id_bytes") };
const PROPOSAL_PAYLOAD: Message = { 1: bytes("input") };
const INVOCATION: Message = { 1: bytes("chaincode_spec") };
const CHAINCODE_SPEC: Message = { 1: number("type"), 2: bytes("chaincode_id"), 3: bytes("input") };
const CHAINCODE_ID: Message = { 2: bytes("name") };
const CHAINCODE_INPUT: Message = { 1: many("args") };
const PAYLOAD: Message = { 1: bytes("header"), 2: bytes("data") };
const TRANSACTION: Message = { 1: many("actions") };
const ACTION: Message = { 1: bytes("header"), 2: bytes("payload") };
const ACTION_PAYLOAD: Message = { 1: bytes("chaincode_proposal_payload"), 2: bytes("action") };
const ENDORSED: Message = { 1: bytes("proposal_response_payload"), 2: many("endorsements") };
const ENDORSEMENT: Message = { 1: bytes("endorser"), 2: bytes("signature") };
const RESPONSE_PAYLOAD: Message = { 1: bytes("proposal_hash"), 2: bytes("extension") };
const CHAINCODE_ACTION: Message = { 1: bytes("results"), 2: bytes("events"), 3: bytes("response"), 4: bytes("chaincode_id") };
const RESPONSE: Message = { 1: number("status"), 2: bytes("message"), 3: bytes("payload") };

const ENDORSER_TRANSACTION = 3;

function must(holds: boolean, what: string): void {
  if (!holds) throw new ForeignBytesError(what);
}

/** Runs a check; whatever cannot be read is foreign, too. */
async function checked<T>(work: () => Promise<T>): Promise<T> {
  try {
    return await work();
  } catch (problem) {
    if (problem instanceof ProtobufError || problem instanceof TypeError) throw new ForeignBytesError(problem.message);
    throw problem;
  }
}

/** Throws `ForeignBytesError` unless a proposal (the first thing that is signed) says what was meant, and no more. */
export function checkProposal(data: Uint8Array, intent: Intent): Promise<void> {
  return checked(async () => {
    const proposal = read("proposal", data, PROPOSAL);
    const header = read("header", one(proposal, "header"), HEADER);
    const channel = read("channel header", one(header, "channel_header"), CHANNEL_HEADER);
    must(channel.numbers.get("type") === ENDORSER_TRANSACTION, "it is no transaction");
    must(fromUtf8(one(channel, "channel_id")) === intent.channel, "it is for another channel");
    must(fromUtf8(one(channel, "tx_id")) === intent.tx_id, "it has another id");
    const extension = read("header extension", one(channel, "extension"), HEADER_EXTENSION);
    must(chaincodeOf(one(extension, "chaincode_id")) === intent.chaincode, "it is for another contract");
    const signed = read("signature header", one(header, "signature_header"), SIGNATURE_HEADER);
    const creator = read("creator", one(signed, "creator"), IDENTITY);
    must(fromUtf8(one(creator, "mspid")) === intent.msp_id, "it is by another organisation");
    must(same(one(creator, "id_bytes"), utf8(intent.certificate)), "it is by another certificate");
    const id = await sha256(concat(one(signed, "nonce"), one(signed, "creator")));
    must(hex(id) === intent.tx_id, "its id is not that of its sender");
    checkInput(one(read("payload", one(proposal, "payload"), PROPOSAL_PAYLOAD), "input"), intent);
  });
}

function checkInput(input: Uint8Array, intent: Intent): void {
  const spec = read("specification", one(read("invocation", input, INVOCATION), "chaincode_spec"), CHAINCODE_SPEC);
  must(chaincodeOf(one(spec, "chaincode_id")) === intent.chaincode, "it calls another contract");
  const args = read("arguments", one(spec, "input"), CHAINCODE_INPUT).bytes.get("args") ?? [];
  must(args.length === 2, `it has ${args.length} arguments`);
  must(fromUtf8(args[0] ?? new Uint8Array()) === intent.name, "it calls another function");
  must(same(args[1] ?? new Uint8Array(), intent.argument), "it carries another argument");
}

function chaincodeOf(data: Uint8Array): string {
  return fromUtf8(one(read("contract", data, CHAINCODE_ID), "name"));
}

/**
 * What the peers made of a signed proposal. Throws `ForeignBytesError` unless the transaction (the second thing that is
 * signed) is that proposal's own.
 */
export function checkTransaction(data: Uint8Array, proposal: Uint8Array, intent: Intent): Promise<Outcome> {
  return checked(async () => {
    const ours = read("proposal", proposal, PROPOSAL);
    const payload = read("payload", data, PAYLOAD);
    const header = read("header", one(payload, "header"), HEADER);
    const before = read("header", one(ours, "header"), HEADER);
    for (const part of ["channel_header", "signature_header"]) must(same(one(header, part), one(before, part)), "its header is another one");
    const actions = read("transaction", one(payload, "data"), TRANSACTION).bytes.get("actions") ?? [];
    must(actions.length === 1, `it has ${actions.length} actions`);
    const action = read("action", actions[0] ?? new Uint8Array(), ACTION);
    must(same(one(action, "header"), one(header, "signature_header")), "its action is by somebody else");
    const inside = read("action", one(action, "payload"), ACTION_PAYLOAD);
    checkInput(one(read("payload", one(inside, "chaincode_proposal_payload"), PROPOSAL_PAYLOAD), "input"), intent);
    const endorsed = read("endorsements", one(inside, "action"), ENDORSED);
    const response = read("response", one(endorsed, "proposal_response_payload"), RESPONSE_PAYLOAD);
    must(same(one(response, "proposal_hash"), await proposalHash(header, inside)), "the peers answered another proposal");
    const result = read("response", one(read("result", one(response, "extension"), CHAINCODE_ACTION), "response"), RESPONSE);
    const endorsers = (endorsed.bytes.get("endorsements") ?? []).map((each) => {
      const endorser = read("endorser", one(read("endorsement", each, ENDORSEMENT), "endorser"), IDENTITY);
      return fromUtf8(one(endorser, "mspid"));
    });
    const status = result.numbers.get("status") ?? 0;
    must(status === 200, `the contract answered ${status}`);
    return { status, result: fromUtf8(one(result, "payload")), endorsers };
  });
}

/** SHA-256 over channel header, signature header and proposal payload, as peers compute it. */
async function proposalHash(header: ReturnType<typeof read>, action: ReturnType<typeof read>): Promise<Uint8Array> {
  return sha256(concat(one(header, "channel_header"), one(header, "signature_header"), one(action, "chaincode_proposal_payload")));
}
