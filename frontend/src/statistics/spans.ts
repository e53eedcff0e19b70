import { reading } from "../shared/i18n/locale";

export const SPANS = ["hour", "day", "week", "month"] as const;
export type SpanName = (typeof SPANS)[number];
export type Span = { since_ms: number; until_ms: number; bin_ms: number };

const MINUTE_MS = 60_000;
const HOUR_MS = 60 * MINUTE_MS;
const DAY_MS = 24 * HOUR_MS;
/** Bins of a single day. */
export const DAY_BIN_MS = HOUR_MS / 2;
const WIDTHS: Record<SpanName, { length_ms: number; bin_ms: number }> = {
  hour: { length_ms: HOUR_MS, bin_ms: MINUTE_MS },
  day: { length_ms: DAY_MS, bin_ms: DAY_BIN_MS },
  week: { length_ms: 7 * DAY_MS, bin_ms: 4 * HOUR_MS },
  month: { length_ms: 30 * DAY_MS, bin_ms: DAY_MS },
};

/** The span that ends with the present bin. */
export function recent(name: SpanName, now_ms: number): Span {
  const { length_ms, bin_ms } = WIDTHS[name];
  const until_ms = Math.floor(now_ms / bin_ms) * bin_ms + bin_ms;
  return { since_ms: until_ms - length_ms, until_ms, bin_ms };
}

/** What stands under a bin: the time of day, or the day where bins are longer. */
export function binLabel(start_ms: number, bin_ms: number): string {
  const locale = { en: "en-GB", fi: "fi-FI" }[reading().locale];
  return bin_ms < DAY_MS / 2
    ? new Date(start_ms).toLocaleTimeString(locale, { hour: "2-digit", minute: "2-digit" })
    : new Date(start_ms).toLocaleDateString(locale, { day: "numeric", month: "numeric" });
}
