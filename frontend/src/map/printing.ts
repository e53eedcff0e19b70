import type { Map as MapLibre } from "maplibre-gl";

/**
 * Paper gets a copy: what a graphics card has drawn is gone by the time that a browser prints, and a dark map would be a
 * black page. Returns what ends it. `retheme`: draws in the colours that hold now.
 */
export function copyForPrint(map: MapLibre, retheme: () => void): () => void {
  const root = document.documentElement;
  let copy: HTMLCanvasElement | undefined;
  let theme: string | undefined;

  const before = (): void => {
    const canvas = map.getCanvas();
    // A browser may tell twice of one print.
    if (copy !== undefined || canvas.width === 0) return;
    theme = root.dataset["theme"];
    root.dataset["theme"] = "light";
    retheme();
    map.redraw();
    copy = document.createElement("canvas");
    copy.className = "map-print";
    copy.width = canvas.width;
    copy.height = canvas.height;
    // What stands over the map is on canvases of its own; they are of this frame only now.
    const paper = copy.getContext("2d");
    for (const each of canvas.parentElement?.querySelectorAll("canvas") ?? []) paper?.drawImage(each, 0, 0, copy.width, copy.height);
    canvas.after(copy);
  };
  const after = (): void => {
    copy?.remove();
    copy = undefined;
    if (theme !== undefined) root.dataset["theme"] = theme;
    retheme();
  };
  addEventListener("beforeprint", before);
  addEventListener("afterprint", after);
  return () => {
    removeEventListener("beforeprint", before);
    removeEventListener("afterprint", after);
    copy?.remove();
  };
}
