/** How this browser's user wants the map: flat or deep, and what stands beside a drone. Kept in the browser. */
import { useSyncExternalStore } from "react";

export const BLOCK_PARTS = ["height", "speed", "operator"] as const;
export type BlockPart = (typeof BLOCK_PARTS)[number];
/** `flat`: never tilted by itself; `imagery`: aerial images for the drawn ground, where there are any. */
export type MapWishes = { flat: boolean; imagery: boolean } & Record<BlockPart, boolean>;

const KEY = "wonderland.map";
const USUAL: MapWishes = { flat: false, imagery: false, height: true, speed: false, operator: false };

/** What was kept, as far as it can be used. */
export function wishesFrom(kept: string | null): MapWishes {
  let fields: Partial<Record<keyof MapWishes, unknown>> = {};
  try {
    const parsed: unknown = JSON.parse(kept ?? "{}");
    if (typeof parsed === "object" && parsed !== null) fields = parsed;
  } catch {
    // Somebody edited it: as if nothing had been kept.
  }
  const wish = (name: keyof MapWishes): boolean => (typeof fields[name] === "boolean" ? fields[name] : USUAL[name]);
  return { flat: wish("flat"), imagery: wish("imagery"), height: wish("height"), speed: wish("speed"), operator: wish("operator") };
}

function stored(): MapWishes {
  try {
    return wishesFrom(localStorage.getItem(KEY));
  } catch {
    return USUAL; // Storage may be forbidden, or (in tests) absent.
  }
}

let current = stored();
const listeners = new Set<() => void>();

export function mapWishes(): MapWishes {
  return current;
}

export function wishMap(change: Partial<MapWishes>): void {
  current = { ...current, ...change };
  try {
    localStorage.setItem(KEY, JSON.stringify(current));
  } catch {
    // It holds until the page is closed.
  }
  for (const listener of listeners) listener();
}

function subscribe(listener: () => void): () => void {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

export function useMapWishes(): MapWishes {
  return useSyncExternalStore(subscribe, mapWishes);
}
