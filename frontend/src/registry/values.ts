/** From what is typed to what is signed, and back: units people read against the integers of the records. */
import type { Json, JsonObject } from "../shared/signing/canonical";
import { publicPart, readRegistration } from "./registration";

export type Kind = "text" | "note" | "choice" | "time" | "metres" | "share" | "seconds" | "integer" | "flag" | "actions" | "pad" | "degrees" | "registration";
/** What stands in a form's field. */
export type Typed = string | boolean | readonly string[];
/** A form's fields by path. */
export type Draft = Readonly<Record<string, Typed>>;

/** How many of the record's units one of the typed ones has. */
const SCALES: Partial<Record<Kind, number>> = { metres: 1_000, share: 10_000, seconds: 1_000, integer: 1, degrees: 1e7 };

/** The number in a text, with a decimal point or comma; undefined where it is none, or finer than the record can say. */
function scaled(text: string, scale: number): number | undefined {
  const plain = text.trim().replace(/[\s\u00a0]/g, "").replace(",", ".").replace("−", "-");
  if (!/^-?\d{1,15}(\.\d{1,12})?$/.test(plain)) return undefined;
  const value = Number(plain) * scale;
  const whole = Math.round(value);
  // 0.1 m is 100 mm, also where binary fractions say 100.00000000000001.
  return Math.abs(value - whole) > 1e-6 * Math.max(1, Math.abs(whole)) ? undefined : whole + 0;
}

const pad2 = (value: number): string => String(value).padStart(2, "0");

/** A moment as a field of type datetime-local has it: local time, to the minute. */
export function typedTime(t_ms: number): string {
  const at = new Date(t_ms);
  return `${at.getFullYear()}-${pad2(at.getMonth() + 1)}-${pad2(at.getDate())}T${pad2(at.getHours())}:${pad2(at.getMinutes())}`;
}

/** The record's value of what was typed; undefined where nothing was, "wrong" where it is no value of that kind. */
export function parsed(kind: Kind, typed: Typed | undefined): { value: Json } | "nothing" | "wrong" {
  if (typeof typed === "boolean") return { value: typed };
  if (Array.isArray(typed)) return typed.length === 0 ? "nothing" : { value: typed as readonly string[] };
  const text = typeof typed === "string" ? typed.trim() : "";
  if (text === "") return "nothing";
  if (kind === "time") {
    const t_ms = new Date(text).getTime();
    return Number.isNaN(t_ms) ? "wrong" : { value: t_ms };
  }
  if (kind === "registration") {
    const value = readRegistration(text);
    return value === undefined ? "wrong" : { value };
  }
  const scale = SCALES[kind];
  if (scale === undefined) return { value: text };
  const value = scaled(text, scale);
  return value === undefined ? "wrong" : { value };
}

/** What may be kept of what was typed: no secret of an operator's. */
export function keepable(kind: Kind, typed: Typed): Typed {
  return kind === "registration" && typeof typed === "string" ? publicPart(typed.trim()) : typed;
}

/** What a field shows for a record's value. */
export function typedOf(kind: Kind, value: unknown): Typed {
  if (typeof value === "boolean") return value;
  if (Array.isArray(value)) return value.map(String);
  if (typeof value === "number") {
    if (kind === "time") return typedTime(value);
    const scale = SCALES[kind] ?? 1;
    const decimals = Math.round(Math.log10(scale));
    return (value / scale).toFixed(decimals).replace(/\.?0+$/, decimals === 0 ? "$&" : "");
  }
  return typeof value === "string" ? value : "";
}

/** Puts a value at a path ("policy.buffer_mm") of an argument. */
export function put(argument: JsonObject, path: string, value: Json): JsonObject {
  const [name = "", ...rest] = path.split(".");
  if (rest.length === 0) return { ...argument, [name]: value };
  const inner = argument[name];
  const record = typeof inner === "object" && !Array.isArray(inner) ? (inner as JsonObject) : {};
  return { ...argument, [name]: put(record, rest.join("."), value) };
}

/** A field that differs between two records. */
export type Difference = { path: string; before: unknown; after: unknown };

function plain(value: unknown): value is Record<string, unknown> {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

/** What differs, field by field; lists are compared as wholes. */
export function differences(before: unknown, after: unknown, path = ""): Difference[] {
  if (plain(before) && plain(after)) {
    const names = [...new Set([...Object.keys(before), ...Object.keys(after)])];
    return names.flatMap((name) => differences(before[name], after[name], path === "" ? name : `${path}.${name}`));
  }
  return JSON.stringify(before) === JSON.stringify(after) ? [] : [{ path, before, after }];
}
