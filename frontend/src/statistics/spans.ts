import { reading } from "../shared/i18n/locale";

export const SPANS = ["hour", "day", "week", "month"] as const;
export type SpanName = (typeof SPANS)[number];
export type Span = { since_ms: number; until_ms: number; bin_ms: number };

const MINUTE_MS = 60_000;
const HOUR_MS = 60 * MINUTE_MS;
const DAY_MS = 24 * HOUR_MS;
const WIDTHS: Record<SpanName, { length_ms: number; bin_ms: number }> = {
  hour: { length_ms: HOUR_MS, bin_ms: MINUTE_MS },
  day: { length_ms: DAY_MS, bin_ms: HOUR_MS / 2 },
  week: { length_ms: 7 * DAY_MS, bin_ms: 4 * HOUR_MS },
  month: { length_ms: 30 * DAY_MS, bin_ms: DAY_MS },
};

/** The span that ends with the present bin. */
export function recent(name: SpanName, now_ms: number): Span {
  const { length_ms, bin_ms } = WIDTHS[name];
  const until_ms = Math.floor(now_ms / bin_ms) * bin_ms + bin_ms;
  return { since_ms: until_ms - length_ms, until_ms, bin_ms };
}

/** One day of this browser's time zone, from a date input's "2026-11-21"; undefined for what is none. */
export function dayOf(text: string): Span | undefined {
  const match = /^(\d{4})-(\d{2})-(\d{2})$/.exec(text);
  if (match === null) return undefined;
  const [year, month, day] = [Number(match[1]), Number(match[2]), Number(match[3])];
  const start = new Date(year, month - 1, day);
  if (start.getMonth() !== month - 1 || start.getDate() !== day || start.getTime() < 0) return undefined;
  // The day on which clocks change has 23 or 25 hours.
  const until_ms = new Date(year, month - 1, day + 1).getTime();
  return { since_ms: start.getTime(), until_ms, bin_ms: HOUR_MS / 2 };
}

export function dateInput(t_ms: number): string {
  const date = new Date(t_ms);
  const two = (value: number): string => String(value).padStart(2, "0");
  return `${date.getFullYear()}-${two(date.getMonth() + 1)}-${two(date.getDate())}`;
}

/** What stands under a bin: the time of day, or the day where bins are longer. */
export function binLabel(start_ms: number, bin_ms: number): string {
  const locale = { en: "en-GB", fi: "fi-FI" }[reading().locale];
  return bin_ms < DAY_MS / 2
    ? new Date(start_ms).toLocaleTimeString(locale, { hour: "2-digit", minute: "2-digit" })
    : new Date(start_ms).toLocaleDateString(locale, { day: "numeric", month: "numeric" });
}
