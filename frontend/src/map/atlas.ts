import { claimRing, SYMBOLS, type Part } from "../shared/design/symbols";
import { LOOKS } from "../shared/drones";
import { drawParts, GROUND, type Palette } from "./icons";

/** Side of a symbol's square on the screen, and the symbol's own size in it, CSS pixels. */
export const CELL = 22;
const SYMBOL = 18;

const HALO = "M10 1a9 9 0 1 0 0 18a9 9 0 1 0 0-18z";

/** Close by, who was judged is the ring of its claim. */
export const CLAIMS_FROM = LOOKS.length;
/** Looks are in the order of `LOOKS`: refuted, inconclusive and verified are the first three. */
const CLAIM_TONES = ["bad", "maybe", "ok"] as const;
export const SELECTED = CLAIMS_FROM + CLAIM_TONES.length;
export const HOVERED = SELECTED + 1;
/** Outside the symbol, towards where it flies; turned by the drone layer. */
export const HEADING = HOVERED + 1;
const WEDGE = "M10 0.4L13.2 4.4L10 3.4L6.8 4.4z";

function cells(): { parts: readonly Part[]; size: number }[] {
  return [
    ...LOOKS.map((look) => ({ parts: [GROUND, ...SYMBOLS[look]], size: SYMBOL })),
    ...CLAIM_TONES.map((tone) => ({ parts: claimRing(tone), size: 20 })),
    { parts: [{ d: HALO, stroke: "accent" as const, width: 1.2 }], size: CELL },
    { parts: [{ d: HALO, stroke: "ink2" as const, width: 0.9 }], size: CELL },
    { parts: [{ d: WEDGE, fill: "ink2" as const }], size: CELL },
  ];
}

/** The symbols, one after the other, as pixels of a square each of `side` device pixels. */
export function drawAtlas(colours: Palette, side: number): { count: number; pixels: Uint8Array } {
  const list = cells();
  const pixels = new Uint8Array(list.length * side * side * 4);
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = side;
  const context = canvas.getContext("2d", { willReadFrequently: true });
  if (context === null) throw new Error("this browser gives no 2D canvas to draw the map's symbols on");
  list.forEach(({ parts, size }, i) => {
    drawParts(context, parts, { side, size: (side * size) / CELL, colours });
    pixels.set(context.getImageData(0, 0, side, side).data, i * side * side * 4);
  });
  return { count: list.length, pixels };
}
