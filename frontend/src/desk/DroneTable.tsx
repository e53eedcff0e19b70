import { useState, type ReactElement } from "react";
import { rowText } from "../sessions/words";
import type { Fleet } from "../shared/fleet";
import { age, coordinates, count, length, speed } from "../shared/format";
import { useLiveStore } from "../shared/live/useLive";
import { lookTexts } from "../shared/texts";
import { Symbol } from "../shared/ui/Symbol";
import { deskTexts as t } from "./texts";

const PAGE = 200;

/** All that the map shows, in words and figures, in the order of need. */
export function DroneTable({ fleet, hrefOf, now_ms }: { fleet: Fleet; hrefOf: (uav_id: string) => string; now_ms: number }): ReactElement {
  const store = useLiveStore();
  const [most, setMost] = useState(PAGE);
  const rows = fleet.rows("all");
  const padName = (pad_id: string): string => store.pads.get(pad_id)?.name ?? pad_id;
  const shown = Array.from({ length: Math.min(most, rows.length) }, (_, i) => rows.at(i)).filter((drone) => drone !== undefined);
  return (
    <div className="map-table">
      <table className="table num">
        <caption>{t("caption", { shown: rows.length })}</caption>
        <thead>
          <tr>
            <th scope="col">{t("drone")}</th>
            <th scope="col">{t("state")}</th>
            <th scope="col">{t("decided")}</th>
            <th scope="col">{t("where")}</th>
            <th scope="col">{t("height")}</th>
            <th scope="col">{t("accuracy")}</th>
            <th scope="col">{t("speed")}</th>
            <th scope="col">{t("heardBy")}</th>
            <th scope="col">{t("heard")}</th>
          </tr>
        </thead>
        <tbody>
          {shown.map((drone) => {
            const { track } = drone;
            const { right, second } = rowText(drone, padName);
            return (
              <tr key={drone.uav_id}>
                <th scope="row">
                  <a href={hrefOf(drone.uav_id)}>{drone.uav_id}</a>
                </th>
                <td>
                  <span className={`with-symbol look-${drone.look}`}>
                    <Symbol look={drone.look} size={16} />
                    {lookTexts(drone.look)}
                  </span>
                </td>
                <td>
                  {second} · {right}
                </td>
                <td>{track === undefined ? "–" : coordinates(track.lat_e7, track.lon_e7)}</td>
                <td>{track?.height_mm === undefined ? "–" : length(track.height_mm, true)}</td>
                <td>{track?.accuracy_mm === undefined ? "–" : length(track.accuracy_mm, true)}</td>
                <td>{track?.speed_mm_s === undefined ? "–" : speed(track.speed_mm_s)}</td>
                <td>{track === undefined ? "–" : padName(track.pad_id)}</td>
                <td>{track === undefined ? "–" : age(now_ms - track.t_ms)}</td>
              </tr>
            );
          })}
        </tbody>
      </table>
      {rows.length === 0 && <p className="empty">{t("nothing", { tab: "all" })}</p>}
      {rows.length > most && (
        <p className="more">
          <button type="button" className="button" onClick={() => setMost(most + PAGE)}>
            {t("more", { count: count(Math.min(PAGE, rows.length - most)) })}
          </button>
        </p>
      )}
    </div>
  );
}
