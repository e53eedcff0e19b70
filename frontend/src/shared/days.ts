/** Days of this browser's time zone, as date inputs name them. */
export type Day = { since_ms: number; until_ms: number };

/** One day, from a date input's "2026-11-21"; undefined for what is none. */
export function dayOf(text: string): Day | undefined {
  const match = /^(\d{4})-(\d{2})-(\d{2})$/.exec(text);
  if (match === null) return undefined;
  const [year, month, day] = [Number(match[1]), Number(match[2]), Number(match[3])];
  const start = new Date(year, month - 1, day);
  if (start.getMonth() !== month - 1 || start.getDate() !== day || start.getTime() < 0) return undefined;
  // The day on which clocks change has 23 or 25 hours.
  return { since_ms: start.getTime(), until_ms: new Date(year, month - 1, day + 1).getTime() };
}

export function dateInput(t_ms: number): string {
  const date = new Date(t_ms);
  const two = (value: number): string => String(value).padStart(2, "0");
  return `${date.getFullYear()}-${two(date.getMonth() + 1)}-${two(date.getDate())}`;
}

/** Filters of a list from the first of two days to the end of the other, as the API names them. */
export function between(first: string | undefined, last: string | undefined): { since_ms?: number; until_ms?: number } {
  const since = dayOf(first ?? "");
  const until = dayOf(last ?? "");
  return { ...(since && { since_ms: since.since_ms }), ...(until && { until_ms: until.until_ms - 1 }) };
}
