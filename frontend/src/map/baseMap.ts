import { useQuery, useQueryClient } from "@tanstack/react-query";
import { useCallback } from "react";
import { answered, useApi } from "../shared/api/api";
import type { Pad } from "../shared/api/records";
import type { LiveStore, Topic } from "../shared/live/store";
import { useLive } from "../shared/live/useLive";
import type { BaseMap } from "./place";

/** An archive may come, go and be replaced while it is shown. */
const LOOK_AGAIN_MS = 15_000;
const KEY = ["base-map"];
const NOTHING: BaseMap = { missing: [] };
const TOPICS: readonly Topic[] = ["pads"];

/**
 * What the ground of the map is drawn from; coasts and borders alone until that is known, or where it is not told.
 * `elsewhere`: an archive draws a part of the world where no pad is.
 */
export function useBaseMap(): { base: BaseMap; elsewhere: boolean } {
  const api = useApi();
  const query = useQuery({
    queryKey: KEY,
    queryFn: () => answered<unknown>((signal) => api.client.GET("/api/v1/map", { signal })) as Promise<BaseMap>,
    refetchInterval: LOOK_AGAIN_MS,
    retry: false,
  });
  const told = query.data ?? NOTHING;
  const elsewhere = useLive(TOPICS, (store: LiveStore) => isElsewhere(told, store.pads.values()));
  return { base: told, elsewhere };
}

/** Whether there are pads, and none of them where the archive has anything to draw. */
export function isElsewhere({ archive }: BaseMap, pads: Iterable<Pad>): boolean {
  if (archive === undefined) return false;
  const [west, south, east, north] = archive.bounds;
  const all = [...pads].filter(({ status }) => status !== "retired");
  return all.length > 0 && all.every(({ lat_e7, lon_e7 }) => lon_e7 < west * 1e7 || lon_e7 > east * 1e7 || lat_e7 < south * 1e7 || lat_e7 > north * 1e7);
}

/** Whether there are buildings to see, somewhere. */
export function hasBuildings({ archive }: BaseMap): boolean {
  return archive?.layers.includes("buildings") === true;
}

/** Asks at once what the ground is drawn from, where something shows that it may be another. */
export function useLookAgain(): () => void {
  const client = useQueryClient();
  return useCallback(() => void client.refetchQueries({ queryKey: KEY }, { cancelRefetch: false }), [client]);
}
