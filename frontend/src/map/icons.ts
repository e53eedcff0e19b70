import type { Map as MapLibre } from "maplibre-gl";
import { SYMBOLS, claimRing, measuredDiamond, type Part, type Tone } from "../shared/design/symbols";
import type { Look } from "../shared/drones";

export type Palette = Record<string, string>;

const BOX = 20;
/** Icons are drawn at twice their size, so that they stay sharp on dense screens. */
const PIXEL_RATIO = 2;
const OUTCOME_TONES: readonly Tone[] = ["ok", "bad", "maybe", "none", "accent"];

/** The colours of tokens.css as they are in the theme that holds now. */
export function palette(names: readonly string[]): Palette {
  const style = getComputedStyle(document.documentElement);
  return Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
}

function canvas(size: number): CanvasRenderingContext2D {
  const element = document.createElement("canvas");
  element.width = element.height = size * PIXEL_RATIO;
  const context = element.getContext("2d", { willReadFrequently: true });
  if (context === null) throw new Error("this browser gives no 2D canvas to draw the map's symbols on");
  return context;
}

type Drawing = {
  /** Of the square canvas and of the symbol in its middle, canvas pixels. */
  side: number;
  size: number;
  colours: Palette;
};

/** Draws a symbol into the middle of a canvas that holds nothing else. */
export function drawParts(context: CanvasRenderingContext2D, parts: readonly Part[], { side, size, colours }: Drawing): void {
  const scale = size / BOX;
  const margin = (side - size) / 2;
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.clearRect(0, 0, side, side);
  context.setTransform(scale, 0, 0, scale, margin, margin);
  context.lineCap = context.lineJoin = "round";
  for (const part of parts) {
    const path = new Path2D(part.d);
    if (part.fill !== undefined) {
      context.fillStyle = colours[part.fill] ?? "#888";
      context.fill(path);
    }
    if (part.stroke !== undefined) {
      context.strokeStyle = colours[part.stroke] ?? "#888";
      context.lineWidth = part.width ?? 1;
      context.setLineDash([...(part.dash ?? [])]);
      context.stroke(path);
    }
  }
}

function still(parts: readonly Part[], size: number, colours: Palette): ImageData {
  const side = size * PIXEL_RATIO;
  const context = canvas(size);
  drawParts(context, parts, { side, size: side, colours });
  return context.getImageData(0, 0, side, side);
}

/** Under the hollow symbols: else trails and lines would show through. */
export const GROUND: Part = { d: "M3 10a7 7 0 1 0 14 0a7 7 0 1 0-14 0z", fill: "land" };

const PAD: readonly Part[] = [
  { d: "M4.5 1h11A3.5 3.5 0 0 1 19 4.5v11a3.5 3.5 0 0 1-3.5 3.5h-11A3.5 3.5 0 0 1 1 15.5v-11A3.5 3.5 0 0 1 4.5 1z", fill: "panel", stroke: "ink2", width: 1.3 },
  { d: "M7 5.8v8.4M13 5.8v8.4M7 10h6", stroke: "ink", width: 1.6 },
];

/** A pad of which somebody should know something: a mark at its corner, by its own shape. */
function padWith(tone: Tone, mark: string): readonly Part[] {
  return [...PAD, { d: "M16 0.4a3.8 3.8 0 1 0 0 7.6a3.8 3.8 0 1 0 0-7.6z", fill: tone, stroke: "panel", width: 1 }, { d: mark, stroke: "panel", width: 1.3 }];
}

function images(): { name: string; parts: readonly Part[]; size: number }[] {
  return [
    ...(Object.keys(SYMBOLS) as Look[]).map((look) => ({ name: `look-${look}`, parts: [GROUND, ...SYMBOLS[look]], size: 18 })),
    ...OUTCOME_TONES.flatMap((tone) => [
      { name: `claim-${tone}`, parts: claimRing(tone), size: 20 },
      { name: `measured-${tone}`, parts: measuredDiamond(tone, true), size: 20 },
      { name: `measuring-${tone}`, parts: measuredDiamond(tone, false), size: 20 },
    ]),
    { name: "pad", parts: PAD, size: 24 },
    { name: "pad-bad", parts: padWith("bad", "M14.4 2.6l3.2 3.2M17.6 2.6l-3.2 3.2"), size: 24 },
    { name: "pad-maybe", parts: padWith("maybe", "M16 2.3v2.2M16 6v0.1"), size: 24 },
  ];
}

/** Gives the map its symbols; the returned function draws them again in another theme's colours. */
export function addIcons(map: MapLibre, colours: Palette): (colours: Palette) => void {
  for (const { name, parts, size } of images()) {
    if (map.hasImage(name)) map.removeImage(name);
    map.addImage(name, still(parts, size, colours), { pixelRatio: PIXEL_RATIO });
  }
  return (next) => {
    for (const { name, parts, size } of images()) map.updateImage(name, still(parts, size, next));
    map.triggerRepaint();
  };
}
