/**
 * What the address says: the room, what is selected, and where the camera is. It stands in the fragment, so that any
 * web server can serve the console, and what an officer looks at does not reach a server's log.
 */
import { useSyncExternalStore } from "react";
import type { Filter, Tab } from "../fleet";
import { livePlace, liveQuery } from "./livePlace";

/** `bearing` is clockwise from north, `pitch` from straight down, degrees; without them north is up and the map flat. */
export type Camera = { lat: number; lon: number; zoom: number; bearing?: number; pitch?: number };
export type ListTab = Tab | "pads";
/** The live map: what is selected, what is shown of all that is about, and how. */
export type LivePlace = {
  room: "live";
  drone?: string;
  session?: string;
  camera?: Camera;
  filter?: Filter;
  /** Which list stands beside the map; all drones where it does not say. */
  list?: ListTab;
  /** The camera stays with the drone. */
  follow?: true;
  /** Places between which distances are measured; there, if empty, for the first of them to come. */
  measure?: readonly (readonly [lon: number, lat: number])[];
  /** The same as a table, or on a wall without anybody at the keys. */
  as?: "table" | "wall";
  /** Zones whose details are open. */
  zone?: readonly string[];
  /** Zones are not shown. */
  zones?: "off";
  /** What other service providers tell of the view is shown, too. */
  networked?: true;
};
/** What a list is filtered by, under the names of its address. */
export type Filters = Readonly<Record<string, string>>;
export type Place =
  | LivePlace
  | { room: "sessions"; session?: string; filters?: Filters }
  | { room: "verdicts"; filters: Filters }
  | { room: PlainRoom; path: readonly string[]; query: Filters };

/** Rooms whose address is a path and a query, read by the room itself. */
export const PLAIN_ROOMS = ["alerts", "replay", "registry", "zones", "ledger", "statistics", "people", "settings"] as const;
export type PlainRoom = (typeof PLAIN_ROOMS)[number];

const VERDICT_FILTERS = ["outcome", "pad", "action", "drone", "operator", "since", "until"] as const;
const SESSION_FILTERS = [...VERDICT_FILTERS, "state"] as const;

/** The place that a fragment names; the live map where it names none. */
export function parsePlace(hash: string): Place {
  const [path = "", query = ""] = hash.replace(/^#\/?/, "").split("?");
  const parameters = new URLSearchParams(query);
  const [room, id] = path.split("/");
  if (room === "sessions") return id ? { room: "sessions", session: decode(id) } : { room: "sessions", filters: filtersIn(parameters, SESSION_FILTERS) };
  if (room === "verdicts") return { room: "verdicts", filters: filtersIn(parameters, VERDICT_FILTERS) };
  const plain = PLAIN_ROOMS.find((each) => each === room);
  if (plain !== undefined) {
    const rest = path.split("/").slice(1).filter((part) => part !== "");
    return { room: plain, path: rest.map(decode), query: Object.fromEntries(parameters) };
  }
  return livePlace(parameters);
}

function filtersIn(parameters: URLSearchParams, names: readonly string[]): Filters {
  return withChange({}, Object.fromEntries(names.map((name) => [name, parameters.get(name) ?? ""])));
}

/** Filters with some of them changed; those set to nothing are gone. */
export function withChange(filters: Filters, change: Filters): Filters {
  return Object.fromEntries(Object.entries({ ...filters, ...change }).filter(([, value]) => value !== ""));
}

function decode(text: string): string {
  try {
    return decodeURIComponent(text);
  } catch {
    return text;
  }
}

export function placeHash(place: Place): string {
  let parameters = new URLSearchParams();
  let path: string = place.room;
  if (place.room === "live") {
    parameters = liveQuery(place);
  } else {
    if (place.room === "sessions") {
      if (place.session !== undefined) path += `/${encodeURIComponent(place.session)}`;
    } else if (place.room !== "verdicts") {
      path = [place.room, ...place.path.map(encodeURIComponent)].join("/");
    }
    const query = "query" in place ? place.query : (place.filters ?? {});
    for (const [name, value] of Object.entries(query)) parameters.set(name, value);
  }
  const query = parameters.toString().replaceAll("%2C", ",").replaceAll("%3B", ";").replace(/=(?=&|$)/g, "");
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
