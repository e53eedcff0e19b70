import { useQueries, useQuery, type UseQueryResult } from "@tanstack/react-query";
import { useMemo } from "react";
import type { Overlay } from "../map/overlays";
import type { Pad } from "../shared/api/records";
import { useApi } from "../shared/api/api";
import { frameOf } from "../shared/geo/frame";
import { fetchPlan } from "./calls";
import { planOverlay } from "./overlay";
import { readPlan, type Plan } from "./plan";

/** Of more pads than this nobody sees the plans at once. */
const MOST = 40;
const NONE: readonly Overlay[] = [];

function planQuery(api: ReturnType<typeof useApi>, pad_id: string, sha256: string): { queryKey: unknown[]; queryFn: () => Promise<Plan>; staleTime: number; retry: boolean } {
  return { queryKey: ["site-plan", pad_id, sha256], queryFn: async () => readPlan(await fetchPlan(api, pad_id, sha256)), staleTime: Infinity, retry: false };
}

/** One plan by its hash. */
export function usePlan(pad_id: string, sha256: string | undefined): UseQueryResult<Plan> {
  const api = useApi();
  return useQuery({ ...planQuery(api, pad_id, sha256 ?? ""), enabled: sha256 !== undefined });
}

/** The plans of these pads as a layer of the map; `sha256`: of one pad the plan that held at another time. */
export function usePlanOverlays(pads: readonly Pad[], shown: boolean, sha256?: string): readonly Overlay[] {
  const api = useApi();
  const planned = shown ? pads.filter((pad) => (sha256 ?? pad.site_plan_sha256) !== undefined).slice(0, MOST) : [];
  const found = useQueries({ queries: planned.map((pad) => planQuery(api, pad.pad_id, sha256 ?? pad.site_plan_sha256 ?? "")) });
  const key = planned.map((pad, i) => `${pad.pad_id} ${sha256 ?? pad.site_plan_sha256} ${pad.commissioning_sha256} ${found[i]?.data === undefined}`).join();
  return useMemo(() => {
    const drawn = planned.flatMap((pad, i) => {
      const plan = found[i]?.data;
      return plan === undefined ? [] : [{ plan, frame: frameOf(pad) }];
    });
    return drawn.length === 0 ? NONE : [planOverlay(drawn)];
    // The key names everything that is drawn.
  }, [key]);
}
