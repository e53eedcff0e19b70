/** Zones' own calls. Each throws `ApiError`. */
import { answered, type Api, type Page } from "../shared/api/api";
import type { components, paths } from "../shared/api/schema";

type Schemas = components["schemas"];
export type Zone = Schemas["Zone"];
export type ZoneType = Zone["type"];
export type ZoneImport = Schemas["ZoneImport"];
export type ZoneFinding = Schemas["ZoneFinding"];
export type ImportReport = Schemas["ImportReport"];
export type PadClosures = Schemas["PadClosures"];
export type ClosurePlan = Schemas["ClosurePlan"];
export type ZoneFilters = NonNullable<paths["/api/v1/zones"]["get"]["parameters"]["query"]>;
/** A zone on the map: circles are polygons there. */
export type ZoneFeature = GeoJSON.Feature<GeoJSON.Geometry, Zone>;

/** Reading a large file takes the server some seconds, and its way there longer. */
const UPLOAD_MS = 180_000;
const MAP_PAGE = 500;
const MOST_ON_MAP = 5_000;

export function zones(api: Api, query: ZoneFilters): Promise<Page<Zone>> {
  // As JSON, which is what comes unless GeoJSON is asked for.
  return answered<unknown>((signal) => api.client.GET("/api/v1/zones", { params: { query }, signal })) as Promise<Page<Zone>>;
}

export function zone(api: Api, zone_id: string): Promise<Zone> {
  return answered<unknown>((signal) => api.client.GET("/api/v1/zones/{zone_id}", { params: { path: { zone_id } }, signal })) as Promise<Zone>;
}

/** All that the map can bear, as plain GeoJSON; those of now, or as they were known at a time of the past. */
export async function zonesForMap(api: Api, at_ms: number | undefined): Promise<ZoneFeature[]> {
  const found: ZoneFeature[] = [];
  let cursor: string | undefined;
  do {
    const query = { limit: MAP_PAGE, ...(at_ms !== undefined && { at_ms }), ...(cursor !== undefined && { cursor }) };
    const headers = { Accept: "application/geo+json" };
    const page = await answered<unknown>((signal) => api.client.GET("/api/v1/zones", { params: { query }, headers, signal }));
    const { features, next } = page as { features: ZoneFeature[]; next?: string };
    found.push(...features);
    cursor = next;
  } while (cursor !== undefined && found.length < MOST_ON_MAP);
  return found;
}

export function imports(api: Api, cursor: string | undefined): Promise<Page<ZoneImport>> {
  const query = { limit: 20, ...(cursor !== undefined && { cursor }) };
  return answered((signal) => api.client.GET("/api/v1/zones/imports", { params: { query }, signal }));
}

/** Reads a file (`dry_run`), or puts it in the place of its source's data set. */
export function bring(api: Api, file: Blob, source: string, dry_run: boolean): Promise<ImportReport> {
  return answered<ImportReport>(() =>
    api.client.POST("/api/v1/zones/imports", {
      params: { query: { source, dry_run } },
      headers: { "Content-Type": "application/json" },
      // The file's own bytes: what is wrong is told by its lines.
      body: file as never,
      bodySerializer: (body: unknown) => body as Blob,
      signal: AbortSignal.timeout(UPLOAD_MS),
    }),
  );
}

export function padClosures(api: Api, cursor: string | undefined): Promise<Page<PadClosures>> {
  const query = { limit: 50, ...(cursor !== undefined && { cursor }) };
  return answered((signal) => api.client.GET("/api/v1/zones/pads", { params: { query }, signal }));
}

export function closuresOf(api: Api, pad_id: string): Promise<PadClosures> {
  return answered((signal) => api.client.GET("/api/v1/zones/pads/{pad_id}", { params: { path: { pad_id } }, signal }));
}

export function plan(api: Api, pad_id: string, days: number): Promise<ClosurePlan> {
  return answered((signal) => api.client.GET("/api/v1/zones/pads/{pad_id}/plan", { params: { path: { pad_id }, query: { days } }, signal }));
}
