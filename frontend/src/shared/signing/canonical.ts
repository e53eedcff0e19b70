/**
 * Canonical JSON as the ledger's records have it (docs/decisions and libraries/core/wonderland/proofs/encoding.py): RFC 8785 restricted
 * to objects, arrays, strings, booleans and integers. The same value gives the same bytes here, there and on the ledger.
 */
import { utf8, type Bytes } from "./bytes";

export type Json = string | number | boolean | readonly Json[] | JsonObject;
/** By name. */
// A Record could not name itself here.
export type JsonObject = { readonly [name: string]: Json };

/** What is no such value; says where. */
export class CanonicalError extends Error {
  override readonly name = "CanonicalError";
}

function text(value: Json, path: string): string {
  if (typeof value === "string") {
    if (/\p{Surrogate}/u.test(value)) throw new CanonicalError(`${path}: an unpaired surrogate`);
    return JSON.stringify(value);
  }
  if (typeof value === "boolean") return value ? "true" : "false";
  if (typeof value === "number") {
    if (!Number.isSafeInteger(value) || Object.is(value, -0)) throw new CanonicalError(`${path}: no integer within ±(2^53 - 1)`);
    return String(value);
  }
  if (Array.isArray(value)) return `[${value.map((each: Json, i) => text(each, `${path}[${i}]`)).join(",")}]`;
  if (typeof value === "object" && (value as unknown) !== null) {
    // JavaScript orders texts by UTF-16 code units, as RFC 8785 asks.
    const entries = Object.entries(value).sort(([a], [b]) => (a < b ? -1 : 1));
    return `{${entries.map(([name, each]: [string, Json]) => `${text(name, path)}:${text(each, `${path}.${name}`)}`).join(",")}}`;
  }
  throw new CanonicalError(`${path}: no text, integer, list or object`);
}

/** The canonical text of a value. Throws `CanonicalError`. */
export function canonicalText(value: Json): string {
  return text(value, "$");
}

/** Its bytes (UTF-8): what is hashed and signed. Throws `CanonicalError`. */
export function canonical(value: Json): Bytes {
  return utf8(canonicalText(value));
}
