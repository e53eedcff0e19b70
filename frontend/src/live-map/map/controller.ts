import { LngLatBounds, Map as MapLibre, setWorkerUrl, type MapMouseEvent, type PaddingOptions } from "maplibre-gl";
import workerUrl from "maplibre-gl/dist/maplibre-gl-worker.mjs?url";
import type { Camera } from "../../app/location";
import type { Drone } from "../../shared/drones";
import { HIDDEN, type Fleet } from "../../shared/fleet";
import { distance_mm, frameOf, lonLat, toGlobe, type LonLat } from "../../shared/geo/frame";
import type { LiveStore, Topic } from "../../shared/live/store";
import { broadcastApart } from "../../shared/refuted";
import { liveTexts as t } from "../texts";
import { gridSpacing_m } from "./features";
import { upOf } from "./heights";
import { palette } from "./icons";
import type { Overlay } from "./overlays";
import { Picture, type Selection } from "./picture";
import type { BaseMap } from "./place";
import { SITE_ZOOM } from "./scales";
import { MAP_COLOURS, style } from "./style";
import { placeAt, slantedCamera, slotAt, viewOf } from "./view";

setWorkerUrl(workerUrl);

export type MapEvents = {
  onSelect: (uav_id: string | undefined) => void;
  onCamera: (camera: Camera, grid_m: number | undefined) => void;
  onFailure: (reason: string | undefined) => void;
  /** The officer took the camera into her own hands. */
  onRelease: () => void;
  /** A place was pressed while measuring. */
  onMeasure: (place: LonLat) => void;
  /** A place was pressed where no drone and no pad is. */
  onGround: (place: LonLat) => void;
};

const FIT_ZOOM = 20.3;
const SITE_FIT_ZOOM = 15.5;
const FLIGHT_MS = 700;
const MAX_PITCH = 75;
/** How a place is looked at aslant: far enough over to see heights, not so far that streets close. */
const PITCH = 52;
const BEARING = -38;
/** With the place around it, a proof is not looked at from nearer than this. */
const PLACE_FIT_ZOOM = 18.6;
const SETTLING_MS = 500;
/** Between two frames of a drone that is followed: about what lies between two of its positions. */
const FOLLOW_MS = 250;
const FOLLOW_ZOOM = 15;
const REACH = 11;
/** A broadcast claim further away than this is not fitted into the picture: the rest would be lost in it. */
const FITTED_MM = 400_000;
const TOPICS: readonly Topic[] = ["tracks", "estimates"];

/** The map: MapLibre, fed straight from the live store, apart from React. Camera and pointer; `picture` draws. */
export class MapController {
  private readonly map: MapLibre;
  private readonly picture: Picture;
  private readonly ends: (() => void)[] = [];
  private loaded = false;
  /** A part of the map could not be loaded. */
  private partial = false;
  private selection: Selection = {};
  private fitted = false;
  /** The address says where to look: nothing else decides it. */
  private addressed: boolean;
  private deep: boolean;
  private flight: { since_ms: number; again: () => void } | undefined;
  private wanted = false;
  private followed: string | undefined;
  private measuring: readonly LonLat[] | undefined;

  constructor(
    container: HTMLElement,
    private readonly store: LiveStore,
    private fleet: Fleet,
    private readonly events: MapEvents,
    private readonly calm: boolean,
    camera: Camera | undefined,
  ) {
    this.fitted = this.addressed = camera !== undefined;
    this.deep = (camera?.pitch ?? 0) > 0;
    const [pad] = store.pads.values();
    this.map = new MapLibre({
      container,
      style: style(palette(MAP_COLOURS)),
      center: camera !== undefined ? [camera.lon, camera.lat] : pad === undefined ? [15, 55] : lonLat(pad),
      zoom: camera?.zoom ?? (pad === undefined ? 3.2 : 13),
      minZoom: 1.5,
      maxZoom: 22.5,
      attributionControl: false,
      bearing: camera?.bearing ?? 0,
      pitch: camera?.pitch ?? 0,
      maxPitch: MAX_PITCH,
      fadeDuration: 0,
      renderWorldCopies: true,
      locale: { "Map.Title": t("mapTitle") },
    });
    this.picture = new Picture(this.map, store, fleet, calm);
    // Not its "load": that waits for the base map, without which drones can be seen, too.
    void this.map.once("style.load", () => this.onLoad());
    this.map.on("moveend", () => this.onMoved());
    for (const name of ["pitch", "rotate"] as const) this.map.on(name, () => this.picture.tilt(this.isTilted));
    for (const name of ["dragstart", "wheel", "touchstart"] as const) {
      this.map.on(name, () => {
        this.flight = undefined;
      });
    }
    this.map.on("dragstart", () => this.release());
    this.map.on("click", (event) => this.onClick(event));
    this.map.on("error", ({ error }) => {
      this.partial = true;
      this.events.onFailure(t("mapPart", { why: error.message }));
    });
    this.map.on("mousemove", (event) => this.onPointer(event));
    this.map.on("mouseout", () => this.picture.hover(undefined));
    this.surviveLoss(container);
  }

