import { LngLatBounds, Map as MapLibre, setWorkerUrl, type MapMouseEvent } from "maplibre-gl";
import workerUrl from "maplibre-gl/dist/maplibre-gl-worker.mjs?url";
import type { Camera } from "../shared/address/location";
import type { Pad } from "../shared/api/records";
import type { Fleet } from "../shared/fleet";
import { frameOf, lonLat, toGlobe, type LonLat } from "../shared/geo/frame";
import type { LiveStore, Topic } from "../shared/live/store";
import { mapTexts as t } from "./texts";
import { gridSpacing_m } from "./features";
import { Failures, type Failing } from "./failures";
import { Following } from "./following";
import { BEARING, bestBearing, dronesNear, freeRoom, inSight, PITCH, placesOf, sideOn } from "./framing";
import { palette } from "./icons";
import { surviveLoss } from "./losses";
import { copyForPrint } from "./printing";
import type { Overlay } from "./overlays";
import { Picture, type Selection } from "./picture";
import type { BaseMap } from "./place";
import { droneAt, siteAt } from "./pointing";
import { MAP_COLOURS, style } from "./style";
import { placeAt, slantedCamera, viewOf, type Room, type Seen } from "./view";

setWorkerUrl(workerUrl);

export type MapEvents = {
  onSelect: (uav_id: string | undefined) => void;
  onCamera: (camera: Camera, grid_m: number | undefined) => void;
  onFailure: (reason: string | undefined) => void;
  /** What of the map could not be loaded; nothing once it could. */
  onFailing: (failing: readonly Failing[]) => void;
  /** Something could not be loaded: there may be another archive. */
  onLookAgain: () => void;
  /** The officer took the camera into her own hands. */
  onRelease: () => void;
  /** A place was pressed while measuring. */
  onMeasure: (place: LonLat) => void;
  /** A place was pressed where no drone and no pad is. */
  onGround: (place: LonLat) => void;
};

const FIT_ZOOM = 21;
const SITE_FIT_ZOOM = 15.5;
const FLIGHT_MS = 700;
const MAX_PITCH = 75;
/** Pads of a place aslant are looked at from as near as this. */
const SLANTED_SITE_ZOOM = 16.6;
/** A proof fills about half of what is free of the map. */
const PROOF_SHARE = 0.55;
const SETTLING_MS = 500;
const GROWING_MS = 1_500;
/** What is known of a drone comes in pieces. */
const PROOF_COMES_MS = 10_000;
const TOPICS: readonly Topic[] = ["tracks", "estimates"];

/** `share`: how much of the free map the places fill at most; else all but a margin. */
type Fit = { most: number; still?: boolean; margin?: number; share?: number; overview?: boolean; duration?: number };

