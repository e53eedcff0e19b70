import { createRequire } from "node:module";
import { readFileSync } from "node:fs";
import { feature, mesh } from "topojson-client";
import type { GeometryCollection, Topology } from "topojson-specification";
import type { Feature, GeoJSON, Position } from "geojson";
import type { Plugin } from "vite";

const require = createRequire(import.meta.url);
const VIRTUAL = "virtual:base-map";
const RESOLVED = `\0${VIRTUAL}`;

type CountryNames = { name: string };
type World = Topology<{ countries: GeometryCollection<CountryNames>; land: GeometryCollection }>;

function world(scale: "50m" | "10m"): World {
  return JSON.parse(readFileSync(require.resolve(`world-atlas/countries-${scale}.json`), "utf8")) as World;
}

/**
 * Three decimals of a degree (0.1 km) are finer than Natural Earth's 1:10 million is true, and keep the files small;
 * points that become the same are one.
 */
function compact(value: GeoJSON): string {
  return JSON.stringify(value, (_key, item: unknown) => {
    if (typeof item === "number") return Math.round(item * 1e3) / 1e3;
    if (!Array.isArray(item) || !isLine(item)) return item;
    const rounded = unwrapped(item).map(([x = 0, y = 0]): Position => [Math.round(x * 1e3) / 1e3, Math.round(y * 1e3) / 1e3]);
    const kept = rounded.filter((point, i) => i === 0 || point[0] !== rounded[i - 1]?.[0] || point[1] !== rounded[i - 1]?.[1]);
    // An islet that became a point or a line keeps its shape: four points make a ring.
    return kept.length >= 4 || item.length < 4 ? kept : rounded;
  });
}

function isLine(item: unknown[]): item is Position[] {
  const first: unknown = item[0];
  return Array.isArray(first) && typeof first[0] === "number";
}

/**
 * world-atlas runs rings across the date line, from 180° to −180°. MapLibre wants them to go on, beyond 180°; a ring
 * around the pole (Antarctica) does not come back to where it began and is closed along the pole.
 */
function unwrapped(line: Position[]): Position[] {
  let turns = 0;
  const result = line.map(([lon = 0, lat = 0], i): Position => {
    const before = line[i - 1]?.[0] ?? lon;
    if (lon - before > 180) turns -= 1;
    else if (lon - before < -180) turns += 1;
    return [lon + 360 * turns, lat];
  });
  const [first, last] = [result[0], result.at(-1)];
  if (turns !== 0 && first?.[1] === last?.[1]) {
    const pole = (first?.[1] ?? 0) < 0 ? -90 : 90;
    result.push([last?.[0] ?? 0, pole], [first?.[0] ?? 0, pole], first ?? [0, pole]);
  }
  return result;
}

function ringArea(ring: Position[]): number {
  let twice = 0;
  for (let i = 0, j = ring.length - 1; i < ring.length; j = i++) {
    const [x1 = 0, y1 = 0] = ring[j] ?? [];
    const [x2 = 0, y2 = 0] = ring[i] ?? [];
    twice += x1 * y2 - x2 * y1;
  }
  return Math.abs(twice) / 2;
}

function centroid(ring: Position[]): Position {
  let [twice, cx, cy] = [0, 0, 0];
  for (let i = 0, j = ring.length - 1; i < ring.length; j = i++) {
    const [x1 = 0, y1 = 0] = ring[j] ?? [];
    const [x2 = 0, y2 = 0] = ring[i] ?? [];
    const cross = x1 * y2 - x2 * y1;
    twice += cross;
    cx += (x1 + x2) * cross;
    cy += (y1 + y2) * cross;
  }
  return [cx / (3 * twice), cy / (3 * twice)];
}

/** A place for each country's name: the centroid of its largest polygon, and that polygon's area as its importance. */
function labels(topology: World): GeoJSON {
  const points: Feature[] = [];
  for (const country of feature(topology, topology.objects.countries).features) {
    const polygons =
      country.geometry.type === "MultiPolygon"
        ? country.geometry.coordinates
        : country.geometry.type === "Polygon"
          ? [country.geometry.coordinates]
          : [];
    const largest = polygons
      .map((polygon) => unwrapped(polygon[0] ?? []))
      .reduce<Position[]>((best, ring) => (ringArea(ring) > ringArea(best) ? ring : best), []);
    if (largest.length === 0) continue;
    points.push({
      type: "Feature",
      geometry: { type: "Point", coordinates: centroid(largest) },
      properties: { name: country.properties.name, area: Math.round(ringArea(largest)) },
    });
  }
  return { type: "FeatureCollection", features: points };
}

function layers(): Record<string, string> {
  const coarse = world("50m");
  const fine = world("10m");
  return {
    land50: compact(feature(coarse, coarse.objects.land)),
    land10: compact(feature(fine, fine.objects.land)),
    borders50: compact(mesh(coarse, coarse.objects.countries, (a, b) => a !== b)),
    borders10: compact(mesh(fine, fine.objects.countries, (a, b) => a !== b)),
    names: compact(labels(coarse)),
  };
}

/**
 * Turns world-atlas (Natural Earth, public domain) into GeoJSON files of this build, and gives their addresses as
 * `virtual:base-map`. MapLibre's own worker then fetches and cuts them, off the main thread, and nothing is asked of
 * any other host.
 */
export function baseMap(): Plugin {
  let serving = false;
  let cache: Record<string, string> | undefined;
  const content = (): Record<string, string> => (cache ??= layers());
  return {
    name: "wonderland-base-map",
    configResolved(config) {
      serving = config.command === "serve";
    },
    resolveId(id) {
      return id === VIRTUAL ? RESOLVED : undefined;
    },
    load(id) {
      if (id !== RESOLVED) return undefined;
      const names = ["land50", "land10", "borders50", "borders10", "names"];
      const lines = names.map((name) => {
        if (serving) return `export const ${name} = new URL("/@base-map/${name}.json", location.href).href;`;
        const reference = this.emitFile({ type: "asset", name: `${name}.json`, source: content()[name] ?? "" });
        return `export const ${name} = import.meta.ROLLUP_FILE_URL_${reference};`;
      });
      return lines.join("\n");
    },
    configureServer(server) {
      server.middlewares.use("/@base-map/", (request, response) => {
        const name = (request.url ?? "").replace(/^\//, "").replace(/\.json.*$/, "");
        const body = content()[name];
        response.statusCode = body === undefined ? 404 : 200;
        response.setHeader("Content-Type", "application/json");
        response.end(body ?? "{}");
      });
    },
  };
}
