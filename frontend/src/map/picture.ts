import type { GeoJSONSource, Map as MapLibre } from "maplibre-gl";
import type { Pad, Track, VerdictSummary } from "../shared/api/records";
import type { Drone } from "../shared/drones";
import type { Fleet } from "../shared/fleet";
import { distance_mm, type LonLat } from "../shared/geo/frame";
import { reading } from "../shared/i18n/locale";
import type { LiveStore } from "../shared/live/store";
import { baseLayers } from "./baseLayers";
import { clusters } from "./clusters";
import { Air } from "./air";
import { CROWD, DroneLayer, type Marked } from "./droneLayer";
import { accuracyFeatures, evidenceFeatures, gridFeatures, gridSpacing_m, measureFeatures, padFeatures, siteFeatures, trailFeatures } from "./features";
import { addIcons, palette } from "./icons";
import { Labels, type Words } from "./labels";
import { droneWords, evidenceWords, measureWords, padWords, siteWords, takeMarks } from "./mapWords";
import type { Overlay } from "./overlays";
import { PlaceOnMap, type BaseMap } from "./place";
import { placeNames } from "./placeNames";
import type { Occupied } from "./placing";
import { CLOSE_ZOOM, FINE_ZOOM, PLACE_FADES, SITE_ZOOM } from "./scales";
import { BASE_FILES, EMPTY, MAP_COLOURS, OVERLAYS_BELOW, paints } from "./style";
import { viewOf, type View } from "./view";

export type Selection = { uav_id?: string; verdict?: VerdictSummary };

const GRID_REACH_MM = 50_000_000;
/** Buildings within this step back from who is selected; again only when he has flown on by 0.001°, since that cuts all tiles anew. */
const STAGE_M = 130;
const STAGE_E7 = 10_000;
/** Over a place the metre grid is for the pad's own scale. */
const GRID_ZOOM = 17;
/** With more drones than this, those that nobody proved have no trail: the map would be a tangle. */
const CROWDED = 150;
/** Names follow a crowd this late. */
const CROWD_WORDS_MS = 400;
/** What MapLibre finds room for is asked for so often while the camera moves. */
const NAMES_MS = 500;

/** What is on the map: sources of MapLibre for the few that are more than a symbol, a layer of our own for the many. */
export class Picture {
  private readonly labels: Labels;
  private readonly marked: Marked = { selected: undefined, hovered: undefined };
  private readonly layer: DroneLayer;
  private readonly air: Air;
  private evidence: GeoJSON.Feature[] = [];
  private trails: GeoJSON.Feature[] = [];
  private tilted = false;
  private loaded = false;
  private namesAt_ms = -Infinity;
  private wordsDue: ReturnType<typeof setTimeout> | undefined;
  private recolourIcons: ((colours: ReturnType<typeof palette>) => void) | undefined;
  private selection: Selection = {};
  private drawn = new Map<string, { key: string; features: GeoJSON.Feature[] }>();
  private shownSources = new Map<string, boolean>();
  private words = new Map<string, readonly Words[]>();
  private overlays: readonly Overlay[] = [];
  /** So much of the map's padding is beside the panels. */
  room = 0;
  private elsewhere = false;
  private readonly baseLoaded = new Set<string>();
  readonly place: PlaceOnMap;

  constructor(
    private readonly map: MapLibre,
    private readonly store: LiveStore,
    private fleet: Fleet,
    calm: boolean,
  ) {
    this.place = new PlaceOnMap(map, location.origin);
    this.air = new Air(map.getCanvasContainer());
    this.air.recolour(palette(MAP_COLOURS));
    this.layer = new DroneLayer(map, store, fleet, this.marked, calm);
    this.labels = new Labels(map.getCanvasContainer());
    this.labels.recolour(palette(MAP_COLOURS));
    map.on("render", () => this.writeWords());
    map.on("idle", () => {
      this.namesAt_ms = -Infinity;
      this.writeWords();
    });
  }

