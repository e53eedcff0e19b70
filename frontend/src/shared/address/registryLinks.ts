import { go, placeHash } from "./location";

export const TABS = ["drones", "pads", "operators", "certificates", "proposals", "import", "key"] as const;
export type Tab = (typeof TABS)[number];

export function registryHref(path: readonly string[], query: Readonly<Record<string, string>> = {}): string {
  return placeHash({ room: "registry", path, query });
}

export function toRegistry(path: readonly string[], query: Readonly<Record<string, string>> = {}, replace = false): void {
  go({ room: "registry", path, query }, replace);
}

/** The form that suspends a drone: from wherever it is shown. */
export function suspendHref(uav_id: string, reason?: string): string {
  return registryHref(["drones", uav_id, "suspend"], reason === undefined ? {} : { reason });
}
