import {
  LngLatBounds,
  Map as MapLibre,
  setWorkerUrl,
  type GeoJSONSource,
  type MapMouseEvent,
  type PaddingOptions,
} from "maplibre-gl";
import workerUrl from "maplibre-gl/dist/maplibre-gl-worker.mjs?url";
import type { Camera } from "../../app/location";
import type { Pad, VerdictSummary } from "../../shared/api/records";
import { drones, type Drone } from "../../shared/drones";
import { distance_mm, frameOf, lonLat, toGlobe, type LonLat } from "../../shared/geo/frame";
import type { LiveStore, Topic } from "../../shared/live/store";
import {
  evidenceFeatures,
  gridFeatures,
  gridSpacing_m,
  padFeatures,
  siteFeatures,
  trackPoints,
  trailFeatures,
} from "./features";
import { addIcons, palette } from "./icons";
import { FINE_ZOOM } from "./scales";
import { TrackSource } from "./trackSource";
import { BASE_FILES, MAP_COLOURS, padLabel, paints, style } from "./style";
import { liveTexts as t } from "../texts";

setWorkerUrl(workerUrl);

export type Selection = { uav_id?: string; verdict?: VerdictSummary };

export type MapEvents = {
  onSelect: (uav_id: string | undefined) => void;
  onCamera: (camera: Camera, grid_m: number | undefined) => void;
  onFailure: (reason: string) => void;
};

/** Between two looks at who is what; positions move with each tick of the live connection. */
const REVIEW_MS = 500;
const FIT_ZOOM = 20.3;
const SITE_FIT_ZOOM = 15.5;
const FLIGHT_MS = 700;
const SETTLING_MS = 500;
/** A broadcast claim further away than this is not fitted into the picture: the rest would be lost in it. */
const FITTED_MM = 400_000;
const GRID_REACH_MM = 50_000_000;
const TOPICS: readonly Topic[] = ["tracks", "estimates", "sessions", "verdicts", "pads"];

/** The map: MapLibre, fed straight from the live store, apart from React. */
export class MapController {
  private readonly map: MapLibre;
  private readonly ends: (() => void)[] = [];
  private recolour: (() => void) | undefined;
  private loaded = false;
  private selection: Selection = {};
  private current: Drone[] = [];
  private tracks: TrackSource | undefined;
  private queued: ReturnType<typeof setTimeout> | undefined;
  private padsChanged = true;
  private fitted = false;
  private flight: { since_ms: number; again: () => void } | undefined;
  private wanted = false;

  constructor(
    container: HTMLElement,
    private readonly store: LiveStore,
    private readonly events: MapEvents,
    private readonly calm: boolean,
    camera: Camera | undefined,
  ) {
    this.fitted = camera !== undefined;
    const [pad] = store.pads.values();
    this.map = new MapLibre({
      container,
      style: style(palette(MAP_COLOURS)),
      center: camera !== undefined ? [camera.lon, camera.lat] : pad === undefined ? [15, 55] : lonLat(pad),
      zoom: camera?.zoom ?? (pad === undefined ? 3.2 : 13),
      minZoom: 1.5,
      maxZoom: 22.5,
      attributionControl: false,
      dragRotate: false,
      pitchWithRotate: false,
      touchPitch: false,
      fadeDuration: calm ? 0 : 120,
      renderWorldCopies: true,
      locale: { "Map.Title": t("mapTitle") },
    });
    this.map.touchZoomRotate.disableRotation();
    this.map.keyboard.disableRotation();
    this.map.on("load", () => this.onLoad());
    this.map.on("moveend", () => this.onMoved());
    for (const name of ["dragstart", "wheel", "touchstart"] as const) {
      this.map.on(name, () => {
        this.flight = undefined;
      });
    }
    this.map.on("click", (event) => this.onClick(event));
    this.map.on("error", ({ error }) => this.events.onFailure(t("mapPart", { why: error.message })));
    this.map.on("mousemove", (event) => {
      this.map.getCanvas().style.cursor = this.under(event) === undefined ? "" : "pointer";
    });
  }

  destroy(): void {
    for (const end of this.ends) end();
    clearTimeout(this.queued);
    this.map.remove();
  }

  /** After the theme has changed. */
  retheme(): void {
    this.recolour?.();
  }

  setPadding(padding: PaddingOptions): void {
    this.map.setPadding(padding);
    // A panel that opened after the flight began has stopped it: fly on, to where there is room now.
    if (this.flight !== undefined && performance.now() - this.flight.since_ms < FLIGHT_MS + SETTLING_MS) this.flight.again();
    else if (this.loaded && !this.fitted) this.fitAll(true);
  }

  select(selection: Selection): void {
    this.selection = selection;
    if (this.loaded) this.review();
  }

  zoomBy(levels: number): void {
    this.map.easeTo({ zoom: this.map.getZoom() + levels, ...this.motion(200) });
  }

