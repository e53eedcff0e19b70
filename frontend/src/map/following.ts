import type { Map as MapLibre } from "maplibre-gl";
import type { LonLat } from "../shared/geo/frame";
import { lonLat } from "../shared/geo/frame";
import type { LiveStore } from "../shared/live/store";
import { freeRoom } from "./framing";
import { upOf } from "./heights";
import { slantedCamera } from "./view";

/** About what lies between two positions of a drone: that long the camera takes to the next. */
const STEP_MS = 250;
const FLIGHT_MS = 700;
const LEAST_ZOOM = 15;
/** What flies, its shadow and their words are clear of the edges by this. */
const MARGIN = 60;
/** What a move of the camera is marked with while more of them follow. */
export const PASSING: { passing?: boolean } = { passing: true };

/** Keeps the camera on one drone, in the middle between it and its shadow where the camera looks aslant. */
export class Following {
  private uav_id: string | undefined;
  private frame: number | undefined;
  private last_ms = 0;
  /** When the camera is to have arrived. */
  private due_ms = 0;

  constructor(
    private readonly map: MapLibre,
    private readonly store: LiveStore,
    private readonly calm: boolean,
  ) {}

  get isOn(): boolean {
    return this.uav_id !== undefined;
  }

  stop(): void {
    this.uav_id = undefined;
    if (this.frame !== undefined) cancelAnimationFrame(this.frame);
    this.frame = undefined;
  }

  start(uav_id: string): void {
    this.uav_id = uav_id;
    this.due_ms = performance.now() + FLIGHT_MS;
    const zoom = Math.max(this.map.getZoom(), LEAST_ZOOM);
    const there = this.camera(zoom);
    if (there === undefined) return;
    if (zoom === this.map.getZoom()) this.step();
    else this.map.easeTo({ ...there, duration: this.calm ? 0 : FLIGHT_MS });
  }

  /** After the drone has a new position. */
  tick(): void {
    const now_ms = performance.now();
    if (this.uav_id === undefined || now_ms < this.due_ms - STEP_MS) return;
    this.due_ms = this.calm ? now_ms : now_ms + STEP_MS;
    this.step();
  }

  /** By the time that has passed since the last one, however few frames a browser draws. */
  private step(): void {
    if (this.frame !== undefined) return;
    this.last_ms = performance.now();
    const next = (): void => {
      this.frame = undefined;
      const now_ms = performance.now();
      // Who turns the map or comes closer is not disturbed.
      const busy = this.map.isZooming() || this.map.isRotating();
      const there = busy ? undefined : this.camera(this.map.getZoom());
      const share = this.due_ms <= now_ms ? 1 : (now_ms - this.last_ms) / (this.due_ms - this.last_ms);
      this.last_ms = now_ms;
      if (there !== undefined) {
        const { lng, lat } = this.map.getCenter();
        const zoom = this.map.getZoom();
        const part = (from: number, to: number): number => from + share * (to - from);
        this.map.jumpTo({ center: [part(lng, there.center[0]), part(lat, there.center[1])], zoom: part(zoom, there.zoom) }, share < 1 ? PASSING : undefined);
      }
      if (share < 1) this.frame = requestAnimationFrame(next);
    };
    next();
  }

  private camera(zoom: number): { center: LonLat; zoom: number } | undefined {
    const track = this.store.tracks.get(this.uav_id ?? "");
    const slot = this.store.tracks.slot(this.uav_id ?? "");
    if (track === undefined || slot === undefined) return undefined;
    const [at, pitch] = [lonLat(track), this.map.getPitch()];
    if (pitch < 0.5) return { center: at, zoom };
    return slantedCamera([{ at }, { at, up_m: upOf(this.store, slot) }], { bearing: this.map.getBearing(), pitch }, freeRoom(this.map, MARGIN), zoom);
  }
}
