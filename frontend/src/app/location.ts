/**
 * What the address says: the room, what is selected, and where the camera is. It stands in the fragment, so that any
 * web server can serve the console, and what an officer looks at does not reach a server's log.
 */
import { useSyncExternalStore } from "react";

export type Camera = { lat: number; lon: number; zoom: number };
export type Place =
  | { room: "live"; drone?: string; session?: string; camera?: Camera }
  | { room: "sessions"; session?: string }
  | { room: "verdicts"; filters: Record<string, string> }
  | { room: PlainRoom; path: readonly string[]; query: Readonly<Record<string, string>> };

/** Rooms whose address is a path and a query, read by the room itself. */
export const PLAIN_ROOMS = ["alerts", "replay", "registry", "ledger", "statistics", "people", "settings"] as const;
export type PlainRoom = (typeof PLAIN_ROOMS)[number];

const FILTERS = ["outcome", "pad", "drone"] as const;

function parseCamera(text: string | null): Camera | undefined {
  const numbers = (text ?? "").split(",").map(Number);
  const [lat, lon, zoom] = numbers;
  if (numbers.length !== 3 || lat === undefined || lon === undefined || zoom === undefined) return undefined;
  const sane = Math.abs(lat) <= 90 && Math.abs(lon) <= 180 && zoom >= 0 && zoom <= 24;
  return sane ? { lat, lon, zoom } : undefined;
}

/** The place that a fragment names; the live map where it names none. */
export function parsePlace(hash: string): Place {
  const [path = "", query = ""] = hash.replace(/^#\/?/, "").split("?");
  const parameters = new URLSearchParams(query);
  const [room, id] = path.split("/");
  if (room === "sessions") return id ? { room: "sessions", session: decode(id) } : { room: "sessions" };
  if (room === "verdicts") {
    const filters: Record<string, string> = {};
    for (const name of FILTERS) {
      const value = parameters.get(name);
      if (value) filters[name] = value;
    }
    return { room: "verdicts", filters };
  }
  const plain = PLAIN_ROOMS.find((each) => each === room);
  if (plain !== undefined) {
    const rest = path.split("/").slice(1).filter((part) => part !== "");
    return { room: plain, path: rest.map(decode), query: Object.fromEntries(parameters) };
  }
  const drone = parameters.get("drone");
  const session = parameters.get("session");
  const camera = parseCamera(parameters.get("at"));
  return {
    room: "live",
    ...(drone && { drone }),
    ...(session && { session }),
    ...(camera && { camera }),
  };
}

function decode(text: string): string {
  try {
    return decodeURIComponent(text);
  } catch {
    return text;
  }
}

export function placeHash(place: Place): string {
  const parameters = new URLSearchParams();
  let path: string = place.room;
  if (place.room === "live") {
    if (place.drone !== undefined) parameters.set("drone", place.drone);
    if (place.session !== undefined) parameters.set("session", place.session);
    if (place.camera !== undefined) {
      const { lat, lon, zoom } = place.camera;
      // A centimetre is the seventh decimal; the zoom needs two.
      parameters.set("at", `${lat.toFixed(7)},${lon.toFixed(7)},${zoom.toFixed(2)}`);
    }
  } else if (place.room === "sessions") {
    if (place.session !== undefined) path += `/${encodeURIComponent(place.session)}`;
  } else {
    if (place.room !== "verdicts") path = [place.room, ...place.path.map(encodeURIComponent)].join("/");
    const query = place.room === "verdicts" ? place.filters : place.query;
    for (const [name, value] of Object.entries(query)) parameters.set(name, value);
  }
  const query = parameters.toString().replaceAll("%2C", ",");
  return `#/${path}${query === "" ? "" : `?${query}`}`;
}

const listeners = new Set<() => void>();
let current: { hash: string; place: Place } | undefined;

function read(): Place {
  if (current?.hash !== location.hash) current = { hash: location.hash, place: parsePlace(location.hash) };
  return current.place;
}

function subscribe(listener: () => void): () => void {
  listeners.add(listener);
  addEventListener("hashchange", listener);
  return () => {
    listeners.delete(listener);
    removeEventListener("hashchange", listener);
  };
}

export function currentPlace(): Place {
  return read();
}

/** Goes there: a new entry of the history, or (`replace`) instead of the one that is shown. */
export function go(place: Place, replace = false): void {
  const url = `${location.pathname}${location.search}${placeHash(place)}`;
  if (replace) history.replaceState(null, "", url);
  else history.pushState(null, "", url);
  for (const listener of listeners) listener();
}

export function usePlace(): Place {
  return useSyncExternalStore(subscribe, read);
}
