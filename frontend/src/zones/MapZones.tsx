import { keepPreviousData, useQuery } from "@tanstack/react-query";
import { useMemo, type ReactElement } from "react";
import { MapCard } from "../map/MapCard";
import type { Overlay } from "../map/overlays";
import { useApi } from "../shared/api/api";
import { zonesForMap, type ZoneFeature } from "./calls";
import { zonesHref } from "./links";
import { Swatch, TYPES } from "./looks";
import { zoneOverlay } from "./overlay";
import { zoneTexts as t } from "./texts";
import { nameOf } from "./words";
import { ZoneFacts } from "./ZonePage";
import "./zones.css";

const MINUTE_MS = 60_000;
const NONE: readonly ZoneFeature[] = [];
const NO_OVERLAYS: readonly Overlay[] = [];

/** The zones of the map, now or (`at_ms`) at a minute of the past, and their layer; none while they are hidden. */
export function useMapZones(shown: boolean, at_ms?: number): { zones: readonly ZoneFeature[]; overlays: readonly Overlay[] } {
  const api = useApi();
  const minute_ms = at_ms === undefined ? undefined : Math.floor(at_ms / MINUTE_MS) * MINUTE_MS;
  const query = useQuery({
    queryKey: ["zones", "map", minute_ms],
    queryFn: () => zonesForMap(api, minute_ms),
    enabled: shown,
    // Some come into force and others end while the map is looked at.
    refetchInterval: at_ms === undefined && MINUTE_MS,
    placeholderData: keepPreviousData,
  });
  const zones = shown ? (query.data ?? NONE) : NONE;
  const overlays = useMemo(() => (zones.length === 0 ? NO_OVERLAYS : [zoneOverlay(zones)]), [zones]);
  return { zones, overlays };
}

/** The types that are on the map, and whether they are shown. */
export function ZoneLegend({ zones, shown, onToggle }: { zones: readonly ZoneFeature[]; shown: boolean; onToggle: () => void }): ReactElement | null {
  const types = TYPES.filter((type) => zones.some(({ properties }) => properties.type === type));
  if (shown && types.length === 0) return null;
  return (
    <div className="float legend zones-legend">
      {types.map((type) => (
        <span key={type} className="zone-type" title={t("type", { type })}>
          <Swatch type={type} />
          <span className="zone-name">{t("type", { type })}</span>
        </span>
      ))}
      <button type="button" className="icon-button" aria-pressed={shown} aria-label={t(shown ? "hide" : "show")} title={t(shown ? "hide" : "show")} onClick={onToggle}>
        <svg viewBox="0 0 20 20" aria-hidden="true">
          <path d={shown ? "M2 10s3-5 8-5 8 5 8 5-3 5-8 5-8-5-8-5zM10 12.2a2.2 2.2 0 1 0 0-4.4 2.2 2.2 0 0 0 0 4.4" : "M2 10s3-5 8-5 8 5 8 5-3 5-8 5-8-5-8-5zM4 17L16 3"} />
        </svg>
      </button>
    </div>
  );
}

type CardProperties = {
  zones: readonly ZoneFeature[];
  now_ms: number;
  /** They are as they were: their own pages tell how they are now. */
  past?: boolean;
  onClose: () => void;
};

/** What holds where the map was clicked, the most restrictive first. */
export function ZoneCard({ zones, now_ms, past = false, onClose }: CardProperties): ReactElement | null {
  if (zones.length === 0) return null;
  return (
    <MapCard title={t("there", { count: zones.length })} kind="zone-card" onClose={onClose}>
      {zones.map(({ properties }, i) => (
        <details key={properties.zone_id} open={i === 0}>
          <summary>
            <Swatch type={properties.type} active={properties.active} /> <b>{nameOf(properties)}</b> <span className="quiet">{properties.zone_id}</span>
          </summary>
          <ZoneFacts zone={properties} now_ms={now_ms} />
          {!past && (
            <p>
              <a href={zonesHref(["list", properties.zone_id])}>{t("details")}</a>
            </p>
          )}
        </details>
      ))}
    </MapCard>
  );
}