  /** All pads and all drones that are near one. */
  fitAll(still = false): void {
    const places: LonLat[] = [...this.store.pads.values()].map((pad) => lonLat(pad));
    if (places.length === 0) return;
    this.fitted = true;
    this.fit(places, SITE_FIT_ZOOM, still, 100);
  }

  /** The pad, the claim and the measurement of what is selected; else where the drone is. */
  fitSelection(still = false): void {
    if (!this.loaded) {
      this.wanted = true;
      return;
    }
    const drone = this.current.find(({ uav_id }) => uav_id === this.selection.uav_id);
    const verdict = this.selection.verdict ?? (drone?.session === undefined ? undefined : this.verdictOf(drone));
    const pad = this.store.pads.get(verdict?.pad_id ?? drone?.session?.pad_id ?? "");
    const places: LonLat[] = [];
    if (pad !== undefined) {
      places.push(lonLat(pad));
      const frame = frameOf(pad);
      const local = [
        verdict?.signed?.claim,
        verdict?.estimate,
        verdict?.broadcast?.outcome === "refuted" ? verdict.broadcast.claim : undefined,
        verdict === undefined ? drone?.estimate : undefined,
      ];
      for (const place of local) {
        if (place === undefined) continue;
        if (Math.hypot(place.east_mm, place.north_mm) < FITTED_MM) places.push(toGlobe(frame, place));
      }
    }
    if (places.length < 2 && drone?.track !== undefined) {
      if (pad === undefined || distance_mm(drone.track, pad) < FITTED_MM) places.push(lonLat(drone.track));
    }
    if (places.length === 0) return;
    this.fitted = true;
    if (places.length === 1 && pad === undefined) {
      const [centre] = places;
      if (centre !== undefined) {
        this.map.easeTo({ center: centre, zoom: Math.max(this.map.getZoom(), 14.5), ...this.motion(still ? 0 : FLIGHT_MS) });
      }
      return;
    }
    this.fit(places, FIT_ZOOM, still);
  }

  private verdictOf(drone: Drone): VerdictSummary | undefined {
    return drone.verdict?.session_id === drone.session?.session_id ? drone.verdict : undefined;
  }

  private fit(places: readonly LonLat[], maxZoom: number, still: boolean, margin = 64): void {
    const bounds = new LngLatBounds();
    for (const place of places) bounds.extend(place);
    const { clientWidth, clientHeight } = this.map.getContainer();
    // A phone has no room for generous margins.
    const padding = Math.min(margin, Math.min(clientWidth, clientHeight) / 8);
    const camera = this.map.cameraForBounds(bounds, { padding, maxZoom });
    if (camera === undefined) return;
    this.flight = { since_ms: performance.now(), again: () => this.fit(places, maxZoom, still, margin) };
    this.map.easeTo({ ...camera, ...this.motion(still ? 0 : FLIGHT_MS) });
  }

  /** Where an address says; the map goes there at once, as the page would have opened there. */
  lookAt(camera: Camera): void {
    this.fitted = true;
    this.flight = undefined;
    this.map.jumpTo({ center: [camera.lon, camera.lat], zoom: camera.zoom });
  }

  private motion(duration: number): { duration: number; essential: boolean } {
    return { duration: this.calm ? 0 : duration, essential: false };
  }

  private source(id: string): GeoJSONSource {
    return this.map.getSource<GeoJSONSource>(id) ?? raise(id);
  }

  private onLoad(): void {
    this.loaded = true;
    this.tracks = new TrackSource(this.source("tracks"));
    const icons = addIcons(this.map, palette(MAP_COLOURS), !this.calm);
    this.recolour = () => {
      const colours = palette(MAP_COLOURS);
      icons(colours);
      for (const { id, paint } of paints(colours)) {
        for (const [name, value] of Object.entries(paint)) {
          this.map.setPaintProperty(id, name as never, value as never);
        }
      }
      this.map.setLayoutProperty("pad-names", "text-field", padLabel(colours));
    };
    this.ends.push(
      this.store.subscribe(TOPICS, (topics) => {
        if (topics.has("pads")) this.padsChanged = true;
        if (topics.has("tracks") || topics.has("estimates")) this.move();
        this.queued ??= setTimeout(() => {
          this.queued = undefined;
          this.review();
        }, REVIEW_MS);
      }),
    );
    const timer = setInterval(() => this.review(), 5_000);
    this.ends.push(() => clearInterval(timer));
    this.loadBaseMap();
    this.review();
    if (this.wanted) this.fitSelection(true);
  }

  /** Looks again at who is what, and draws what changed. */
  private review(): void {
    const now_ms = this.store.serverNow_ms();
    this.current = drones(this.store, now_ms);
    this.tracks?.show(trackPoints(this.current, this.selection.uav_id));
    this.set("trails", trailFeatures(this.current, this.store.trails, this.selection.uav_id));
    this.drawEvidence(now_ms);
    this.set("sites", siteFeatures(this.store.pads.values(), this.current));
    if (this.padsChanged) {
      this.padsChanged = false;
      this.set("pads", padFeatures(this.store.pads.values()));
      this.drawGrid();
    }
    if (!this.fitted && this.store.pads.size > 0) {
      if (this.selection.uav_id === undefined) this.fitAll(true);
      else this.fitSelection(true);
    }
  }