  /** Everything that the style does not bring along: after it has loaded, and again after the graphics were lost. */
  load(): void {
    this.loaded = true;
    this.recolourIcons = addIcons(this.map, palette(MAP_COLOURS));
    this.drawn = new Map();
    this.shownSources = new Map();
    this.baseLoaded.clear();
    this.place.load(palette(MAP_COLOURS));
    this.addOverlays();
    this.joinSea();
    this.review(this.fleet);
  }

  /** While the map's graphics are gone there is nothing to give features to. */
  unload(): void {
    this.loaded = false;
  }

  remove(): void {
    clearTimeout(this.wordsDue);
    this.place.remove();
    this.air.remove();
    this.layer.remove();
    this.labels.remove();
  }

  retheme(): void {
    const colours = palette(MAP_COLOURS);
    this.recolourIcons?.(colours);
    this.labels.recolour(colours);
    this.air.recolour(colours);
    this.layer.retheme();
    this.place.retheme(colours);
    for (const { id, paint } of [...paints(colours, this.isPlaced), ...this.overlays.flatMap((each) => each.layers(colours)).map(({ id, paint }) => ({ id, paint: { ...paint } }))]) {
      for (const [name, value] of Object.entries(paint)) this.map.setPaintProperty(id, name as never, value as never);
    }
  }

  /** What the ground is drawn from; `elsewhere`: where the pads are, that is nothing but coasts and borders. */
  describe(base: BaseMap, elsewhere: boolean): void {
    this.elsewhere = elsewhere;
    this.place.describe(base, palette(MAP_COLOURS));
    this.joinSea();
  }

  /** Around the place, the sea is its sea. */
  private joinSea(): void {
    if (!this.loaded) return;
    for (const layer of baseLayers(palette(MAP_COLOURS), this.isPlaced)) {
      if (layer.id === "sea") this.map.setPaintProperty(layer.id, "background-color", layer.paint?.["background-color" as never]);
      if (layer.id === "land-fine") this.map.setLayerZoomRange(layer.id, layer.minzoom ?? 0, layer.maxzoom ?? 24);
    }
    this.loadBaseMap();
  }

  showImagery(shown: boolean): void {
    this.place.showImagery(shown, palette(MAP_COLOURS));
  }

  /** Layers of others, under the pads; those that are gone leave the map. */
  setOverlays(overlays: readonly Overlay[]): void {
    const kept = new Set(overlays.map(({ id }) => id));
    for (const { id, layers } of this.overlays) {
      if (kept.has(id) || this.map.getSource(id) === undefined) continue;
      for (const layer of layers(palette(MAP_COLOURS))) this.map.removeLayer(layer.id);
      this.map.removeSource(id);
      this.drawn.delete(id);
    }
    this.overlays = overlays;
    if (this.loaded) this.addOverlays();
  }

  /** Looks again at who is what, and draws what changed. */
  review(fleet: Fleet): void {
    this.fleet = fleet;
    if (!this.loaded) return;
    const { selection, store } = this;
    const chosen = fleet.find(selection.uav_id);
    const trailing: (Drone | undefined)[] = [...fleet.judged, ...(chosen?.group === "other" ? [chosen] : [])];
    if (fleet.counts.all <= CROWDED) {
      const rows = fleet.rows("all");
      for (let i = fleet.judged.length; i < rows.length; i++) trailing.push(rows.at(i));
    }
    const unique = new Map(trailing.flatMap((drone) => (drone === undefined ? [] : [[drone.uav_id, drone] as const])));
    this.trails = trailFeatures([...unique.values()], store.tracks, selection.uav_id);
    this.set("trails", this.tilted ? [] : this.trails);
    this.drawPads();
    this.drawClusters();
    this.tick();
  }

  /** New positions of those who were there at the last review. */
  tick(): void {
    if (!this.loaded) return;
    this.drawEvidence();
    this.marked.selected = this.store.tracks.slot(this.selection.uav_id ?? "");
    this.layer.refresh(this.fleet);
    this.wordsDue ??= setTimeout(() => this.writeWords(), this.fleet.counts.all > CROWD ? CROWD_WORDS_MS : 0);
  }

  select(selection: Selection): void {
    this.selection = selection;
    this.review(this.fleet);
  }

