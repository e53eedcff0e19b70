import type { Map as MapLibre, StyleImageInterface } from "maplibre-gl";
import { SYMBOLS, claimRing, measuredDiamond, type Part, type Tone } from "../../shared/design/symbols";
import type { Look } from "../../shared/drones";

export type Palette = Record<string, string>;

const BOX = 20;
/** Icons are drawn at twice their size, so that they stay sharp on dense screens. */
const PIXEL_RATIO = 2;
const TURN_MS = 1_600;
const FRAME_MS = 66;
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

function draw(context: CanvasRenderingContext2D, parts: readonly Part[], size: number, colours: Palette, turn: number): void {
  const scale = (size * PIXEL_RATIO) / BOX;
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, BOX, BOX);
  context.lineCap = context.lineJoin = "round";
  for (const part of parts) {
    context.save();
    if (part.turning === true) {
      context.translate(BOX / 2, BOX / 2);
      context.rotate(turn * 2 * Math.PI);
      context.translate(-BOX / 2, -BOX / 2);
    }
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
    context.restore();
  }
}

function still(parts: readonly Part[], size: number, colours: Palette): ImageData {
  const context = canvas(size);
  draw(context, parts, size, colours, 0);
  return context.getImageData(0, 0, size * PIXEL_RATIO, size * PIXEL_RATIO);
}

/** The turning arc of a proof under way; still where motion is not wanted. */
class TurningIcon implements StyleImageInterface {
  readonly width: number;
  readonly height: number;
  data: Uint8ClampedArray;
  private readonly context: CanvasRenderingContext2D;
  private last_ms = 0;
  private timer: ReturnType<typeof setTimeout> | undefined;

  constructor(
    private readonly map: MapLibre,
    private readonly size: number,
    private colours: Palette,
    private readonly moving: boolean,
  ) {
    this.context = canvas(size);
    this.width = this.height = size * PIXEL_RATIO;
    this.data = new Uint8ClampedArray();
    this.paint(0);
  }

  recolour(colours: Palette): void {
    this.colours = colours;
    this.last_ms = 0;
    if (!this.moving) this.paint(0);
  }

  render(): boolean {
    if (!this.moving) return false;
    const now_ms = performance.now();
    // MapLibre calls this only while the image is on the map, so an idle map costs nothing.
    this.timer ??= setTimeout(() => {
      this.timer = undefined;
      this.map.triggerRepaint();
    }, FRAME_MS);
    if (now_ms - this.last_ms < FRAME_MS) return false;
    this.last_ms = now_ms;
    this.paint((now_ms % TURN_MS) / TURN_MS);
    return true;
  }

  onRemove(): void {
    clearTimeout(this.timer);
  }

  private paint(turn: number): void {
    draw(this.context, [GROUND, ...SYMBOLS.proving], this.size, this.colours, turn);
    this.data = this.context.getImageData(0, 0, this.width, this.height).data;
  }
}

/** Under the hollow symbols: else trails and lines would show through. */
const GROUND: Part = { d: "M3 10a7 7 0 1 0 14 0a7 7 0 1 0-14 0z", fill: "land" };

const PAD: readonly Part[] = [
  { d: "M4.5 1h11A3.5 3.5 0 0 1 19 4.5v11a3.5 3.5 0 0 1-3.5 3.5h-11A3.5 3.5 0 0 1 1 15.5v-11A3.5 3.5 0 0 1 4.5 1z", fill: "panel", stroke: "ink2", width: 1.3 },
  { d: "M7 5.8v8.4M13 5.8v8.4M7 10h6", stroke: "ink", width: 1.6 },
];

function images(): { name: string; parts: readonly Part[]; size: number }[] {
  const looks = (Object.keys(SYMBOLS) as Look[]).filter((look) => look !== "proving");
  return [
    ...looks.map((look) => ({ name: `look-${look}`, parts: [GROUND, ...SYMBOLS[look]], size: 18 })),
    ...OUTCOME_TONES.flatMap((tone) => [
      { name: `claim-${tone}`, parts: claimRing(tone), size: 20 },
      { name: `measured-${tone}`, parts: measuredDiamond(tone, true), size: 20 },
      { name: `measuring-${tone}`, parts: measuredDiamond(tone, false), size: 20 },
    ]),
    { name: "pad", parts: PAD, size: 24 },
  ];
}

/** Gives the map its symbols; the returned function draws them again in another theme's colours. */
export function addIcons(map: MapLibre, colours: Palette, moving: boolean): (colours: Palette) => void {
  for (const { name, parts, size } of images()) {
    map.addImage(name, still(parts, size, colours), { pixelRatio: PIXEL_RATIO });
  }
  const turning = new TurningIcon(map, 18, colours, moving);
  map.addImage("look-proving", turning, { pixelRatio: PIXEL_RATIO });
  return (next) => {
    for (const { name, parts, size } of images()) map.updateImage(name, still(parts, size, next));
    turning.recolour(next);
    map.triggerRepaint();
  };
}
