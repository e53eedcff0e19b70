/** Facts as messages show them: what has a unit (it ends its name) as the user reads it, all else as it is. */
import { NBSP, dayAndTime, decimal, length } from "../format";
import type { Values } from "./texts";

export type Facts = Readonly<Record<string, string | number>>;

const TIMES: ReadonlySet<string> = new Set(["since_ms", "until_ms"]);

function shown(name: string, value: number, coarse: boolean): string | number {
  if (TIMES.has(name)) return dayAndTime(value, Date.now());
  if (name.endsWith("_mm")) return length(value, coarse);
  if (name.endsWith("_ms")) return `${decimal(value / 1000, 1)}${NBSP}s`;
  if (name.endsWith("_percent")) return `${decimal(value, 0)}${NBSP}%`;
  if (name.endsWith("_milli")) return decimal(value / 1000, 1);
  return value;
}

/** `coarse`: lengths as one says them. A fact that `message` names and there is none of is a question mark, or 0 where it counts. */
export function shownFacts(message: string, facts: Facts, coarse = false): Values {
  const named = [...message.matchAll(/\{(\w+)(, (?:number|plural))?[,}]/g)].map(([, name = "", counted]) => [name, counted === undefined ? "?" : 0] as const);
  const known = Object.entries(facts).map(([name, value]) => [name, typeof value === "number" ? shown(name, value, coarse) : value] as const);
  return Object.fromEntries([...named, ...known]);
}