  destroy(): void {
    for (const end of this.ends) end();
    this.picture.remove();
    this.map.remove();
  }

  /** After the theme has changed. */
  retheme(): void {
    if (this.loaded) this.picture.retheme();
  }

  setFleet(fleet: Fleet): void {
    this.fleet = fleet;
    if (!this.loaded) return;
    this.picture.review(fleet);
    if (!this.fitted && this.store.pads.size > 0) {
      if (this.selection.uav_id === undefined) this.fitAll(true);
      else this.fitSelection(true);
    }
  }

  setOverlays(overlays: readonly Overlay[]): void {
    this.picture.setOverlays(overlays);
  }

  describe(base: BaseMap): void {
    this.picture.describe(base);
    // It is another ground now.
    if (this.partial) this.events.onFailure(undefined);
    this.partial = false;
    if (this.isDeep === this.wantsDepth || this.addressed) return;
    // Buildings have come, or gone, and nobody has taken the camera yet.
    if (this.fitted && this.loaded) this.fitAgain();
  }

  /** Whether the camera is to look at the place aslant, where there are buildings to see. */
  setDeep(deep: boolean, still = false): void {
    if (deep === this.deep) return;
    this.deep = deep;
    if (this.loaded && !still) this.map.easeTo({ ...this.slant(), ...this.motion(FLIGHT_MS) });
  }

  get isTilted(): boolean {
    return this.map.getPitch() > 0.5 || Math.abs(this.map.getBearing()) > 0.5;
  }

  /** The camera turns by so many degrees, clockwise; undefined: back to north. */
  turn(by: number | undefined): void {
    this.map.easeTo({ bearing: by === undefined ? 0 : this.map.getBearing() + by, ...this.motion(250) });
  }

  private get wantsDepth(): boolean {
    return this.deep && this.picture.place.hasVolumes;
  }

  private get isDeep(): boolean {
    return this.map.getPitch() > 0.5;
  }

  private slant(): { pitch: number; bearing: number } {
    return this.wantsDepth ? { pitch: PITCH, bearing: BEARING } : { pitch: 0, bearing: 0 };
  }

  private fitAgain(): void {
    if (this.flight !== undefined) this.flight.again();
    else if (this.selection.uav_id === undefined) this.fitAll(true);
    else this.fitSelection(true);
  }

  setPadding(padding: PaddingOptions): void {
    this.map.setPadding(padding);
    // A panel that opened after the flight began has stopped it: fly on, to where there is room now.
    if (this.flight !== undefined && performance.now() - this.flight.since_ms < FLIGHT_MS + SETTLING_MS) this.flight.again();
    else if (this.loaded && !this.fitted) this.fitAll(true);
  }

  select(selection: Selection): void {
    this.selection = selection;
    this.picture.select(selection);
  }

  /** Keeps the camera on a drone, or no longer. */
  follow(uav_id: string | undefined): void {
    this.followed = uav_id;
    if (uav_id === undefined || !this.loaded) return;
    this.flight = undefined;
    this.fitted = true;
    const track = this.store.tracks.get(uav_id);
    if (track !== undefined) this.map.easeTo({ center: lonLat(track), zoom: Math.max(this.map.getZoom(), FOLLOW_ZOOM), ...this.motion(FLIGHT_MS) });
  }

  /** Shows these places as a measure, and takes presses for more of them; undefined ends it. */
  measure(points: readonly LonLat[] | undefined): void {
    this.measuring = points;
    this.picture.measure(points ?? []);
    this.map.getCanvas().style.cursor = points === undefined ? "" : "crosshair";
    if (points === undefined) this.map.doubleClickZoom.enable();
    else this.map.doubleClickZoom.disable();
  }

  /** The keys of the map go to the map: arrows move it. */
  focus(): void {
    this.map.getCanvas().focus();
  }

  centre(): LonLat {
    const { lng, lat } = this.map.getCenter();
    return [lng, lat];
  }

  /** What the map shows, as [west, south, east, north] in degrees. */
  bounds(): readonly [number, number, number, number] {
    const shown = this.map.getBounds();
    return [shown.getWest(), shown.getSouth(), shown.getEast(), shown.getNorth()];
  }