  /** Marks the drone under the pointer. */
  hover(uav_id: string | undefined): void {
    const slot = uav_id === undefined ? undefined : this.store.tracks.slot(uav_id);
    if (slot === this.marked.hovered) return;
    this.marked.hovered = slot;
    this.layer.refresh(this.fleet);
  }

  measure(points: readonly LonLat[]): void {
    if (!this.loaded) return;
    const features = measureFeatures(points);
    this.set("measure", features);
    this.words.set("measure", measureWords(features));
  }

  /** After the camera has come to rest. */
  moved(): void {
    if (!this.loaded) return;
    this.drawGrid();
    this.drawClusters();
    this.loadBaseMap();
  }

  gridPad(): Pad | undefined {
    const { lat, lng } = this.map.getCenter();
    const centre = { lat_e7: lat * 1e7, lon_e7: lng * 1e7 };
    let best: { pad: Pad; distance: number } | undefined;
    for (const pad of this.store.pads.values()) {
      const distance = distance_mm(pad, centre);
      if (distance < (best?.distance ?? GRID_REACH_MM)) best = { pad, distance };
    }
    return best?.pad;
  }

  /** Whether an archive draws the ground around the pads. */
  private get isPlaced(): boolean {
    return this.place.hasGround && !this.elsewhere;
  }

  /** Whether there are buildings around the pads that can rise. */
  get hasVolumes(): boolean {
    return this.place.hasVolumes && !this.elsewhere;
  }

  /** Whether a metre grid is drawn. */
  get hasGrid(): boolean {
    return this.gridPad() !== undefined && !(this.place.isShown && !this.elsewhere && (this.tilted || this.map.getZoom() < GRID_ZOOM));
  }

  private addOverlays(): void {
    for (const { id, layers, features } of this.overlays) {
      if (this.map.getSource(id) === undefined) {
        this.map.addSource(id, { type: "geojson", data: EMPTY, maxzoom: 20, tolerance: 0.2 });
        for (const layer of layers(palette(MAP_COLOURS))) this.map.addLayer(layer, OVERLAYS_BELOW);
      }
      this.set(id, features);
    }
  }

  private drawEvidence(): void {
    const { uav_id, verdict } = this.selection;
    const now_ms = this.store.serverNow_ms();
    const { tracks, estimates } = this.store;
    const judged = this.fleet.judged.map((drone) => {
      const track = tracks.get(drone.uav_id);
      const estimate = estimates.get(drone.uav_id);
      return { ...drone, ...(track !== undefined && { track }), ...(estimate !== undefined && { estimate }) };
    });
    const chosen = judged.find((drone) => drone.uav_id === uav_id) ?? this.fleet.find(uav_id);
    const features = [
      ...evidenceFeatures(judged, this.store.pads, uav_id, verdict, now_ms),
      ...accuracyFeatures([chosen, ...judged.filter((drone) => drone.group === "needs-you" && drone !== chosen).slice(0, 50)]),
    ];
    this.evidence = features;
    // While the camera is tilted it is drawn at its height (air.ts), and the city beneath need not be drawn again.
    this.set("evidence", this.tilted ? [] : features);
    this.words.set("evidence", evidenceWords(features));
    this.stepBack(chosen?.track);
  }

  /** Buildings do not hide who is looked at. */
  private stepBack(track: Track | undefined): void {
    if (!this.tilted) return;
    const round = (degrees_e7: number): number => Math.round(degrees_e7 / STAGE_E7) * (STAGE_E7 / 1e7);
    this.place.stepBack(track && { lat: round(track.lat_e7), lon: round(track.lon_e7), radius_m: STAGE_M });
  }

  /** After the camera was tilted, or no longer is. */
  tilt(tilted: boolean): void {
    if (this.tilted === tilted) return;
    this.tilted = tilted;
    this.place.raise(tilted);
    if (!this.loaded) return;
    // Volumes of others are for a camera that sees heights.
    for (const { id } of this.overlays) {
      const shown = this.shownSources.get(id);
      this.shownSources.delete(id);
      if (shown !== undefined) this.showLayers(id, shown);
    }
    this.review(this.fleet);
    this.drawGrid();
  }