  /** Positions only, of the drones that were there at the last review. */
  private move(): void {
    for (const drone of this.current) {
      const track = this.store.tracks.get(drone.uav_id);
      if (track !== undefined) drone.track = track;
      const estimate = this.store.estimates.get(drone.uav_id);
      if (estimate !== undefined) drone.estimate = estimate;
    }
    this.tracks?.move(this.current);
    this.drawEvidence(this.store.serverNow_ms());
  }

  private drawEvidence(now_ms: number): void {
    const { uav_id, verdict } = this.selection;
    this.set("evidence", evidenceFeatures(this.current, this.store.pads, uav_id, verdict, now_ms));
  }

  private drawn = new Map<string, string>();

  /** Gives a source its features, unless it has them already. */
  private set(id: string, features: GeoJSON.Feature[]): void {
    const key = JSON.stringify(features);
    if (this.drawn.get(id) === key) return;
    this.drawn.set(id, key);
    void this.source(id).setData({ type: "FeatureCollection", features });
  }

  private onMoved(): void {
    this.tellCamera();
    if (!this.loaded) return;
    this.drawGrid();
    this.loadBaseMap();
  }

  private readonly baseLoaded = new Set<string>();

  /** Fetches what of the base map can be seen at this scale; at a pad's nothing can. */
  private loadBaseMap(): void {
    const zoom = this.map.getZoom();
    for (const { id, url, from, to, replaces } of BASE_FILES) {
      if (this.baseLoaded.has(id) || zoom < from || zoom > to) continue;
      this.baseLoaded.add(id);
      this.source(id)
        .setData(url)
        .then(
          () => {
            if (replaces !== undefined) this.map.setLayerZoomRange(replaces, 0, FINE_ZOOM);
          },
          // Reported by the map's own error event; the drones are there without a coast.
          () => this.baseLoaded.delete(id),
        );
    }
  }

  private tellCamera(): void {
    const { lat, lng } = this.map.getCenter();
    const zoom = this.map.getZoom();
    this.events.onCamera({ lat, lon: lng, zoom }, this.gridPad() === undefined ? undefined : gridSpacing_m(zoom, lat));
  }

  private gridPad(): Pad | undefined {
    const { lat, lng } = this.map.getCenter();
    const centre = { lat_e7: lat * 1e7, lon_e7: lng * 1e7 };
    let best: { pad: Pad; distance: number } | undefined;
    for (const pad of this.store.pads.values()) {
      const distance = distance_mm(pad, centre);
      if (distance < (best?.distance ?? GRID_REACH_MM)) best = { pad, distance };
    }
    return best?.pad;
  }

  private drawGrid(): void {
    const pad = this.gridPad();
    const spacing = gridSpacing_m(this.map.getZoom(), this.map.getCenter().lat);
    if (pad === undefined || spacing === undefined) {
      this.set("grid", []);
      return;
    }
    const bounds = this.map.getBounds();
    // Half a view more to each side, so that a drag does not run off the paper.
    const width = (bounds.getEast() - bounds.getWest()) / 2;
    const height = (bounds.getNorth() - bounds.getSouth()) / 2;
    const view = {
      west: bounds.getWest() - width,
      east: bounds.getEast() + width,
      south: bounds.getSouth() - height,
      north: bounds.getNorth() + height,
    };
    this.set("grid", gridFeatures(pad, view, spacing));
  }

  private under(event: MapMouseEvent): { drone: string } | { pads: string[] } | undefined {
    if (!this.loaded) return undefined;
    const { x, y } = event.point;
    const reach = 6;
    const found = this.map.queryRenderedFeatures(
      [
        [x - reach, y - reach],
        [x + reach, y + reach],
      ],
      { layers: ["tracks", "sites"] },
    );
    const { id, pads } = (found[0]?.properties ?? {}) as { id?: string; pads?: string };
    if (id !== undefined) return { drone: id };
    return pads === undefined ? undefined : { pads: pads.split(" ") };
  }

  private onClick(event: MapMouseEvent): void {
    const under = this.under(event);
    if (under === undefined) this.events.onSelect(undefined);
    else if ("drone" in under) this.events.onSelect(under.drone);
    else this.fit(under.pads.flatMap((id) => lonLatOf(this.store.pads.get(id))), SITE_FIT_ZOOM, false);
  }
}

function lonLatOf(pad: Pad | undefined): LonLat[] {
  return pad === undefined ? [] : [lonLat(pad)];
}

function raise(id: string): never {
  throw new Error(`the map's style has no source "${id}"`);
}
