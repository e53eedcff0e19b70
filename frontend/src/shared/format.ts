/** Numbers, times, places and identifiers as this browser's user reads them (`i18n/locale`). */
import { reading, type Locale } from "./i18n/locale";
import { formatTexts as t } from "./texts";

const MINUS = "−";
/** Between a number and its unit, and between thousands: never broken. */
export const NBSP = "\u00a0";

function grouped(whole: number): string {
  return String(whole).replace(/\B(?=(\d{3})+(?!\d))/g, NBSP);
}

/** With so many decimals, and the language's decimal sign. */
export function decimal(value: number, decimals: number): string {
  const text = Math.abs(value).toFixed(decimals);
  const signed = value < 0 && Number(text) !== 0 ? MINUS + text : text;
  return reading().locale === "fi" ? signed.replace(".", ",") : signed;
}

/** 18204 → "18 204". */
export function count(value: number): string {
  return (value < 0 ? MINUS : "") + grouped(Math.abs(Math.round(value)));
}

const MM_PER_FOOT = 304.8;
const FEET_PER_MILE = 6076.12;

/**
 * A length: two decimals below 10 m, one below 100 m, none below 1 km. `coarse` leaves one decimal below 10 m. In feet
 * and nautical miles where the user reads those.
 */
export function length(mm: number, coarse = false): string {
  const [unit, unit_mm, far, per] =
    reading().lengths === "feet" ? (["ft", MM_PER_FOOT, "NM", FEET_PER_MILE] as const) : (["m", 1000, "km", 1000] as const);
  const sign = mm < 0 ? MINUS : "";
  const size = Math.abs(mm) / unit_mm;
  const decimals = size < 9.995 ? (coarse && size >= 0.95 ? 1 : 2) : size < 99.95 ? (coarse ? 0 : 1) : 0;
  if (size < per - 0.5) return `${sign}${trimmed(decimal(size, decimals), coarse)}${NBSP}${unit}`;
  const miles = size / per;
  return `${sign}${miles < 9.95 ? trimmed(decimal(miles, 1), coarse) : grouped(Math.round(miles))}${NBSP}${far}`;
}

const MM_S_PER_KNOT = 514.444;

/** A speed: "12.4 m/s"; in knots where the user reads feet and nautical miles. */
export function speed(mm_s: number): string {
  return reading().lengths === "feet" ? `${decimal(mm_s / MM_S_PER_KNOT, 1)}${NBSP}kt` : `${decimal(mm_s / 1000, 1)}${NBSP}m/s`;
}

/** "1.0" → "1" in words; figures in columns keep their decimals. */
function trimmed(text: string, coarse: boolean): string {
  return coarse ? text.replace(/[.,]0+$/, "") : text;
}

/** A place: "60.4514812, 22.2686812", or in degrees and minutes, or with seconds, as the user reads it. */
export function coordinates(lat_e7: number, lon_e7: number): string {
  if (reading().coordinates === "degrees") {
    const separator = reading().locale === "fi" ? "; " : ", ";
    return `${decimal(lat_e7 / 1e7, 7)}${separator}${decimal(lon_e7 / 1e7, 7)}`;
  }
  return `${sexagesimal(lat_e7, "N", "S")} ${sexagesimal(lon_e7, "E", "W")}`;
}

function sexagesimal(value_e7: number, positive: string, negative: string): string {
  const seconds = reading().coordinates === "seconds";
  // In the smallest unit that is shown, so that no 60.000 appears by rounding.
  const scale = seconds ? 3_600_00 : 60_0000;
  const whole = Math.round((Math.abs(value_e7) * scale) / 1e7);
  const degrees = Math.floor(whole / scale);
  const rest = whole % scale;
  const side = value_e7 < 0 ? negative : positive;
  if (!seconds) return `${degrees}°${NBSP}${decimal(rest / 10_000, 4).padStart(7, "0")}′${NBSP}${side}`;
  const minutes = String(Math.floor(rest / 6_000)).padStart(2, "0");
  return `${degrees}°${NBSP}${minutes}′${NBSP}${decimal((rest % 6_000) / 100, 2).padStart(5, "0")}″${NBSP}${side}`;
}

