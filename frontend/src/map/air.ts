import type { Feature, Point } from "geojson";
import { claimRing, measuredDiamond, type Tone } from "../shared/design/symbols";
import { HIDDEN, type Fleet } from "../shared/fleet";
import { latitude, mercatorX, mercatorY } from "../shared/geo/mercator";
import type { LiveStore } from "../shared/live/store";
import { upOf } from "./heights";
import { drawParts, type Palette } from "./icons";
import { FAINT } from "./liveLayers";
import { spotOf, type Spot, type View } from "./view";
import { CLOSE_ZOOM } from "./scales";

/** More stems than this nobody could tell apart. */
const MOST_STEMS = 300;
const STEMS_ZOOM = 13;
const SHADOW_M = 2.5;
/** No larger on the screen than what throws it. */
const SHADOW_PX = 9;
/** A shadow is dark in every theme. */
const SHADE = "#000";
const ROUND = 40;
const SYMBOL = 20;

type Properties = { age?: number; strong?: boolean; kind?: string; tone?: Tone; up_m?: number; to_m?: number; half_m?: number; icon?: string; faint?: boolean };

/**
 * What has a height, while the camera is tilted: each drone's stem and shadow, and the evidence of a verdict where it
 * was measured and claimed. On a canvas between the map and the drones, since MapLibre's symbols lie on the ground.
 */
export class Air {
  private readonly canvas = document.createElement("canvas");
  private readonly context: CanvasRenderingContext2D | null;
  private colours: Palette = {};
  private readonly sprites = new Map<string, HTMLCanvasElement>();
  private empty = true;
  /** How opaque what is drawn now is, at most. */
  private whole = 1;

  constructor(container: HTMLElement) {
    this.canvas.className = "map-air";
    this.canvas.setAttribute("aria-hidden", "true");
    container.append(this.canvas);
    this.context = this.canvas.getContext("2d");
  }

  remove(): void {
    this.canvas.remove();
  }

  recolour(colours: Palette): void {
    this.colours = colours;
    this.sprites.clear();
  }

