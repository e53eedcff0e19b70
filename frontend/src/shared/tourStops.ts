import { useSyncExternalStore } from "react";
import type { Place } from "./address/location";

/** A stop of the tour: where it is, and what of the page it is about. */
export type Stop = { name: "map" | "list" | "why" | "steps" | "ledger" | "alerts" | "keys"; place: Place; selector: string };

const LIVE: Place = { room: "live" };

export const STOPS: readonly Stop[] = [
  { name: "map", place: LIVE, selector: ".maplibregl-map" },
  { name: "list", place: LIVE, selector: "section.list" },
  { name: "why", place: { room: "verdicts", filters: { outcome: "refuted" } }, selector: ".page" },
  { name: "steps", place: { room: "sessions" }, selector: ".page" },
  { name: "ledger", place: { room: "ledger", path: [], query: {} }, selector: ".page" },
  { name: "alerts", place: { room: "alerts", path: [], query: {} }, selector: ".page" },
  { name: "keys", place: LIVE, selector: ".header" },
];

const KEY = "wonderland.tour";
const listeners = new Set<() => void>();
let at: number | undefined;
let offered = seen();

function seen(): boolean {
  try {
    return localStorage.getItem(KEY) === null;
  } catch {
    return false; // Where nothing can be kept it would be offered for ever.
  }
}

function tell(): void {
  for (const listener of listeners) listener();
}

/** It is offered until it was taken or declined once. */
export function declineTour(): void {
  offered = false;
  at = undefined;
  try {
    localStorage.setItem(KEY, "seen");
  } catch {
    // It holds until the page is closed.
  }
  tell();
}

export function startTour(): void {
  declineTour();
  goToStop(0);
}

/** Beyond the last stop the tour is over. */
export function goToStop(stop: number): void {
  at = stop >= 0 && stop < STOPS.length ? stop : undefined;
  tell();
}

function subscribe(listener: () => void): () => void {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

export function useTour(): { at: number | undefined; offered: boolean } {
  const stop = useSyncExternalStore(subscribe, () => at);
  const open = useSyncExternalStore(subscribe, () => offered);
  return { at: stop, offered: open };
}
