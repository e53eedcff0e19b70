import { go, placeHash, type Place } from "../shared/address/location";

export const TABS = ["pads", "list", "import"] as const;
export type Tab = (typeof TABS)[number];

function place(path: readonly string[], query: Readonly<Record<string, string>> = {}): Place {
  return { room: "zones", path, query };
}

export function zonesHref(path: readonly string[], query: Readonly<Record<string, string>> = {}): string {
  return placeHash(place(path, query));
}

export function toZones(path: readonly string[], query: Readonly<Record<string, string>> = {}, replace = false): void {
  go(place(path, query), replace);
}
