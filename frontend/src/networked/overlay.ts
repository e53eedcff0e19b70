/** What other service providers tell, as a layer of the live map: hollow marks without a verdict's colour. */
import type { Overlay } from "../map/overlays";
import { TILE } from "../map/view";
import { lonLat, plainFrame, toGlobe, type LonLat } from "../shared/geo/frame";
import { leg } from "../shared/geo/geodesic";
import type { Bounds, Flight, Flights } from "./calls";

const ID = "networked";
/** A mark points to where the flight will be by then. */
const AHEAD_S = 10;
const SLOW_MM_S = 500;
const REACH_PX = 12;
/** The standard's greatest view (F3411-22a, NetMaxDisplayAreaDiagonal). */
export const MOST_VIEW_M = 7_000;

/** From corner to corner of a view; a view over the antimeridian is no view at all. */
export function diagonal_m([west, south, east, north]: Bounds): number {
  return west < -180 || east > 180 ? Infinity : leg([west, south], [east, north]).distance_m;
}

/** Our own flights are drones of the map already. */
export function foreign(flights: readonly Flight[]): Flight[] {
  return flights.filter(({ provider }) => provider !== undefined);
}

function ahead(flight: Flight): LonLat | undefined {
  const { speed_mm_s, track_cdeg } = flight;
  if (speed_mm_s === undefined || speed_mm_s < SLOW_MM_S || track_cdeg === undefined) return undefined;
  const way_mm = speed_mm_s * AHEAD_S;
  const track = (track_cdeg / 100) * (Math.PI / 180);
  return toGlobe(plainFrame(flight), { east_mm: way_mm * Math.sin(track), north_mm: way_mm * Math.cos(track) });
}

function shapes(flight: Flight, selected: boolean): GeoJSON.Feature[] {
  const here = lonLat(flight);
  const properties = { selected };
  const found: GeoJSON.Feature[] = [{ type: "Feature", properties: { ...properties, part: "place" }, geometry: { type: "Point", coordinates: here } }];
  const line = (part: string, coordinates: LonLat[]): void => {
    if (coordinates.length > 1) found.push({ type: "Feature", properties: { ...properties, part }, geometry: { type: "LineString", coordinates } });
  };
  const next = ahead(flight);
  if (next !== undefined) line("ahead", [here, next]);
  line("trail", flight.trail.map(lonLat));
  return found;
}

function area({ west_e7, south_e7, east_e7, north_e7, flights }: Flights["clusters"][number]): GeoJSON.Feature {
  const [west, south, east, north] = [west_e7 / 1e7, south_e7 / 1e7, east_e7 / 1e7, north_e7 / 1e7];
  const ring = [[west, south], [east, south], [east, north], [west, north], [west, south]];
  return { type: "Feature", properties: { part: "area", flights }, geometry: { type: "Polygon", coordinates: [ring] } };
}

export function networkedOverlay(shown: Pick<Flights, "flights" | "clusters">, selected: string | undefined): Overlay {
  const features = [...foreign(shown.flights).flatMap((flight) => shapes(flight, flight.flight_id === selected)), ...shown.clusters.map(area)];
  return {
    id: ID,
    features,
    layers: (colours) => {
      const [ink, panel] = [colours["ink2"] ?? "#888", colours["panel"] ?? "#fff"];
      return [
        { id: `${ID}-area`, type: "fill", source: ID, filter: ["==", ["get", "part"], "area"], paint: { "fill-color": ink, "fill-opacity": ["min", 0.3, ["+", 0.06, ["*", 0.02, ["get", "flights"]]]] } },
        { id: `${ID}-area-edge`, type: "line", source: ID, filter: ["==", ["get", "part"], "area"], paint: { "line-color": ink, "line-width": 1, "line-dasharray": [3, 3] } },
        { id: `${ID}-trail`, type: "line", source: ID, filter: ["==", ["get", "part"], "trail"], layout: { "line-cap": "round" }, paint: { "line-color": ink, "line-width": 1.6, "line-opacity": 0.4, "line-dasharray": [0.1, 2.6] } },
        { id: `${ID}-ahead`, type: "line", source: ID, filter: ["==", ["get", "part"], "ahead"], paint: { "line-color": ink, "line-width": 1.2 } },
        {
          id: `${ID}-place`,
          type: "circle",
          source: ID,
          filter: ["==", ["get", "part"], "place"],
          paint: { "circle-radius": ["case", ["get", "selected"], 7, 5], "circle-color": panel, "circle-stroke-color": ink, "circle-stroke-width": ["case", ["get", "selected"], 2.6, 1.6] },
        },
      ];
    },
  };
}

/** The flight whose mark is at a place of the map, of those within reach the nearest. */
export function flightAt(flights: readonly Flight[], place: LonLat, zoom: number): Flight | undefined {
  const reach = (REACH_PX * 360) / (TILE * 2 ** zoom);
  const narrow = Math.cos((place[1] * Math.PI) / 180);
  const away = (flight: Flight): number => {
    const [lon, lat] = lonLat(flight);
    return Math.hypot(lon - place[0], (lat - place[1]) / Math.max(0.01, narrow));
  };
  const near = foreign(flights).filter((flight) => away(flight) <= reach);
  return near.sort((a, b) => away(a) - away(b))[0];
}
