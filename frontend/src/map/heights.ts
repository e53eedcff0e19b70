import type { LiveStore } from "../shared/live/store";

/** What a broadcast's height may be off the ground and still be drawn there, metres. */
const HIGHEST_M = 10_000;

/**
 * How high a drone flies above the ground that the map draws: above the pad that hears it, since heights are above the
 * ellipsoid and the map has no terrain. Metres; 0 where it is not told.
 */
export function upOf(store: LiveStore, slot: number): number {
  const { tracks } = store;
  const height_mm = tracks.heightAt(slot);
  const ground_mm = store.pads.get(tracks.padAt(slot))?.height_mm;
  if (height_mm === undefined || ground_mm === undefined) return 0;
  return Math.max(0, Math.min(HIGHEST_M, (height_mm - ground_mm) / 1000));
}
