/** The language, and the units and coordinates, that this browser's user reads. Kept in the browser, not on the server. */
import { useSyncExternalStore } from "react";

export const LOCALES = ["en", "fi"] as const;
export type Locale = (typeof LOCALES)[number];
export const LENGTH_UNITS = ["metric", "feet"] as const;
export type LengthUnit = (typeof LENGTH_UNITS)[number];
export const COORDINATE_FORMS = ["degrees", "minutes", "seconds"] as const;
export type CoordinateForm = (typeof COORDINATE_FORMS)[number];
export type Reading = { locale: Locale; lengths: LengthUnit; coordinates: CoordinateForm };

const KEY = "wonderland.reading";

function oneOf<T extends string>(values: readonly T[], value: unknown): T | undefined {
  return values.find((each) => each === value);
}

/** What was kept, as far as it can be used; for the rest what the browser asks for. */
export function readingFrom(kept: string | null, languages: readonly string[]): Reading {
  let fields: Partial<Record<keyof Reading, unknown>> = {};
  try {
    const parsed: unknown = JSON.parse(kept ?? "{}");
    if (typeof parsed === "object" && parsed !== null) fields = parsed;
  } catch {
    // Somebody edited it: as if nothing had been kept.
  }
  const asked = languages.map((each) => oneOf(LOCALES, each.slice(0, 2).toLowerCase())).find((each) => each !== undefined);
  return {
    locale: oneOf(LOCALES, fields.locale) ?? asked ?? "en",
    lengths: oneOf(LENGTH_UNITS, fields.lengths) ?? "metric",
    coordinates: oneOf(COORDINATE_FORMS, fields.coordinates) ?? "degrees",
  };
}

function stored(): Reading {
  const languages = typeof navigator === "undefined" ? [] : (navigator.languages as readonly string[] | undefined) ?? [];
  try {
    return readingFrom(localStorage.getItem(KEY), languages);
  } catch {
    return readingFrom(null, languages); // Storage may be forbidden, or (in tests) absent.
  }
}

let current = stored();
const listeners = new Set<() => void>();

export function reading(): Reading {
  return current;
}

function name(): void {
  if (typeof document !== "undefined") document.documentElement.lang = current.locale;
}

name();

export function setReading(change: Partial<Reading>): void {
  current = { ...current, ...change };
  try {
    localStorage.setItem(KEY, JSON.stringify(current));
  } catch {
    // It holds until the page is closed.
  }
  name();
  for (const listener of listeners) listener();
}

function subscribe(listener: () => void): () => void {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

export function useReading(): Reading {
  return useSyncExternalStore(subscribe, reading);
}
