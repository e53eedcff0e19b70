import { addProtocol, removeProtocol, type Map as MapLibre } from "maplibre-gl";
import { PMTiles, Protocol } from "pmtiles";
import { reading } from "../shared/i18n/locale";
import type { components } from "../shared/api/schema";
import { ArchiveSource, Directories } from "./archiveSource";
import { hasBuildings } from "./baseMap";
import type { Palette } from "./icons";
import { groundLayers, PLACE, PLACE_ZOOM, placeWordLayers, reliefLayer, volumeLayers, type Stage } from "./placeLayers";

export type BaseMap = components["schemas"]["BaseMap"];
export type MapLayer = components["schemas"]["MapLayer"];

export const IMAGERY = "imagery";
export const TERRAIN = "terrain";
const SCHEME = "pmtiles";
/** From the bottom to the top: ground below this layer of ours, volumes and words below that one. */
const GROUND_BELOW = "grid";
const RELIEF_BELOW = `${PLACE}-paved`;
const VOLUMES_BELOW = "reach";
const FOOTPRINTS = `${PLACE}-building`;
const LIGHT = 0.16;
const SKY = { "sky-horizon-blend": 0.6, "horizon-fog-blend": 0.7, "fog-ground-blend": 0.9 };

/** Protocols are MapLibre's, shared by all maps of the page: there as long as one map needs it. */
let protocol: { users: number; archives: Protocol } | undefined;

function use(): Protocol {
  protocol ??= { users: 0, archives: new Protocol({ metadata: true }) };
  if (protocol.users++ === 0) addProtocol(SCHEME, protocol.archives.tile);
  return protocol.archives;
}

function release(): void {
  if (protocol === undefined || --protocol.users > 0) return;
  removeProtocol(SCHEME);
  protocol = undefined;
}

/** The place on one map: what an archive and aerial images bring to it, under everything that flies. */
export class PlaceOnMap {
  private archives: Protocol | undefined;
  private shown: BaseMap = { missing: [] };
  private on = false;
  private volumes = false;
  private stage: Stage | undefined;
  private imagery = false;
  private ids: string[] = [];

  constructor(
    private readonly map: MapLibre,
    private readonly origin: string,
  ) {}

  /** Whether there are buildings that can rise. */
  get hasVolumes(): boolean {
    return hasBuildings(this.shown);
  }

  /** Whether an archive draws the ground. */
  get hasGround(): boolean {
    return this.shown.archive !== undefined;
  }

  /** Whether the ground is more than coasts and borders. */
  get isShown(): boolean {
    return this.shown.archive !== undefined || this.shown.imagery !== undefined;
  }

  /** What there is to show; called again when it has changed. */
  describe(base: BaseMap, colours: Palette): void {
    const same = JSON.stringify({ ...base, missing: [] }) === JSON.stringify({ ...this.shown, missing: [] });
    this.shown = base;
    if (same || !this.on) return;
    this.clear();
    this.draw(colours);
  }

  /** After the style has loaded, and again after the graphics were lost. */
  load(colours: Palette): void {
    this.on = true;
    this.ids = this.ids.filter((id) => this.map.getLayer(id) !== undefined);
    this.clear();
    this.draw(colours);
  }

  retheme(colours: Palette): void {
    if (!this.on) return;
    for (const { id, paint } of this.layers(colours).flatMap(({ layers }) => layers)) {
      if (this.map.getLayer(id) === undefined) continue;
      for (const [name, value] of Object.entries(paint ?? {})) this.map.setPaintProperty(id, name as never, value as never);
    }
    // Soft, from the upper left of the screen however the camera is turned: no wall is in the dark.
    this.map.setLight({ anchor: "viewport", position: [1.4, 200, 40], color: "#ffffff", intensity: LIGHT });
    this.map.setSky({ "sky-color": colours["sky"] ?? "", "horizon-color": colours["sky"] ?? "", "fog-color": colours["land"] ?? "", ...SKY });
  }

  /** Aerial images over the drawn ground, which stands in for those that have not come. */
  showImagery(shown: boolean, colours: Palette): void {
    if (this.imagery === shown) return;
    this.imagery = shown;
    if (!this.on) return;
    this.clear();
    this.draw(colours);
  }