  draw(view: View, ratio: number, store: LiveStore, fleet: Fleet, evidence: readonly Feature[], selected: number | undefined): void {
    const { context, canvas } = this;
    if (context === null || (view.tilt === undefined && this.empty)) return;
    const [width, height] = [Math.round(view.width * ratio), Math.round(view.height * ratio)];
    if (canvas.width !== width || canvas.height !== height) {
      canvas.width = width;
      canvas.height = height;
      canvas.style.width = `${view.width}px`;
      canvas.style.height = `${view.height}px`;
    }
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, width, height);
    this.empty = view.tilt === undefined;
    if (this.empty) return;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.lineCap = "round";
    for (const each of evidence) this.onGround(context, view, each);
    if (view.zoom >= STEMS_ZOOM) this.stems(context, view, store, fleet, selected);
    for (const each of evidence) this.evidence(context, view, ratio, each);
    context.globalAlpha = 1;
  }

  private stems(context: CanvasRenderingContext2D, view: View, store: LiveStore, fleet: Fleet, selected: number | undefined): void {
    const { tracks } = store;
    let drawn = 0;
    for (let slot = 0; slot < fleet.looks.length && drawn < MOST_STEMS; slot++) {
      if (fleet.looks[slot] === HIDDEN) continue;
      const [x = 0, y = 0] = [tracks.x[slot], tracks.y[slot]];
      const up_m = upOf(store, slot);
      const foot = spotOf(view, x, y);
      const head = spotOf(view, x, y, up_m);
      if (foot === undefined || head === undefined || up_m < 1) continue;
      if (head.left < -40 || head.left > view.width + 40 || foot.top < 0 || head.top > view.height) continue;
      drawn += 1;
      const strong = slot === selected;
      context.globalAlpha = 0.28;
      context.fillStyle = SHADE;
      this.ring(context, view, x, y, Math.min(SHADOW_M, SHADOW_PX / (view.tilt?.perMetre ?? 1)), 0);
      context.fill();
      context.globalAlpha = strong ? 0.9 : 0.55;
      context.strokeStyle = this.colours[strong ? "ink" : "ink2"] ?? "#000";
      context.lineWidth = strong ? 1.6 : 1;
      line(context, foot, head);
    }
    context.globalAlpha = 1;
  }

  /** Trails, the older the fainter, and how well a drone says it knows where it is: both lie on the ground. */
  private onGround(context: CanvasRenderingContext2D, view: View, { geometry, properties }: Feature): void {
    const { kind, tone = "none", age, strong } = (properties ?? {}) as Properties;
    context.strokeStyle = context.fillStyle = this.colours[tone] ?? "#888";
    if (geometry.type === "LineString" && age !== undefined) {
      context.globalAlpha = (strong === true ? 0.85 : 0.5) * (1 - 0.22 * age);
      context.lineWidth = 1.6;
      context.setLineDash([0.2, 4]);
      this.outline(context, view, geometry.coordinates, 0);
      context.stroke();
      context.setLineDash([]);
    } else if (kind === "accuracy" && geometry.type === "Polygon") {
      this.outline(context, view, geometry.coordinates[0] ?? [], 0);
      context.globalAlpha = 0.08;
      context.fill();
    }
    context.globalAlpha = 1;
  }

  private evidence(context: CanvasRenderingContext2D, view: View, ratio: number, { geometry, properties }: Feature): void {
    const { kind, tone = "none", up_m = 0, to_m = 0, half_m = 0, faint } = (properties ?? {}) as Properties;
    if (view.zoom < CLOSE_ZOOM - 1) return;
    this.whole = context.globalAlpha = faint === true ? FAINT : 1;
    context.strokeStyle = context.fillStyle = this.colours[tone] ?? "#888";
    if (kind === "difference" && geometry.type === "LineString") {
      const [from, to] = geometry.coordinates.map(([lon = 0, lat = 0], i) => spotOf(view, mercatorX(lon), mercatorY(lat), i === 0 ? up_m : to_m));
      context.lineWidth = 2;
      if (from !== undefined && to !== undefined) line(context, from, to);
    } else if ((kind === "buffer" || kind === "ellipse") && geometry.type === "Polygon") {
      const ring = geometry.coordinates[0] ?? [];
      if (kind === "buffer") this.cylinder(context, view, ring, Math.max(0, up_m - half_m), up_m + half_m);
      else {
        this.outline(context, view, ring, up_m);
        context.globalAlpha = 0.2 * this.whole;
        context.fill();
        context.globalAlpha = this.whole;
        context.lineWidth = 1.3;
        context.stroke();
      }
    } else if ((kind === "claim" || kind === "measured") && geometry.type === "Point") {
      this.mark(context, view, ratio, geometry, kind, tone, up_m, properties as Properties);
    }
  }

  /** A claim's ring or a measurement's diamond at its height, on a thin stem. */
  private mark(context: CanvasRenderingContext2D, view: View, ratio: number, point: Point, kind: string, tone: Tone, up_m: number, { icon = "" }: Properties): void {
    const [lon = 0, lat = 0] = point.coordinates;
    const [x, y] = [mercatorX(lon), mercatorY(lat)];
    const foot = spotOf(view, x, y);
    const head = spotOf(view, x, y, up_m);
    if (foot === undefined || head === undefined) return;
    context.globalAlpha = 0.7 * this.whole;
    context.lineWidth = 1;
    context.setLineDash([2, 3]);
    line(context, foot, head);
    context.setLineDash([]);
    context.globalAlpha = this.whole;
    context.drawImage(this.sprite(kind, tone, icon.startsWith("measured"), ratio), head.left - SYMBOL / 2, head.top - SYMBOL / 2, SYMBOL, SYMBOL);
  }

  private sprite(kind: string, tone: Tone, verified: boolean, ratio: number): HTMLCanvasElement {
    const key = `${kind} ${tone} ${verified} ${ratio}`;
    const known = this.sprites.get(key);
    if (known !== undefined) return known;
    const canvas = document.createElement("canvas");
    const side = Math.ceil(SYMBOL * ratio);
    canvas.width = canvas.height = side;
    const context = canvas.getContext("2d");
    if (context !== null) drawParts(context, kind === "claim" ? claimRing(tone) : measuredDiamond(tone, verified), { side, size: side, colours: this.colours });
    this.sprites.set(key, canvas);
    return canvas;
  }

  private cylinder(context: CanvasRenderingContext2D, view: View, ring: readonly (readonly number[])[], from_m: number, to_m: number): void {
    context.lineWidth = 1.4;
    const low = this.spots(view, ring, from_m);
    const high = this.spots(view, ring, to_m);
    if (low.length === 0 || high.length === 0) return;
    const edge = (spots: readonly Spot[], least: boolean): number => spots.reduce((best, spot, i) => ((spot.left < (spots[best]?.left ?? 0)) === least ? i : best), 0);
    for (const least of [true, false]) {
      const [a, b] = [low[edge(low, least)], high[edge(high, least)]];
      if (a !== undefined && b !== undefined) line(context, a, b);
    }
    context.setLineDash([4, 3]);
    this.outline(context, view, ring, from_m);
    context.globalAlpha = 0.1 * this.whole;
    context.fill();
    context.globalAlpha = this.whole;
    context.stroke();
    this.outline(context, view, ring, to_m);
    context.globalAlpha = 0.1 * this.whole;
    context.fill();
    context.globalAlpha = this.whole;
    context.stroke();
    context.setLineDash([]);
  }

  private spots(view: View, ring: readonly (readonly number[])[], up_m: number): Spot[] {
    return ring.flatMap(([lon = 0, lat = 0]) => spotOf(view, mercatorX(lon), mercatorY(lat), up_m) ?? []);
  }

  private outline(context: CanvasRenderingContext2D, view: View, ring: readonly (readonly number[])[], up_m: number): void {
    context.beginPath();
    this.spots(view, ring, up_m).forEach(({ left, top }, i) => (i === 0 ? context.moveTo(left, top) : context.lineTo(left, top)));
  }

  private ring(context: CanvasRenderingContext2D, view: View, x: number, y: number, radius_m: number, up_m: number): void {
    const radius = radius_m / (40_075_016.686 * Math.cos((latitude(y) * Math.PI) / 180));
    context.beginPath();
    for (let i = 0; i <= ROUND; i++) {
      const angle = (i / ROUND) * 2 * Math.PI;
      const spot = spotOf(view, x + radius * Math.cos(angle), y + radius * Math.sin(angle), up_m);
      if (spot !== undefined) context.lineTo(spot.left, spot.top);
    }
  }
}

function line(context: CanvasRenderingContext2D, from: Spot, to: Spot): void {
  context.beginPath();
  context.moveTo(from.left, from.top);
  context.lineTo(to.left, to.top);
  context.stroke();
}
