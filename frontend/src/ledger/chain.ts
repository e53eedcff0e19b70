/**
 * The hash chain, checked in the browser: nothing here trusts what the server says a hash is.
 *
 * A block's header hash is SHA-256 over the DER encoding of SEQUENCE { number INTEGER, previous_hash OCTET STRING,
 * data_hash OCTET STRING }; the next block names it. `data_hash` is SHA-256 over the block's transactions, one after
 * the other.
 */
import type { LedgerBlock } from "../shared/api/records";

export type Link = "holds" | "hash-differs" | "does-not-follow";

export function fromHex(text: string): Uint8Array<ArrayBuffer> {
  const pairs = text.match(/[0-9a-f]{2}/g) ?? [];
  return Uint8Array.from(pairs, (pair) => Number.parseInt(pair, 16));
}

export function toHex(bytes: ArrayBuffer | Uint8Array): string {
  return Array.from(new Uint8Array(bytes), (byte) => byte.toString(16).padStart(2, "0")).join("");
}

function tagged(tag: number, body: readonly number[]): number[] {
  if (body.length < 128) return [tag, body.length, ...body];
  const size: number[] = [];
  for (let rest = body.length; rest > 0; rest = Math.floor(rest / 256)) size.unshift(rest % 256);
  return [tag, 0x80 | size.length, ...size, ...body];
}

/** The DER bytes of a header; `number` is a safe integer. */
export function headerDer(block: Pick<LedgerBlock, "number" | "previous_hash" | "data_hash">): Uint8Array<ArrayBuffer> {
  const digits: number[] = [];
  for (let rest = block.number; rest > 0; rest = Math.floor(rest / 256)) digits.unshift(rest % 256);
  // A first bit of 1 would mean a negative number.
  if (digits.length === 0 || (digits[0] ?? 0) >= 128) digits.unshift(0);
  const body = [
    ...tagged(0x02, digits),
    ...tagged(0x04, [...fromHex(block.previous_hash)]),
    ...tagged(0x04, [...fromHex(block.data_hash)]),
  ];
  return Uint8Array.from(tagged(0x30, body));
}

export async function sha256(bytes: BufferSource): Promise<string> {
  return toHex(await crypto.subtle.digest("SHA-256", bytes));
}

/** Whether a block's hash is that of its header, and whether the block before it is the one that it names. */
export async function checkLink(block: LedgerBlock, before: LedgerBlock | undefined): Promise<Link> {
  if ((await sha256(headerDer(block))) !== block.header_hash) return "hash-differs";
  if (block.number === 0) return block.previous_hash === "" ? "holds" : "does-not-follow";
  if (before === undefined) return "holds";
  const follows = before.number === block.number - 1 && before.header_hash === block.previous_hash;
  return follows ? "holds" : "does-not-follow";
}

export type Progress = { checked: number; total: number; broken?: { number: number; link: Link } };

/**
 * Walks from the newest block to the first, a page at a time. Stops at the first link that does not hold.
 *
 * `pages` gives blocks newest first; `signal` ends the walk between pages.
 */
export async function checkChain(
  pages: (cursor: string | undefined) => Promise<{ items: LedgerBlock[]; next?: string }>,
  onProgress: (progress: Progress) => void,
  signal: AbortSignal,
): Promise<Progress> {
  let progress: Progress = { checked: 0, total: 0 };
  let after: LedgerBlock | undefined;
  let cursor: string | undefined;
  do {
    const page = await pages(cursor);
    const [newest] = page.items;
    if (progress.total === 0 && newest !== undefined) progress = { checked: 0, total: newest.number + 1 };
    for (const block of page.items) {
      const link = await checkLink(block, undefined);
      if (link !== "holds") return { ...progress, broken: { number: block.number, link } };
      if (after !== undefined && (after.previous_hash !== block.header_hash || after.number !== block.number + 1)) {
        return { ...progress, broken: { number: after.number, link: "does-not-follow" } };
      }
      after = block;
      progress = { ...progress, checked: progress.checked + 1 };
    }
    onProgress(progress);
    cursor = page.next;
  } while (cursor !== undefined && !signal.aborted);
  return progress;
}
