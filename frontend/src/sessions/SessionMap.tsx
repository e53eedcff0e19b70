import { useMemo, useRef, type ReactElement } from "react";
import { useBaseMap } from "../map/baseMap";
import { MapView, type MapHandle } from "../map/MapView";
import { ZoomControls } from "../map/ZoomControls";
import { usePlanOverlays } from "../plans/usePlans";
import type { VerdictSummary } from "../shared/api/records";
import type { Filter } from "../shared/fleet";
import { useFleet } from "../shared/live/useFleet";
import { useLive } from "../shared/live/useLive";
import type { Topic } from "../shared/live/store";
import { sessionTexts as t } from "./texts";

const PADS: readonly Topic[] = ["pads"];
const EVERYBODY: Filter = {};
const CLEAR = { top: 40, right: 24, bottom: 52, left: 24 };
const nothing = (): void => undefined;

/** Where it was: the live map, framed at the pad, the claim and the measurement. Missing where there is no place to draw. */
export function SessionMap({ verdict, site_plan_sha256 }: { verdict: VerdictSummary; site_plan_sha256: string | undefined }): ReactElement | null {
  const { base } = useBaseMap();
  const fleet = useFleet(EVERYBODY);
  const map = useRef<MapHandle>(null);
  const selection = useMemo(() => ({ uav_id: verdict.uav_id, verdict }), [verdict]);
  const pad = useLive(PADS, (store) => store.pads.get(verdict.pad_id));
  const overlays = usePlanOverlays(pad === undefined ? [] : [pad], site_plan_sha256 !== undefined, site_plan_sha256);
  if (base.archive === undefined || verdict.estimate === undefined) return null;
  return (
    <section className="float card card-wide session-map live" aria-label={t("whereItWas")}>
      <MapView ref={map} fleet={fleet} camera={undefined} selection={selection} padding={CLEAR} overlays={overlays} onSelect={nothing} onCamera={nothing} />
      <div className="map-tools">
        <ZoomControls onZoom={(levels) => map.current?.zoomBy(levels)} onAll={() => map.current?.fitSelection()} all={t("showProof")} />
      </div>
    </section>
  );
}
