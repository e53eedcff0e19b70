import type { Map as MapLibre } from "maplibre-gl";

/** A graphics driver may start anew at any time: MapLibre makes its style again, but not what was added. Returns the end. */
export function surviveLoss(map: MapLibre, container: HTMLElement, { onLost, onBack }: { onLost: () => void; onBack: () => void }): () => void {
  // On the way down, before MapLibre hears of it.
  container.addEventListener("webglcontextlost", onLost, true);
  map.on("webglcontextrestored", () => {
    void map.once("idle", onBack);
    map.triggerRepaint();
  });
  return () => container.removeEventListener("webglcontextlost", onLost, true);
}