  /** Closer or further, about who is selected if he is in sight: he stays there. */
  zoomBy(levels: number): void {
    const around = this.selectedPlace();
    this.map.easeTo({ zoom: this.map.getZoom() + levels, ...(around !== undefined && { around }), ...this.motion(200) });
  }

  private selectedPlace(): LonLat | undefined {
    const { places } = this.placesOf(this.fleet.find(this.selection.uav_id));
    const shown = this.map.getBounds();
    return places.filter((place) => shown.contains(place)).at(-1);
  }

  /** All pads and all drones that are near one. */
  fitAll(still = false): void {
    const places: LonLat[] = [...this.store.pads.values()].filter(({ status }) => status !== "retired").map((pad) => lonLat(pad));
    if (places.length === 0) return;
    this.release();
    this.fitted = true;
    this.fit(places, SITE_FIT_ZOOM, still, 100);
  }

  fitPad(pad_id: string): void {
    const pad = this.store.pads.get(pad_id);
    if (pad === undefined) return;
    this.release();
    this.fitted = true;
    const reach_mm = pad.commissioning?.max_range_mm ?? 50_000;
    const frame = frameOf(pad);
    const corners = [-1, 1].map((side) => toGlobe(frame, { east_mm: side * reach_mm, north_mm: side * reach_mm }));
    this.fit(corners, FIT_ZOOM, false, 24);
  }

  /** The pad, the claim and the measurement of what is selected; else where the drone is. */
  fitSelection(still = false): void {
    if (!this.loaded) {
      this.wanted = true;
      return;
    }
    const drone = this.fleet.find(this.selection.uav_id);
    const { places, padded } = this.placesOf(drone);
    if (places.length === 0) return;
    this.fitted = true;
    if (places.length === 1 && !padded) {
      const [centre] = places;
      if (centre !== undefined) {
        this.map.easeTo({ center: centre, zoom: Math.max(this.map.getZoom(), 14.5), ...this.motion(still ? 0 : FLIGHT_MS) });
      }
      return;
    }
    this.fit(places, FIT_ZOOM, still);
  }

  /** Where an address says; the map goes there at once, as the page would have opened there. */
  lookAt(camera: Camera): void {
    this.fitted = true;
    this.flight = undefined;
    this.map.jumpTo({ center: [camera.lon, camera.lat], zoom: camera.zoom, bearing: camera.bearing ?? 0, pitch: camera.pitch ?? 0 });
  }

  private placesOf(drone: Drone | undefined): { places: LonLat[]; padded: boolean } {
    const own = drone?.verdict?.session_id === drone?.session?.session_id ? drone?.verdict : undefined;
    const verdict = this.selection.verdict ?? own;
    const pad = this.store.pads.get(verdict?.pad_id ?? drone?.session?.pad_id ?? "");
    const places: LonLat[] = [];
    if (pad !== undefined) {
      places.push(lonLat(pad));
      const frame = frameOf(pad);
      const local = [
        verdict?.signed?.claim,
        verdict?.estimate,
        verdict !== undefined && broadcastApart(verdict) !== undefined ? verdict.broadcast?.claim : undefined,
        verdict === undefined ? drone?.estimate : undefined,
      ];
      for (const place of local) {
        if (place !== undefined && Math.hypot(place.east_mm, place.north_mm) < FITTED_MM) places.push(toGlobe(frame, place));
      }
    }
    if (places.length < 2 && drone?.track !== undefined) {
      if (pad === undefined || distance_mm(drone.track, pad) < FITTED_MM) places.push(lonLat(drone.track));
    }
    return { places, padded: pad !== undefined };
  }

  private fit(places: readonly LonLat[], maxZoom: number, still: boolean, margin = 64): void {
    const bounds = new LngLatBounds();
    for (const place of places) bounds.extend(place);
    const { clientWidth, clientHeight } = this.map.getCanvas();
    // A phone has no room for generous margins.
    const padding = Math.min(margin, Math.min(clientWidth, clientHeight) / 8);
    this.flight = { since_ms: performance.now(), again: () => this.fit(places, maxZoom, still, margin) };
    // In a window that has just become small the panels are still as wide as they were: their padding comes in a moment.
    const { left = 0, right = 0, top = 0, bottom = 0 } = this.map.getPadding();
    if (left + right + 2 * padding >= clientWidth || top + bottom + 2 * padding >= clientHeight) return;
    const slant = this.slant();
    const most = this.picture.place.isShown ? Math.min(maxZoom, PLACE_FIT_ZOOM) : maxZoom;
    const room = { width: clientWidth - left - right - 2 * padding, height: clientHeight - top - bottom - 2 * padding };
    const camera = slant.pitch > 0 ? slantedCamera(places, slant, room, most) : this.map.cameraForBounds(bounds, { padding, maxZoom: most });
    if (camera === undefined) return;
    this.map.easeTo({ ...camera, ...slant, ...this.motion(still ? 0 : FLIGHT_MS) });
  }

