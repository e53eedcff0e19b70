import type { Tone } from "../shared/design/symbols";
import { Occupied, place, type Label, type Side } from "./placing";
import { spotOf, type View } from "./view";
import type { Palette } from "./icons";

/** How the names of the place look: paler than anything that flies. */
export type NameLook = "town" | "water" | "quarter" | "landmark";
export type Line = { text: string; strong?: boolean; tone?: Tone | "ink3"; look?: NameLook };

/** Words at a place (Web Mercator, 0 to 1). */
export type Words = {
  id: string;
  x: number;
  y: number;
  /** Metres above the ground, which count where the camera is tilted. */
  up_m?: number;
  lines: readonly Line[];
  /** These alone where there is no room for all. */
  fewer?: readonly Line[];
  rank: number;
  clear: number;
  sides: readonly Side[];
  /** They stand between these zooms. */
  from?: number;
  to?: number;
};

/** A symbol that no words may cover: its place, and half its size on the screen, pixels. */
export type Mark = { x: number; y: number; clear: number };

/** More would not be read, and cost frames. */
const MOST = 160;
const LINE = 15;
const MARGIN = 2;
const KEPT = 800;
/** Words that leave the view go on for this long beyond its edge, so that they do not flicker there. */
const EDGE = 40;

/** Font, letter spacing, colour and that of the edge. */
const NAMES: Record<NameLook, { font: string; spacing: string; colour: string; edge: string }> = {
  town: { font: "560 13px", spacing: "0.5px", colour: "place-ink", edge: "land" },
  water: { font: "560 12px", spacing: "0.9px", colour: "water-ink", edge: "water" },
  quarter: { font: "560 10.5px", spacing: "1.5px", colour: "place-ink", edge: "land" },
  landmark: { font: "500 10.5px", spacing: "0px", colour: "place-ink", edge: "land" },
};

type Sprite = { canvas: HTMLCanvasElement; width: number; height: number };

/** All words on the map, on a canvas over it: placed so that none covers another, or a symbol. */
export class Labels {
  private readonly canvas = document.createElement("canvas");
  private readonly context: CanvasRenderingContext2D | null;
  private readonly sprites = new Map<string, Sprite>();
  private sides = new Map<string, Side>();
  private colours: Palette = {};
  private readonly family: string;

  constructor(container: HTMLElement) {
    this.canvas.className = "map-labels";
    this.canvas.setAttribute("aria-hidden", "true");
    container.append(this.canvas);
    this.context = this.canvas.getContext("2d");
    this.family = getComputedStyle(document.documentElement).getPropertyValue("--sans");
  }

  remove(): void {
    this.canvas.remove();
  }

  /** In these colours from now on. */
  recolour(colours: Palette): void {
    this.colours = colours;
    this.sprites.clear();
  }

  /** The drawn words, for tests and for the pointer. */
  get shown(): readonly string[] {
    return [...this.sides.keys()];
  }

  draw(view: View, ratio: number, words: Iterable<Words>, marks: (occupied: Occupied) => void): void {
    const { context, canvas } = this;
    if (context === null) return;
    const [width, height] = [Math.round(view.width * ratio), Math.round(view.height * ratio)];
    if (canvas.width !== width || canvas.height !== height) {
      canvas.width = width;
      canvas.height = height;
      canvas.style.width = `${view.width}px`;
      canvas.style.height = `${view.height}px`;
      this.sprites.clear();
    }
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, width, height);
    const occupied = new Occupied(view.width, view.height);
    marks(occupied);
    const sprites = new Map<string, { sprite: Sprite; less: Sprite | undefined }>();
    const labels: Label[] = [];
    for (const each of words) {
      if ((each.from !== undefined && view.zoom < each.from) || (each.to !== undefined && view.zoom >= each.to)) continue;
      const spot = spotOf(view, each.x, each.y, each.up_m);
      if (spot === undefined) continue;
      const { left, top } = spot;
      if (left < -EDGE || top < -EDGE || left > view.width + EDGE || top > view.height + EDGE) continue;
      const { id, rank, clear, sides, fewer } = each;
      const sprite = this.sprite(each.lines, ratio);
      const less = fewer && this.sprite(fewer, ratio);
      sprites.set(id, { sprite, less });
      labels.push({ id, rank, clear, sides, left, top, width: sprite.width, height: sprite.height, ...(less !== undefined && { fewer: less }) });
    }
    const placed = place(labels, occupied, this.sides, MOST);
    this.sides = new Map(placed.map(({ label, side }) => [label.id, side]));
    for (const { label, left, top, isLess } of placed) {
      const both = sprites.get(label.id);
      const sprite = isLess === true ? both?.less : both?.sprite;
      if (sprite !== undefined) context.drawImage(sprite.canvas, Math.round(left * ratio), Math.round(top * ratio));
    }
  }

  /** Words drawn once: writing them anew at each frame would cost most of it. */
  private sprite(lines: readonly Line[], ratio: number): Sprite {
    const key = lines.map(({ text, strong, tone, look }) => `${strong === true ? 1 : 0}${tone ?? look ?? ""}\t${text}`).join("\n");
    const known = this.sprites.get(key);
    if (known !== undefined) return known;
    if (this.sprites.size > KEPT) this.sprites.clear();
    const sprite = this.write(lines, ratio);
    this.sprites.set(key, sprite);
    return sprite;
  }

  private write(lines: readonly Line[], ratio: number): Sprite {
    const canvas = document.createElement("canvas");
    const context = canvas.getContext("2d");
    if (context === null) return { canvas, width: 0, height: 0 };
    const style = ({ strong, look }: Line): void => {
      context.font = `${look !== undefined ? NAMES[look].font : strong === true ? "620 12px" : "500 11.5px"} ${this.family}`;
      context.letterSpacing = look === undefined ? "0px" : NAMES[look].spacing;
    };
    const written = lines.map(({ text, look }) => (look === "quarter" ? text.toLocaleUpperCase() : text));
    const widths = lines.map((line, i) => {
      style(line);
      return context.measureText(written[i] ?? "").width;
    });
    const width = Math.ceil(Math.max(0, ...widths)) + 2 * MARGIN;
    const height = lines.length * LINE;
    canvas.width = Math.ceil(width * ratio);
    canvas.height = Math.ceil(height * ratio);
    context.scale(ratio, ratio);
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.lineJoin = "round";
    context.lineWidth = 3.2;
    lines.forEach((line, i) => {
      const { look, tone, strong } = line;
      style(line);
      context.strokeStyle = this.colours[look === undefined ? "land" : NAMES[look].edge] ?? "#fff";
      context.strokeText(written[i] ?? "", width / 2, (i + 0.5) * LINE);
      context.fillStyle = this.colours[look !== undefined ? NAMES[look].colour : (tone ?? (strong === true ? "ink" : "ink2"))] ?? "#000";
      context.fillText(written[i] ?? "", width / 2, (i + 0.5) * LINE);
    });
    return { canvas, width, height };
  }
}
