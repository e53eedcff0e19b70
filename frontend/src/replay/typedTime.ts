/** Times as people type them: "yesterday 14:00", "13.05.20", "−10 min", "20.11.2026 9.00", "2026-11-20T09:00Z". */

const DAY_MS = 86_400_000;
const UNITS: Readonly<Record<string, number>> = { s: 1_000, sek: 1_000, min: 60_000, m: 60_000, h: 3_600_000, t: 3_600_000, d: DAY_MS, pv: DAY_MS };
const DAYS_BACK: Readonly<Record<string, number>> = {
  today: 0,
  tänään: 0,
  yesterday: 1,
  eilen: 1,
  toissapäivänä: 2,
};

/** The time of day at the end of a text, and what stands before it. */
function timeOfDay(text: string): { before: string; ms: number } | undefined {
  const match = /^(.*?)(?:^|\s)(?:klo\s+|at\s+)?(\d{1,2})[:.](\d{2})(?:[:.](\d{2}))?$/.exec(text);
  if (match === null) return undefined;
  const [, before = "", hours = "", minutes = "", seconds = "0"] = match;
  if (Number(hours) > 23 || Number(minutes) > 59 || Number(seconds) > 59) return undefined;
  return { before: before.trim(), ms: ((Number(hours) * 60 + Number(minutes)) * 60 + Number(seconds)) * 1_000 };
}

/** A day's midnight here; undefined where there is no such day. */
function midnight(year: number, month: number, day: number): Date | undefined {
  const date = new Date(year, month - 1, day);
  return date.getMonth() === month - 1 && date.getDate() === day ? date : undefined;
}

function dayOf(text: string, now: Date): Date | undefined {
  const back = DAYS_BACK[text];
  if (back !== undefined) return midnight(now.getFullYear(), now.getMonth() + 1, now.getDate() - back) ?? new Date(now.getFullYear(), now.getMonth(), now.getDate() - back);
  const iso = /^(\d{4})-(\d{1,2})-(\d{1,2})$/.exec(text);
  if (iso !== null) return midnight(Number(iso[1]), Number(iso[2]), Number(iso[3]));
  const dotted = /^(\d{1,2})[./](\d{1,2})(?:[./](\d{4}))?\.?$/.exec(text);
  if (dotted !== null) return midnight(dotted[3] === undefined ? now.getFullYear() : Number(dotted[3]), Number(dotted[2]), Number(dotted[1]));
  return undefined;
}

/** The typed time in ms since the Unix epoch; undefined where it cannot be read. `now_ms` is what "today" is. */
export function typedTime(text: string, now_ms: number): number | undefined {
  const typed = text.trim().toLowerCase().replace(/\s+/g, " ").replace(/^[−–]/, "-");
  const relative = /^-?\s?(\d{1,5}(?:[.,]\d+)?)\s?([a-zä]+)(?: ago| sitten)?$/.exec(typed);
  const unit = relative === null ? undefined : UNITS[relative[2] ?? ""];
  if (relative !== null && unit !== undefined) return now_ms - Number((relative[1] ?? "").replace(",", ".")) * unit;
  if (/^\d{4}-\d{2}-\d{2}t\d{2}:\d{2}(:\d{2}(\.\d+)?)?(z|[+-]\d{2}:\d{2})?$/.test(typed)) {
    const instant = Date.parse(typed.toUpperCase());
    return Number.isNaN(instant) ? undefined : instant;
  }
  const now = new Date(now_ms);
  const clock = timeOfDay(typed);
  const date = dayOf(clock === undefined ? typed : clock.before, now);
  if (clock === undefined) return date?.getTime();
  if (date !== undefined) return atTime(date, clock.ms);
  if (clock.before !== "") return undefined;
  const today = atTime(new Date(now.getFullYear(), now.getMonth(), now.getDate()), clock.ms);
  // A time of day that has not come yet is yesterday's.
  return today <= now_ms ? today : atTime(new Date(now.getFullYear(), now.getMonth(), now.getDate() - 1), clock.ms);
}

/** By the clock on the wall, also on days on which it is set. */
function atTime(day: Date, ms: number): number {
  const seconds = ms / 1_000;
  return new Date(day.getFullYear(), day.getMonth(), day.getDate(), Math.floor(seconds / 3_600), Math.floor(seconds / 60) % 60, seconds % 60).getTime();
}
