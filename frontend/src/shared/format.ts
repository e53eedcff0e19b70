/** Numbers, times and identifiers as people read them. Pure; English; the decimal sign is a point everywhere. */

const MINUS = "−";
/** Between a number and its unit, and between thousands: never broken. */
const NBSP = "\u00a0";

function grouped(whole: number): string {
  return String(whole).replace(/\B(?=(\d{3})+(?!\d))/g, NBSP);
}

/** 18204 → "18 204". */
export function count(value: number): string {
  return (value < 0 ? MINUS : "") + grouped(Math.abs(Math.round(value)));
}

/** A length: two decimals below 10 m, one below 100 m, none below 1 km. `coarse` leaves one decimal below 10 m. */
export function length(mm: number, coarse = false): string {
  const sign = mm < 0 ? MINUS : "";
  const m = Math.abs(mm) / 1000;
  const decimals = m < 9.995 ? (coarse && m >= 0.95 ? 1 : 2) : m < 99.95 ? (coarse ? 0 : 1) : 0;
  if (m < 999.5) return `${sign}${trimmed(m.toFixed(decimals), coarse)}${NBSP}m`;
  const km = m / 1000;
  return `${sign}${km < 9.95 ? trimmed(km.toFixed(1), coarse) : grouped(Math.round(km))}${NBSP}km`;
}

/** "1.0" → "1" in words; figures in columns keep their decimals. */
function trimmed(text: string, coarse: boolean): string {
  return coarse ? text.replace(/\.0+$/, "") : text;
}

/** A likelihood, never rounded to a certainty that nobody has. */
export function likelihood(ppm: number): string {
  if (ppm < 100) return `<${NBSP}0.0001`;
  if (ppm > 999_900) return `>${NBSP}0.9999`;
  const decimals = ppm < 10_000 || ppm > 990_000 ? 4 : 2;
  const scale = 10 ** decimals;
  const value = Math.floor((ppm / 1_000_000) * scale + 1e-9) / scale;
  return value.toFixed(decimals);
}

/** A duration: "31 ms", "1.20 s", "2 min 5 s". */
export function duration(ms: number): string {
  if (ms < 0) return `${MINUS}${duration(-ms)}`;
  if (ms < 1000) return `${Math.round(ms)}${NBSP}ms`;
  if (ms < 9_995) return `${(ms / 1000).toFixed(2)}${NBSP}s`;
  if (ms < 59_500) return `${(ms / 1000).toFixed(0)}${NBSP}s`;
  const s = Math.round(ms / 1000);
  const min = Math.floor(s / 60);
  if (min < 60) return s % 60 === 0 ? `${min}${NBSP}min` : `${min}${NBSP}min ${s % 60}${NBSP}s`;
  return `${Math.floor(min / 60)}${NBSP}h ${min % 60}${NBSP}min`;
}

/** How long ago, in the coarsest unit that says enough: "now", "8 s", "3 min", "2 h", "4 d". */
export function age(ms: number): string {
  const s = Math.floor(ms / 1000);
  if (s < 2) return "now";
  if (s < 60) return `${s}${NBSP}s`;
  if (s < 3600) return `${Math.floor(s / 60)}${NBSP}min`;
  if (s < 86_400) return `${Math.floor(s / 3600)}${NBSP}h`;
  return `${Math.floor(s / 86_400)}${NBSP}d`;
}

/** "9f3c…e1": enough of a hash to tell two apart at a glance. */
export function shortHash(hash: string): string {
  return hash.length <= 9 ? hash : `${hash.slice(0, 4)}…${hash.slice(-2)}`;
}

const TIME = new Intl.DateTimeFormat("en-GB", { hour: "2-digit", minute: "2-digit", second: "2-digit" });
const DAY = new Intl.DateTimeFormat("en-GB", { day: "numeric", month: "short", year: "numeric" });

/** Local time of day, with seconds. */
export function timeOfDay(t_ms: number): string {
  return TIME.format(t_ms);
}

/** Day and time of day where it is not today. */
export function dayAndTime(t_ms: number, now_ms: number): string {
  const same = new Date(t_ms).toDateString() === new Date(now_ms).toDateString();
  return same ? timeOfDay(t_ms) : `${DAY.format(t_ms)}, ${timeOfDay(t_ms)}`;
}

/** 4 → "Four" for the beginning of a sentence; figures above twelve. */
export function countWord(value: number): string {
  const words = ["No", "One", "Two", "Three", "Four", "Five", "Six", "Seven", "Eight", "Nine", "Ten", "Eleven", "Twelve"];
  return words[value] ?? count(value);
}

const ACTION_WORDS = { land: "land", takeoff: "take off", dock: "dock" } as const;
const ACTION_NOUNS = { land: "landing", takeoff: "take-off", dock: "docking" } as const;

/** "land", "take off", "dock". */
export function actionVerb(action: keyof typeof ACTION_WORDS): string {
  return ACTION_WORDS[action];
}

/** "landing", "take-off", "docking". */
export function actionNoun(action: keyof typeof ACTION_NOUNS): string {
  return ACTION_NOUNS[action];
}
