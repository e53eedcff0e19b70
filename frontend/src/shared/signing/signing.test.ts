import { describe, expect, it } from "vitest";
import { base64url, fromBase64, fromBase64url, hex, utf8 } from "./bytes";
import { canonical, CanonicalError, canonicalText, type Json } from "./canonical";
import { derSignature, fromPem, pem, pkcs8OfSec1 } from "./der";
import { checkProposal, checkTransaction, ForeignBytesError, type Intent } from "./inspect";
import { read } from "./protobuf";
import vectors from "./vectors.json";

const bytes = (text: string): Uint8Array => Uint8Array.from(text.match(/../g) ?? [], (pair) => parseInt(pair, 16));

describe("signatures", () => {
  it.each(vectors.signatures)("raw $raw", ({ raw, der }) => expect(hex(derSignature(bytes(raw)))).toBe(der));

  it("refuses what is none", () => {
    for (const raw of ["", "00".repeat(64), "ff".repeat(64), "01".repeat(63)]) expect(() => derSignature(bytes(raw))).toThrow(RangeError);
  });
});

describe("canonical JSON", () => {
  it.each(vectors.canonical)("$text", ({ value, text }) => expect(canonicalText(value as Json)).toBe(text));

  it("refuses what the records do not have", () => {
    for (const value of [0.5, -0, 2 ** 53, Number.NaN, null, undefined, { a: [null] }, "\ud800"])
      expect(() => canonicalText(value as unknown as Json)).toThrow(CanonicalError);
  });
});

describe("keys", () => {
  it("makes PKCS#8 of the older form", async () => {
    const sec1 = fromPem("EC PRIVATE KEY", vectors.keys.sec1);
    const algorithm = { name: "ECDSA", namedCurve: "P-256" };
    const older = await crypto.subtle.importKey("pkcs8", pkcs8OfSec1(sec1 ?? new Uint8Array()), algorithm, true, ["sign"]);
    const newer = await crypto.subtle.importKey("pkcs8", fromPem("PRIVATE KEY", vectors.keys.pkcs8) ?? utf8(""), algorithm, true, ["sign"]);
    expect((await crypto.subtle.exportKey("jwk", older)).d).toBe((await crypto.subtle.exportKey("jwk", newer)).d);
  });

  it("reads and writes PEM", () => {
    const data = Uint8Array.from({ length: 200 }, (_, i) => i);
    expect(fromPem("X", `junk\n${pem("X", data)}junk`)).toEqual(data);
    for (const text of ["", "-----BEGIN X-----\n!!\n-----END X-----", pem("Y", data)]) expect(fromPem("X", text)).toBeUndefined();
  });

  it("reads and writes base64url", () => {
    const data = Uint8Array.from({ length: 255 }, (_, i) => 255 - i);
    expect(fromBase64url(base64url(data))).toEqual(data);
    expect(base64url(data)).toMatch(/^[\w-]+$/);
  });
});

const { transaction } = vectors;
const intent: Intent = { ...transaction.intent, argument: canonical(transaction.argument) };
const proposal = fromBase64(transaction.proposal);
const prepared = fromBase64(transaction.prepared);

describe("what is signed first", () => {
  it("is what was meant", async () => {
    await expect(checkProposal(proposal, intent)).resolves.toBeUndefined();
  });

  it.each([
    ["another function", { name: "RetirePad" }],
    ["another argument", { argument: canonical({ ...transaction.argument, status: "active" }) }],
    ["another order of the argument", { argument: utf8(JSON.stringify(transaction.argument)) }],
    ["another channel", { channel: "other" }],
    ["another contract", { chaincode: "other" }],
    ["another organisation", { msp_id: "PadMSP" }],
    ["another certificate", { certificate: transaction.intent.certificate.replace("A", "B") }],
    ["another id", { tx_id: transaction.other_tx_id }],
  ])("is not %s", async (_, change) => {
    await expect(checkProposal(proposal, { ...intent, ...change })).rejects.toThrow(ForeignBytesError);
  });

  it("has nothing beside it", async () => {
    const more = (field: number): Uint8Array => Uint8Array.of(...proposal, (field << 3) | 2, 1, 65);
    for (const field of [1, 2, 3, 9]) await expect(checkProposal(more(field), intent)).rejects.toThrow(ForeignBytesError);
  });

  it("is refused wherever a byte is another one", async () => {
    // The time and the nonce may be anything; the nonce shows in the id.
    let accepted = 0;
    for (let at = 0; at < proposal.length; at++) {
      const changed = Uint8Array.from(proposal);
      changed[at] = (changed[at] ?? 0) ^ 1;
      await checkProposal(changed, intent).then(
        () => accepted++,
        (problem: unknown) => expect(problem).toBeInstanceOf(ForeignBytesError),
      );
    }
    expect(accepted).toBeLessThan(24);
  });

  it("is refused wherever it is cut off", async () => {
    for (let length = 0; length < proposal.length; length += 7)
      await expect(checkProposal(proposal.slice(0, length), intent)).rejects.toThrow(ForeignBytesError);
  });
});

describe("what is signed second", () => {
  it("is the proposal's own", async () => {
    const outcome = await checkTransaction(prepared, proposal, intent);
    expect(outcome.endorsers).toEqual(transaction.endorsers);
    expect(JSON.parse(outcome.result)).toMatchObject({ status: "suspended", status_reason: transaction.argument.reason });
  });

  it("is not another proposal's", async () => {
    const other = fromBase64(transaction.other_proposal);
    await expect(checkTransaction(prepared, other, { ...intent, tx_id: transaction.other_tx_id })).rejects.toThrow(ForeignBytesError);
    await expect(checkTransaction(prepared, proposal, { ...intent, argument: canonical({ a: 1 }) })).rejects.toThrow(ForeignBytesError);
  });

  it("is not what is no transaction at all", async () => {
    for (const data of [new Uint8Array(), proposal, prepared.slice(0, 100)])
      await expect(checkTransaction(data, proposal, intent)).rejects.toThrow(ForeignBytesError);
  });
});

describe("the reader", () => {
  const fields = { 1: { name: "a", kind: "number" }, 2: { name: "b", kind: "bytes" } } as const;

  it.each(["08", "0801 0802", "0a0141", "1205", "18 01", "08ffffffffffffffff7f", "1001"])("refuses %s", (text) =>
    expect(() => read("x", bytes(text.replace(" ", "")), fields)).toThrow(),
  );
});