  /** Buildings as volumes, or as what they cover. */
  raise(volumes: boolean): void {
    if (this.volumes === volumes) return;
    this.volumes = volumes;
    // Under its volume nobody sees what a building covers.
    if (this.map.getLayer(FOOTPRINTS) !== undefined) this.map.setLayoutProperty(FOOTPRINTS, "visibility", volumes ? "none" : "visible");
    for (const { id } of volumeLayers({}, undefined, volumes)) {
      if (this.map.getLayer(id) !== undefined) this.map.setLayoutProperty(id, "visibility", volumes ? "visible" : "none");
    }
  }

  /** Buildings step back from here. */
  stepBack(stage: Stage | undefined): void {
    if (JSON.stringify(stage) === JSON.stringify(this.stage)) return;
    this.stage = stage;
    for (const layer of volumeLayers({}, stage, this.volumes)) {
      if (this.map.getLayer(layer.id) !== undefined && "filter" in layer) this.map.setFilter(layer.id, layer.filter);
    }
  }

  remove(): void {
    this.on = false;
    if (this.archives !== undefined) release();
    this.archives = undefined;
  }

  private clear(): void {
    for (const id of this.ids) this.map.removeLayer(id);
    this.ids = [];
    for (const id of [PLACE, TERRAIN, IMAGERY]) if (this.map.getSource(id) !== undefined) this.map.removeSource(id);
  }

  private draw(colours: Palette): void {
    const { archive, terrain, imagery } = this.shown;
    if (archive === undefined && terrain === undefined && imagery === undefined) return;
    this.archives ??= use();
    if (archive !== undefined) this.addSource(PLACE, archive);
    if (terrain !== undefined) this.addSource(TERRAIN, terrain);
    if (imagery !== undefined && this.imagery) this.addSource(IMAGERY, imagery);
    for (const { layers, below } of this.layers(colours)) {
      for (const layer of layers) {
        if ("source" in layer && this.map.getSource(layer.source) === undefined) continue;
        this.map.addLayer(layer, this.map.getLayer(below) === undefined ? undefined : below);
        this.ids.push(layer.id);
      }
    }
    this.retheme(colours);
  }

  private layers(colours: Palette): { layers: ReturnType<typeof groundLayers>; below: string }[] {
    const { archive, terrain, imagery } = this.shown;
    const [, south = 0, , north = 0] = archive?.bounds ?? [];
    const pictures = imagery !== undefined && this.imagery;
    const volumes = volumeLayers(colours, this.stage, this.volumes);
    return [
      ...(archive === undefined ? [] : [{ layers: groundLayers(colours, (south + north) / 2), below: GROUND_BELOW }]),
      ...(terrain === undefined ? [] : [{ layers: [reliefLayer(colours, TERRAIN)], below: archive === undefined ? GROUND_BELOW : RELIEF_BELOW }]),
      ...(pictures ? [{ layers: [{ id: IMAGERY, type: "raster" as const, source: IMAGERY, paint: { "raster-saturation": -0.35, "raster-fade-duration": 0 } }], below: GROUND_BELOW }] : []),
      ...(archive === undefined ? [] : [{ layers: [...volumes, ...placeWordLayers(colours, reading().locale)], below: VOLUMES_BELOW }]),
    ];
  }

  private addSource(id: string, { url, kind, bounds, min_zoom, max_zoom, encoding }: MapLayer): void {
    const address = `${this.origin}${url}`;
    const common = { bounds: [...bounds] as [number, number, number, number], minzoom: id === PLACE ? Math.max(min_zoom, Math.floor(PLACE_ZOOM)) : min_zoom, maxzoom: max_zoom };
    if (kind === "wmts") {
      this.map.addSource(id, { type: "raster", tiles: [address], tileSize: 256, ...common });
      return;
    }
    this.archives?.add(new PMTiles(new ArchiveSource(address), new Directories()));
    const tiles = [`${SCHEME}://${address}/{z}/{x}/{y}`];
    if (id === TERRAIN) this.map.addSource(id, { type: "raster-dem", tiles, tileSize: 512, encoding: encoding ?? "terrarium", ...common });
    else if (kind === "vector") this.map.addSource(id, { type: "vector", tiles, ...common });
    else this.map.addSource(id, { type: "raster", tiles, tileSize: 256, ...common });
  }
}
