import { useMemo, useRef, type ReactElement } from "react";
import { useBaseMap } from "../live-map/baseMap";
import { MapView, type MapHandle } from "../live-map/map/MapView";
import { ZoomControls } from "../live-map/ZoomControls";
import type { VerdictSummary } from "../shared/api/records";
import type { Filter } from "../shared/fleet";
import { useFleet } from "../shared/live/useFleet";
import { sessionTexts as t } from "./texts";

const EVERYBODY: Filter = {};
const CLEAR = { top: 40, right: 24, bottom: 52, left: 24 };
const nothing = (): void => undefined;

/** Where it was: the live map, framed at the pad, the claim and the measurement. Missing where there is no place to draw. */
export function SessionMap({ verdict }: { verdict: VerdictSummary }): ReactElement | null {
  const base = useBaseMap();
  const fleet = useFleet(EVERYBODY);
  const map = useRef<MapHandle>(null);
  const selection = useMemo(() => ({ uav_id: verdict.uav_id, verdict }), [verdict]);
  if (base.archive === undefined || verdict.estimate === undefined) return null;
  return (
    <section className="float card card-wide session-map live" aria-label={t("whereItWas")}>
      <MapView ref={map} fleet={fleet} camera={undefined} selection={selection} padding={CLEAR} onSelect={nothing} onCamera={nothing} />
      <div className="map-tools">
        <ZoomControls onZoom={(levels) => map.current?.zoomBy(levels)} onAll={() => map.current?.fitSelection()} all={t("showProof")} />
      </div>
    </section>
  );
}