  private drawPads(): void {
    const now_ms = this.store.serverNow_ms();
    const features = padFeatures(this.store.pads.values(), now_ms);
    if (!this.set("pads", features)) return;
    this.words.set("pads", padWords(features));
    this.drawGrid();
  }

  private drawClusters(): void {
    const zoom = this.map.getZoom();
    if (zoom >= SITE_ZOOM + 0.5) return;
    const features = siteFeatures(clusters(this.store.pads.values(), this.store.tracks, this.fleet, zoom));
    if (this.set("sites", features)) this.words.set("sites", siteWords(features));
  }

  /** Gives a source its features, unless it has them already; whether it had not. */
  private set(id: string, features: GeoJSON.Feature[]): boolean {
    const key = JSON.stringify(features);
    if (this.drawn.get(id)?.key === key) return false;
    this.drawn.set(id, { key, features });
    void this.source(id).setData({ type: "FeatureCollection", features });
    this.showLayers(id, features.length > 0);
    return true;
  }

  /** Layers of a source that holds nothing cost a pass over the whole screen all the same. */
  private showLayers(source: string, shown: boolean): void {
    if (this.shownSources.get(source) === shown) return;
    this.shownSources.set(source, shown);
    for (const { id, type, source: its } of this.map.getStyle().layers.filter((layer) => layer.type !== "background")) {
      if (its === source) this.map.setLayoutProperty(id, "visibility", shown && (type !== "fill-extrusion" || this.tilted) ? "visible" : "none");
    }
  }

  private source(id: string): GeoJSONSource {
    const found = this.map.getSource<GeoJSONSource>(id);
    if (found === undefined) throw new Error(`the map's style has no source "${id}"`);
    return found;
  }

  private writeWords(): void {
    clearTimeout(this.wordsDue);
    this.wordsDue = undefined;
    if (!this.loaded) return;
    const view = viewOf(this.map);
    const { fleet, store } = this;
    this.findNames();
    this.air.draw(view, this.map.getPixelRatio(), store, fleet, [...this.trails, ...this.evidence], this.marked.selected);
    const words = [...droneWords(view, fleet, store, this.selection.uav_id), ...[...this.words.values()].flat()];
    const points = (id: string): readonly GeoJSON.Feature[] => this.drawn.get(id)?.features ?? [];
    this.labels.draw(view, this.map.getPixelRatio(), words, (occupied) => {
      this.takePanels(occupied, view);
      const evidence = view.zoom >= CLOSE_ZOOM ? this.evidence : [];
      takeMarks(occupied, view, fleet, store, [...(view.zoom < SITE_ZOOM ? points("sites") : points("pads")), ...evidence]);
    });
  }

  private findNames(): void {
    const now_ms = performance.now();
    if (now_ms - this.namesAt_ms < NAMES_MS) return;
    this.namesAt_ms = now_ms;
    this.words.set("place", placeNames(this.map, reading().locale));
  }

  /** No words under the panels that float over the map; where the camera only keeps room beside them, there may be words. */
  private takePanels(occupied: Occupied, { width, height }: View): void {
    const { top = 0, right = 0, bottom = 0, left = 0 } = this.map.getPadding();
    const covered = (padding: number): number => Math.max(0, padding - this.room);
    occupied.take(0, 0, width, covered(top));
    occupied.take(0, height - covered(bottom), width, covered(bottom));
    occupied.take(0, 0, covered(left), height);
    occupied.take(width - covered(right), 0, covered(right), height);
  }

  /** Fetches what of the base map can be seen at this scale; at a pad's nothing can. */
  private loadBaseMap(): void {
    const zoom = this.map.getZoom();
    const further = this.isPlaced ? PLACE_FADES : 0;
    for (const { id, url, from, to, replaces } of BASE_FILES) {
      if (this.baseLoaded.has(id) || zoom < from || zoom > to + further) continue;
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

  private drawGrid(): void {
    const pad = this.gridPad();
    const spacing = gridSpacing_m(this.map.getZoom(), this.map.getCenter().lat);
    if (pad === undefined || spacing === undefined || !this.hasGrid) {
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
}