  private motion(duration: number): { duration: number; essential: boolean } {
    return { duration: this.calm ? 0 : duration, essential: false };
  }

  private release(): void {
    if (this.followed === undefined) return;
    this.followed = undefined;
    this.events.onRelease();
  }

  private onLoad(): void {
    this.loaded = true;
    this.picture.load();
    this.picture.tilt(this.isTilted);
    this.ends.push(
      this.store.subscribe(TOPICS, () => {
        this.picture.tick();
        this.keepUp();
      }),
    );
    this.setFleet(this.fleet);
    if (this.measuring !== undefined) this.picture.measure(this.measuring);
    if (this.wanted) this.fitSelection(true);
    this.tellCamera();
  }

  private keepUp(): void {
    if (this.followed === undefined || this.map.isZooming()) return;
    const track = this.store.tracks.get(this.followed);
    if (track !== undefined) this.map.easeTo({ center: lonLat(track), easing: (share) => share, ...this.motion(FOLLOW_MS) });
  }

  /** A graphics driver may start anew at any time; MapLibre makes its style again, and the picture what was added. */
  private surviveLoss(container: HTMLElement): void {
    const lost = (): void => {
      this.picture.unload();
      this.events.onFailure(t("graphicsLost"));
    };
    // On the way down, before MapLibre hears of it.
    container.addEventListener("webglcontextlost", lost, true);
    this.ends.push(() => container.removeEventListener("webglcontextlost", lost, true));
    this.map.on("webglcontextrestored", () => {
      void this.map.once("idle", () => {
        this.picture.load();
        if (this.measuring !== undefined) this.picture.measure(this.measuring);
        this.events.onFailure(undefined);
      });
      this.map.triggerRepaint();
    });
  }

  private onMoved(): void {
    this.tellCamera();
    if (this.loaded) this.picture.moved();
  }

  private tellCamera(): void {
    const { lat, lng } = this.map.getCenter();
    const zoom = this.map.getZoom();
    const [bearing, pitch] = [this.map.getBearing(), this.map.getPitch()];
    this.events.onCamera({ lat, lon: lng, zoom, ...(this.isTilted && { bearing, pitch }) }, !this.picture.hasGrid ? undefined : gridSpacing_m(zoom, lat));
  }

  private droneUnder({ point }: MapMouseEvent): string | undefined {
    if (!this.loaded || this.map.getZoom() < SITE_ZOOM) return undefined;
    const { tracks } = this.store;
    const { looks, judged, heard } = this.fleet;
    const shown = Uint32Array.from([...heard, ...judged.flatMap(({ uav_id }) => tracks.slot(uav_id) ?? [])].filter((slot) => looks[slot] !== HIDDEN));
    const slot = slotAt(viewOf(this.map), { x: tracks.x, y: tracks.y, up_m: (each) => upOf(this.store, each) }, shown, point.x, point.y, REACH);
    return slot === undefined ? undefined : tracks.nameAt(slot);
  }

  private siteUnder({ point }: MapMouseEvent): LngLatBounds | undefined {
    if (!this.loaded || this.map.getZoom() >= SITE_ZOOM) return undefined;
    const reach = 8;
    const [found] = this.map.queryRenderedFeatures(
      [
        [point.x - reach, point.y - reach],
        [point.x + reach, point.y + reach],
      ],
      { layers: ["sites"] },
    );
    const { bounds } = (found?.properties ?? {}) as { bounds?: string };
    const [west = 0, south = 0, east = 0, north = 0] = (bounds ?? "").split(" ").map(Number);
    return bounds === undefined ? undefined : new LngLatBounds([west, south], [east, north]);
  }

  private onPointer(event: MapMouseEvent): void {
    if (this.measuring !== undefined) return;
    const drone = this.droneUnder(event);
    this.picture.hover(drone);
    this.map.getCanvas().style.cursor = drone !== undefined || this.siteUnder(event) !== undefined ? "pointer" : "";
  }

  private onClick(event: MapMouseEvent): void {
    if (this.measuring !== undefined) {
      this.events.onMeasure(placeAt(viewOf(this.map), event.point.x, event.point.y));
      return;
    }
    const site = this.siteUnder(event);
    if (site !== undefined) this.fit([site.getSouthWest().toArray(), site.getNorthEast().toArray()], SITE_FIT_ZOOM, false);
    else {
      const uav_id = this.droneUnder(event);
      this.events.onSelect(uav_id);
      if (uav_id === undefined) this.events.onGround(placeAt(viewOf(this.map), event.point.x, event.point.y));
    }
  }
}
