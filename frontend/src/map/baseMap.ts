import { useQuery, useQueryClient } from "@tanstack/react-query";
import { useCallback } from "react";
import { answered, useApi } from "../shared/api/api";
import type { BaseMap } from "./place";

/** An archive may come, go and be replaced while it is shown. */
const LOOK_AGAIN_MS = 15_000;
const KEY = ["base-map"];
const NOTHING: BaseMap = { missing: [] };

/** What the ground of the map is drawn from; coasts and borders alone until that is known, or where it is not told. */
export function useBaseMap(): BaseMap {
  const api = useApi();
  const query = useQuery({
    queryKey: KEY,
    queryFn: () => answered<unknown>((signal) => api.client.GET("/api/v1/map", { signal })) as Promise<BaseMap>,
    refetchInterval: LOOK_AGAIN_MS,
    retry: false,
  });
  return query.data ?? NOTHING;
}

/** Asks at once what the ground is drawn from, where something shows that it may be another. */
export function useLookAgain(): () => void {
  const client = useQueryClient();
  return useCallback(() => void client.refetchQueries({ queryKey: KEY }, { cancelRefetch: false }), [client]);
}
