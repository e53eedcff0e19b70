import { describe, expect, it } from "vitest";
import type { LedgerBlock } from "../shared/api/records";
import { checkChain, checkLink, fromHex, headerDer, sha256, toHex, type Progress } from "./chain";

const digest = (text: string): Promise<string> => sha256(new TextEncoder().encode(text));

async function chain(length: number): Promise<LedgerBlock[]> {
  const blocks: LedgerBlock[] = [];
  for (let number = 0; number < length; number += 1) {
    const previous_hash = blocks.at(-1)?.header_hash ?? "";
    const header = { number, previous_hash, data_hash: await digest(`data ${number}`) };
    const header_hash = await sha256(headerDer(header));
    blocks.push({ ...header, header_hash, t_ms: 0, transactions: 1, valid: 1, size_bytes: 9 });
  }
  return blocks;
}

function pages(blocks: readonly LedgerBlock[], size = 3) {
  const newest = [...blocks].reverse();
  return (cursor: string | undefined) => {
    const start = Number(cursor ?? 0);
    const next = start + size < newest.length ? { next: String(start + size) } : {};
    return Promise.resolve({ items: newest.slice(start, start + size), ...next });
  };
}

const nothing = (): void => undefined;
const { signal } = new AbortController();

describe("the hash chain", () => {
  it("encodes headers as DER: numbers as short as they can be, and never negative", () => {
    const der = (number: number): string => toHex(headerDer({ number, previous_hash: "", data_hash: "" }));
    expect(der(0)).toBe("3007" + "020100" + "0400" + "0400");
    expect(der(127)).toBe("3007" + "02017f" + "0400" + "0400");
    expect(der(128)).toBe("3008" + "02020080" + "0400" + "0400");
    expect(der(65_536)).toBe("3009" + "0203010000" + "0400" + "0400");
    const long = headerDer({ number: 1, previous_hash: "ab".repeat(100), data_hash: "cd".repeat(32) });
    expect([...long.slice(0, 3)]).toEqual([0x30, 0x81, 3 + 102 + 34]);
  });

  it("hashes headers as the ledger does", async () => {
    expect(await digest("abc")).toBe("ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    const bytes = (from: number): string => toHex(Uint8Array.from({ length: 32 }, (_, i) => from + i));
    // From wonderland.ledger.blocks.BlockHeader, which real Fabric blocks hold to.
    const first = await sha256(headerDer({ number: 0, previous_hash: "", data_hash: bytes(0) }));
    expect(first).toBe("afa2567803f7f3a839cf9d720474897a79c83a1da631906695fc89b4cd223517");
    expect(await sha256(headerDer({ number: 200, previous_hash: first, data_hash: bytes(32) }))).toBe("72a1099a9449f25b09e002e57cf40303c0155fd3985635048c4384d623ddb5e5");
    expect(toHex(fromHex("00ff10"))).toBe("00ff10");
  });

  it("holds from the newest block to the first", async () => {
    const seen: Progress[] = [];
    const result = await checkChain(pages(await chain(8)), (progress) => seen.push(progress), signal);
    expect(result).toEqual({ checked: 8, total: 8 });
    expect(seen.map(({ checked }) => checked)).toEqual([3, 6, 8]);
  });

  it.each(["data_hash", "header_hash"] as const)("names the block whose %s was changed", async (field) => {
    const other = await digest("other");
    const blocks = (await chain(8)).map((block) => (block.number === 4 ? { ...block, [field]: other } : block));
    expect((await checkChain(pages(blocks), nothing, signal)).broken).toEqual({ number: 4, link: "hash-differs" });
  });

  it("names the block that follows none", async () => {
    const other = await chain(8);
    const swapped = other[3];
    if (swapped === undefined) expect.fail();
    swapped.data_hash = await digest("another history");
    swapped.header_hash = await sha256(headerDer(swapped));
    expect((await checkChain(pages(other), nothing, signal)).broken).toEqual({ number: 4, link: "does-not-follow" });
    const missing = (await chain(8)).filter(({ number }) => number !== 3);
    expect((await checkChain(pages(missing), nothing, signal)).broken).toEqual({ number: 4, link: "does-not-follow" });
  });

  it("knows one link by itself", async () => {
    const [first, second, third] = await chain(3);
    if (first === undefined || second === undefined || third === undefined) expect.fail();
    expect(await checkLink(second, first)).toBe("holds");
    expect(await checkLink(third, first)).toBe("does-not-follow");
    expect(await checkLink({ ...first, previous_hash: "00" }, undefined)).toBe("hash-differs");
  });
});