/** The map: MapLibre, fed straight from the live store, apart from React. Camera and pointer; `picture` draws. */
export class MapController {
  private readonly map: MapLibre;
  private readonly picture: Picture;
  private readonly ends: (() => void)[] = [];
  private loaded = false;
  private selection: Selection = {};
  private fitted = false;
  /** The address says where to look: nothing else decides it. */
  private addressed: boolean;
  private deep: boolean;
  private bearing = BEARING;
  /** The last move of the camera that was ours, until somebody takes the camera; `overview`: of all there is; `thin`: of a drone whose proof is not known yet. */
  private flight: { since_ms: number; again: () => void; overview: boolean; thin?: boolean } | undefined;
  /** Where drones have been that left the first view. */
  private wider: Seen[] = [];
  private wanted = false;
  private readonly following: Following;
  private readonly failures: Failures;
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
    this.map.on("moveend", (event: object) => this.onMoved("passing" in event));
    for (const name of ["pitch", "rotate"] as const) this.map.on(name, () => this.picture.tilt(this.isTilted));
    for (const name of ["dragstart", "wheel", "touchstart", "movestart"] as const) {
      this.map.on(name, (event: { originalEvent?: unknown }) => {
        if (event.originalEvent !== undefined) this.flight = undefined;
      });
    }
    this.map.on("dragstart", () => this.release());
    this.map.on("click", (event) => this.onClick(event));
    this.following = new Following(this.map, store, calm);
    this.failures = new Failures(this.map, (failing) => events.onFailing(failing), events.onLookAgain);
    this.map.on("mousemove", (event) => this.onPointer(event));
    this.map.on("mouseout", () => this.picture.hover(undefined));
    this.ends.push(surviveLoss(this.map, container, { onLost: () => this.onLost(), onBack: () => this.onBack() }), copyForPrint(this.map, () => this.retheme()));
  }

  destroy(): void {
    for (const end of this.ends) end();
    this.following.stop();
    this.failures.remove();
    this.picture.remove();
    this.map.remove();
  }

  /** After the theme has changed. */
  retheme(): void {
    if (this.loaded) this.picture.retheme();
  }

  setFleet(fleet: Fleet): void {
    const first = this.fleet.counts.all === 0 && fleet.counts.all > 0;
    this.fleet = fleet;
    if (!this.loaded) return;
    this.picture.review(fleet);
    if (first && this.flight?.since_ms === Infinity) this.fitAgain();
    else this.keepFitting();
    if (this.flight?.thin === true && performance.now() - this.flight.since_ms < PROOF_COMES_MS && placesOf(fleet.find(this.selection.uav_id), this.selection, this.store).padded) this.fitSelection();
    if (!this.fitted && this.store.pads.size > 0) {
      if (this.selection.uav_id === undefined) this.fitAll(true);
      else this.fitSelection(true);
    }
  }

  /** Aerial images over the drawn ground. */
  showImagery(shown: boolean): void {
    this.picture.showImagery(shown);
  }

  setOverlays(overlays: readonly Overlay[]): void {
    this.picture.setOverlays(overlays);
  }

  /** `elsewhere`: what an archive draws is nowhere near. */
  describe(base: BaseMap, elsewhere: boolean): void {
    this.picture.describe(base, elsewhere);
    // It is another ground now.
    this.failures.forget();
    if (this.isDeep === this.wantsDepth || this.addressed) return;
    // Buildings have come, or gone, and nobody has taken the camera yet.
    if (this.fitted && this.loaded && this.flight !== undefined) this.fitAgain();
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
    this.flight = undefined;
    this.map.easeTo({ bearing: by === undefined ? 0 : this.map.getBearing() + by, ...this.motion(250) });
  }

  private get wantsDepth(): boolean {
    return this.deep && this.picture.hasVolumes;
  }

  private get isDeep(): boolean {
    return this.map.getPitch() > 0.5;
  }

  private slant(): { pitch: number; bearing: number } {
    return this.wantsDepth ? { pitch: PITCH, bearing: this.bearing } : { pitch: 0, bearing: 0 };
  }

  private fitAgain(): void {
    if (this.flight !== undefined && this.flight.since_ms !== Infinity) this.flight.again();
    else if (this.selection.uav_id === undefined) this.fitAll(true);
    else this.fitSelection(true);
  }

  setPadding({ top, right, bottom, left }: Record<"top" | "right" | "bottom" | "left", number>, room = 0): void {
    this.map.setPadding({ top, right, bottom, left });
    this.picture.room = room;
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
    if (uav_id === undefined) {
      this.following.stop();
      return;
    }
    this.flight = undefined;
    this.fitted = true;
    this.following.start(uav_id);
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
    this.flight = undefined;
    const around = this.selectedPlace();
    this.map.easeTo({ zoom: this.map.getZoom() + levels, ...(around !== undefined && { around }), ...this.motion(200) });
  }

  private selectedPlace(): LonLat | undefined {
    const { places } = placesOf(this.fleet.find(this.selection.uav_id), this.selection, this.store);
    const shown = this.map.getBounds();
    return places.filter(({ at }) => shown.contains(at)).at(-1)?.at;
  }

  /** All pads and all drones that are near one. */
  fitAll(still = false): void {
    if (this.pads().length === 0) return;
    this.release();
    this.fitted = true;
    this.wider = [];
    if (this.wantsDepth) this.bearing = bestBearing(this.overview(), this.room(0), SLANTED_SITE_ZOOM);
    this.fitOverview(still);
  }

  private pads(): Pad[] {
    return [...this.store.pads.values()].filter(({ status }) => status !== "retired");
  }

  private overview(): Seen[] {
    const pads = this.pads();
    return [...pads.map((pad) => ({ at: lonLat(pad) })), ...dronesNear(pads, this.store, this.fleet), ...this.wider];
  }

  private fitOverview(still: boolean, duration = FLIGHT_MS): void {
    const deep = this.wantsDepth;
    this.fit(this.overview(), { most: deep ? SLANTED_SITE_ZOOM : SITE_FIT_ZOOM, still, margin: deep ? 16 : 60, overview: true, duration });
  }

  /** Until somebody takes the camera, the first view grows with what flies out of it. */
  private keepFitting(): void {
    if (this.flight?.since_ms !== Infinity || !this.flight.overview || this.map.isMoving()) return;
    const out = dronesNear(this.pads(), this.store, this.fleet).filter((each) => !inSight(this.map, [each]));
    if (out.length === 0) return;
    this.wider.push(...out);
    this.fitOverview(true, GROWING_MS);
  }

  /** What is free of the screen, less a margin. */
  private room(margin: number): Room {
    return freeRoom(this.map, margin);
  }

  fitPad(pad_id: string): void {
    const pad = this.store.pads.get(pad_id);
    if (pad === undefined) return;
    this.release();
    this.fitted = true;
    const reach_mm = pad.commissioning?.max_range_mm ?? 50_000;
    const frame = frameOf(pad);
    const corners = [-1, 1].map((side) => toGlobe(frame, { east_mm: side * reach_mm, north_mm: side * reach_mm }));
    this.fit(corners.map((at) => ({ at })), { most: FIT_ZOOM, margin: 24 });
  }

  /** The pad, the claim and the measurement of what is selected; else where the drone is. */
  fitSelection(still = false): void {
    if (!this.loaded) {
      this.wanted = true;
      return;
    }
    const drone = this.fleet.find(this.selection.uav_id);
    const { places, padded, lie } = placesOf(drone, this.selection, this.store);
    if (places.length === 0) return;
    this.fitted = true;
    if (places.length === 1 && !padded) {
      const centre = places[0]?.at;
      // Its proof may be on the way.
      this.flight = { since_ms: performance.now(), again: () => this.fitSelection(), overview: false, thin: true };
      if (centre !== undefined) {
        this.map.easeTo({ center: centre, zoom: Math.max(this.map.getZoom(), 14.5), ...this.motion(still ? 0 : FLIGHT_MS) });
      }
      return;
    }
    if (lie !== undefined) this.bearing = sideOn(lie, this.bearing);
    this.fit(places, { most: FIT_ZOOM, still, share: PROOF_SHARE });
  }

  /** Where an address says; the map goes there at once, as the page would have opened there. */
  lookAt(camera: Camera): void {
    this.fitted = true;
    this.flight = undefined;
    this.map.jumpTo({ center: [camera.lon, camera.lat], zoom: camera.zoom, bearing: camera.bearing ?? 0, pitch: camera.pitch ?? 0 });
  }

  private fit(places: readonly Seen[], how: Fit): void {
    const { most, still = false, margin = 64, share = 1, overview = false, duration = still ? 0 : FLIGHT_MS } = how;
    const { clientWidth, clientHeight } = this.map.getCanvas();
    // A phone has no room for generous margins.
    const narrow = Math.min(margin, Math.min(clientWidth, clientHeight) / 8);
    // The first view goes on fitting until somebody takes the camera: panels come when they have something to show.
    this.flight = { since_ms: still ? Infinity : performance.now(), again: () => this.fit(places, { ...how, duration: still ? 0 : FLIGHT_MS }), overview };
    const free = this.room(share < 1 ? 0 : narrow);
    // In a window that has just become small the panels are still as wide as they were: their padding comes in a moment.
    if (free.width <= 0 || free.height <= 0) return;
    const room = { ...free, width: free.width * share, height: free.height * share };
    const [across, down] = share < 1 ? [(free.width - room.width) / 2, (free.height - room.height) / 2] : [narrow, narrow];
    const slant = this.slant();
    const bounds = new LngLatBounds();
    for (const { at } of places) bounds.extend(at);
    const camera = slant.pitch > 0 ? slantedCamera(places, slant, room, most) : this.map.cameraForBounds(bounds, { padding: { left: across, right: across, top: down, bottom: down }, maxZoom: most });
    if (camera === undefined) return;
    this.map.easeTo({ ...camera, ...slant, ...this.motion(duration) });
  }

  private motion(duration: number): { duration: number; essential: boolean } {
    return { duration: this.calm ? 0 : duration, essential: false };
  }

  private release(): void {
    if (!this.following.isOn) return;
    this.following.stop();
    this.events.onRelease();
  }

  private onLoad(): void {
    this.loaded = true;
    this.picture.load();
    this.picture.tilt(this.isTilted);
    this.ends.push(
      this.store.subscribe(TOPICS, () => {
        this.picture.tick();
        this.following.tick();
      }),
    );
    this.setFleet(this.fleet);
    if (this.measuring !== undefined) this.picture.measure(this.measuring);
    if (this.wanted) this.fitSelection(true);
    this.tellCamera();
  }

  private onLost(): void {
    this.picture.unload();
    this.events.onFailure(t("graphicsLost"));
  }

  private onBack(): void {
    this.picture.load();
    if (this.measuring !== undefined) this.picture.measure(this.measuring);
    this.events.onFailure(undefined);
  }

  private onMoved(passing: boolean): void {
    this.tellCamera();
    if (this.loaded && !passing) this.picture.moved();
  }

  private tellCamera(): void {
    const { lat, lng } = this.map.getCenter();
    const zoom = this.map.getZoom();
    const [bearing, pitch] = [this.map.getBearing(), this.map.getPitch()];
    this.events.onCamera({ lat, lon: lng, zoom, ...(this.isTilted && { bearing, pitch }) }, !this.picture.hasGrid ? undefined : gridSpacing_m(zoom, lat));
  }

  private droneUnder({ point }: MapMouseEvent): string | undefined {
    return this.loaded ? droneAt(this.map, this.store, this.fleet, point) : undefined;
  }

  private siteUnder({ point }: MapMouseEvent): LngLatBounds | undefined {
    return this.loaded ? siteAt(this.map, point) : undefined;
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
    if (site !== undefined) this.fit([{ at: site.getSouthWest().toArray() }, { at: site.getNorthEast().toArray() }], { most: SITE_FIT_ZOOM });
    else {
      const uav_id = this.droneUnder(event);
      this.events.onSelect(uav_id);
      if (uav_id === undefined) this.events.onGround(placeAt(viewOf(this.map), event.point.x, event.point.y));
    }
  }
}
