/** The live map's part of the address: read with care, since anybody may have written it. */
import { LOOKS } from "../drones";
import type { Filter } from "../fleet";
import type { Camera, ListTab, LivePlace } from "./location";

const ACTIONS = ["land", "takeoff", "dock"] as const;
const LISTS: readonly ListTab[] = ["needs-you", "proving", "verified", "pads"];
const MOST_MINUTES = 60;
const MOST_POINTS = 50;
const MOST_ZONES = 20;
const ZONE = /^[A-Z]{3}:[A-Za-z0-9][A-Za-z0-9 ._+-]{0,6}$/;

function parseCamera(text: string | null): Camera | undefined {
  const numbers = (text ?? "").split(",").map(Number);
  const [lat, lon, zoom, bearing, pitch] = numbers;
  if ((numbers.length !== 3 && numbers.length !== 5) || lat === undefined || lon === undefined || zoom === undefined) return undefined;
  const sane = Math.abs(lat) <= 90 && Math.abs(lon) <= 180 && zoom >= 0 && zoom <= 24;
  if (!sane) return undefined;
  const slanted = bearing !== undefined && pitch !== undefined && Math.abs(bearing) <= 180 && pitch >= 0 && pitch <= 85;
  return { lat, lon, zoom, ...(slanted && { bearing, pitch }) };
}

function parseFilter(parameters: URLSearchParams): Filter | undefined {
  const look = LOOKS.find((each) => each === parameters.get("look"));
  const action = ACTIONS.find((each) => each === parameters.get("action"));
  const minutes = Number(parameters.get("minutes"));
  const pad = parameters.get("pad");
  const operator = parameters.get("operator");
  const filter: Filter = {
    ...(look !== undefined && { look }),
    ...(pad && { pad }),
    ...(operator && { operator }),
    ...(action !== undefined && { action }),
    ...(minutes > 0 && minutes <= MOST_MINUTES && { minutes }),
  };
  return Object.keys(filter).length === 0 ? undefined : filter;
}

function parseMeasure(text: string | null): LivePlace["measure"] {
  if (text === null) return undefined;
  return text
    .split(";")
    .map((each) => each.split(",").map(Number))
    .flatMap(([lat, lon, more]): [number, number][] =>
      lat !== undefined && lon !== undefined && more === undefined && Math.abs(lat) <= 90 && Math.abs(lon) <= 180 ? [[lon, lat]] : [],
    )
    .slice(0, MOST_POINTS);
}

export function livePlace(parameters: URLSearchParams): LivePlace {
  const drone = parameters.get("drone");
  const session = parameters.get("session");
  const camera = parseCamera(parameters.get("at"));
  const filter = parseFilter(parameters);
  const list = LISTS.find((each) => each === parameters.get("list"));
  const measure = parseMeasure(parameters.get("measure"));
  const zone = (parameters.get("zone") ?? "").split(",").filter((each) => ZONE.test(each)).slice(0, MOST_ZONES);
  const as = parameters.has("wall") ? "wall" : parameters.has("table") ? "table" : undefined;
  return {
    room: "live",
    ...(drone && { drone }),
    ...(session && { session }),
    ...(camera && { camera }),
    ...(filter && { filter }),
    ...(list && { list }),
    ...(drone && parameters.has("follow") && { follow: true as const }),
    ...(measure && { measure }),
    ...(as && { as }),
    ...(zone.length > 0 && { zone }),
    ...(parameters.get("zones") === "off" && { zones: "off" as const }),
    ...(parameters.has("networked") && { networked: true as const }),
  };
}

export function liveQuery(place: LivePlace): URLSearchParams {
  const parameters = new URLSearchParams();
  if (place.drone !== undefined) parameters.set("drone", place.drone);
  if (place.session !== undefined) parameters.set("session", place.session);
  for (const [name, value] of Object.entries(place.filter ?? {})) parameters.set(name, String(value));
  if (place.list !== undefined && place.list !== "all") parameters.set("list", place.list);
  if (place.follow === true) parameters.set("follow", "");
  if (place.measure !== undefined) parameters.set("measure", place.measure.map(([lon, lat]) => `${lat.toFixed(7)},${lon.toFixed(7)}`).join(";"));
  if (place.as !== undefined) parameters.set(place.as, "");
  if (place.zone !== undefined) parameters.set("zone", place.zone.join(","));
  if (place.zones !== undefined) parameters.set("zones", place.zones);
  if (place.networked === true) parameters.set("networked", "");
  if (place.camera !== undefined) {
    const { lat, lon, zoom, bearing, pitch } = place.camera;
    const slant = bearing === undefined || pitch === undefined ? "" : `,${bearing.toFixed(1)},${pitch.toFixed(1)}`;
    // A centimetre is the seventh decimal; the zoom needs two.
    parameters.set("at", `${lat.toFixed(7)},${lon.toFixed(7)},${zoom.toFixed(2)}${slant}`);
  }
  return parameters;
}

export type Change = { [Name in keyof LivePlace]?: LivePlace[Name] | undefined };

/** The place with some of it changed; what becomes undefined is gone from the address. */
export function changed(place: LivePlace, change: Change): LivePlace {
  return Object.fromEntries(Object.entries({ ...place, ...change }).filter(([, value]) => value !== undefined)) as LivePlace;
}

/** Within what the address keeps of a camera. */
export function sameView(one: Camera, other: Camera): boolean {
  return Math.abs(one.lat - other.lat) < 1e-6 && Math.abs(one.lon - other.lon) < 1e-6 && Math.abs(one.zoom - other.zoom) < 0.01 && close(one.bearing, other.bearing) && close(one.pitch, other.pitch);
}

function close(one = 0, other = 0): boolean {
  return Math.abs(one - other) < 0.1;
}