/** A likelihood, never rounded to a certainty that nobody has. */
export function likelihood(ppm: number): string {
  if (ppm < 100) return `<${NBSP}${decimal(0.0001, 4)}`;
  if (ppm > 999_900) return `>${NBSP}${decimal(0.9999, 4)}`;
  const decimals = ppm < 10_000 || ppm > 990_000 ? 4 : 2;
  const scale = 10 ** decimals;
  const value = Math.floor((ppm / 1_000_000) * scale + 1e-9) / scale;
  return decimal(value, decimals);
}

/** A size: "812 B", "14.2 kB", "3.1 MB". */
export function bytes(size: number): string {
  if (size < 1000) return `${count(size)}${NBSP}B`;
  if (size < 999_950) return `${decimal(size / 1000, size < 99_950 ? 1 : 0)}${NBSP}kB`;
  return `${decimal(size / 1_000_000, 1)}${NBSP}MB`;
}

/** A duration: "31 ms", "1.20 s", "2 min 5 s". */
export function duration(ms: number): string {
  if (ms < 0) return `${MINUS}${duration(-ms)}`;
  if (ms < 1000) return `${Math.round(ms)}${NBSP}ms`;
  if (ms < 9_995) return `${decimal(ms / 1000, 2)}${NBSP}s`;
  if (ms < 59_500) return `${(ms / 1000).toFixed(0)}${NBSP}s`;
  const s = Math.round(ms / 1000);
  const min = Math.floor(s / 60);
  if (min < 60) return s % 60 === 0 ? `${min}${NBSP}min` : `${min}${NBSP}min ${s % 60}${NBSP}s`;
  return `${Math.floor(min / 60)}${NBSP}h ${min % 60}${NBSP}min`;
}

/** What the server hid of a name (as dashes, which a register may hold): as dots, that no font joins into a line. */
export function dotted(text: string): string {
  return text.replaceAll("---", "•••");
}

/** How long ago, in the coarsest unit that says enough: "now", "8 s", "3 min", "2 h", "4 d". */
export function age(ms: number): string {
  const s = Math.floor(ms / 1000);
  if (s < 2) return t("now");
  if (s < 60) return `${s}${NBSP}s`;
  if (s < 3600) return `${Math.floor(s / 60)}${NBSP}min`;
  if (s < 86_400) return `${Math.floor(s / 3600)}${NBSP}h`;
  return t("days", { days: Math.floor(s / 86_400) });
}

/** The same in a sentence: "just now", "8 s ago". */
export function ago(ms: number): string {
  return ms < 2000 ? t("justNow") : t("ago", { age: age(ms) });
}

/** "9f3c…e1": enough of a hash to tell two apart at a glance. */
export function shortHash(hash: string): string {
  return hash.length <= 9 ? hash : `${hash.slice(0, 4)}…${hash.slice(-2)}`;
}

const DATE_LOCALE: Record<Locale, string> = { en: "en-GB", fi: "fi-FI" };
const formats = new Map<string, Intl.DateTimeFormat>();

function dateFormat(name: string, options: Intl.DateTimeFormatOptions): Intl.DateTimeFormat {
  const { locale } = reading();
  const key = `${locale}:${name}`;
  let found = formats.get(key);
  if (found === undefined) {
    found = new Intl.DateTimeFormat(DATE_LOCALE[locale], options);
    formats.set(key, found);
  }
  return found;
}

/** Local time of day, with seconds. */
export function timeOfDay(t_ms: number): string {
  return dateFormat("time", { hour: "2-digit", minute: "2-digit", second: "2-digit" }).format(t_ms);
}

/** Day and time of day where it is not today. */
export function dayAndTime(t_ms: number, now_ms: number): string {
  const same = new Date(t_ms).toDateString() === new Date(now_ms).toDateString();
  return same ? timeOfDay(t_ms) : `${day(t_ms)}, ${timeOfDay(t_ms)}`;
}

/** "21 Nov 2026". */
export function day(t_ms: number): string {
  return dateFormat("day", { day: "numeric", month: "short", year: "numeric" }).format(t_ms);
}

/** 4 → "Four" for the beginning of a sentence; figures above twelve. */
export function countWord(value: number): string {
  return t("word", { value: String(value), figures: count(value) });
}

type Action = "land" | "takeoff" | "dock";

/** "land", "take off", "dock". */
export function actionVerb(action: Action): string {
  return t("verb", { action });
}

/** "landing", "take-off", "docking". */
export function actionNoun(action: Action): string {
  return t("noun", { action });
}

/** What is part of a sentence, where it stands alone. */
export function sentenceCase(text: string): string {
  return text.charAt(0).toUpperCase() + text.slice(1);
}
