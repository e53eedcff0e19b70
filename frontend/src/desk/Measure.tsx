import type { ReactElement } from "react";
import { length } from "../shared/format";
import type { LonLat } from "../shared/geo/frame";
import { leg } from "../shared/geo/geodesic";
import { mapTexts } from "../map/texts";
import { deskTexts as t } from "./texts";

type Properties = { points: readonly LonLat[]; onUndo: () => void; onEnd: () => void };

function total(points: readonly LonLat[]): string {
  const legs = points.slice(1).map((to, i) => leg(points[i] ?? to, to));
  const distance_m = legs.reduce((sum, each) => sum + each.distance_m, 0);
  const bearing = Math.round(legs.at(-1)?.bearing ?? 0) % 360;
  return t("measureTotal", { legs: legs.length, distance: length(distance_m * 1000), bearing });
}

/** What is measured, in words; the legs are on the map. */
export function MeasureBar({ points, onUndo, onEnd }: Properties): ReactElement {
  return (
    <section className="float measure" aria-label={mapTexts("measure")}>
      <p className="num" role="status">
        <b>{total(points)}</b>
      </p>
      <p className="quiet">{t("measureHelp")}</p>
      <div>
        <button type="button" className="button" disabled={points.length === 0} onClick={onUndo}>
          {t("measureUndo")}
        </button>
        <button type="button" className="button" onClick={onEnd}>
          {t("measureEnd")}
        </button>
      </div>
    </section>
  );
}
