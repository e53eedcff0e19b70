import { useCallback, type ReactElement } from "react";
import { withChange, type Place, type PlainRoom } from "../shared/address/location";
import { useApi } from "../shared/api/api";
import { day, dotted } from "../shared/format";
import { useServerNow } from "../shared/live/useLive";
import { Bar, Choice, SearchBox } from "../shared/ui/Filters";
import { More } from "../shared/ui/More";
import { Scroll } from "../shared/ui/Scroll";
import { drones, type DroneFilters, type RegistryDrone } from "./calls";
import { registryHref, toRegistry } from "../shared/address/registryLinks";
import { Status } from "./Status";
import { registryTexts as t } from "./texts";
import { usePages } from "../shared/api/usePages";
import { statusWord } from "./words";

const STATUSES = ["active", "suspended", "retired"] as const;
const PAGE = 50;

export function maintenanceWord(record: RegistryDrone["record"], now_ms: number): string {
  const until_ms = record.maintenance?.valid_until_ms;
  if (until_ms === undefined) return t("maintenanceNone");
  return t(until_ms > now_ms ? "maintenanceUntil" : "maintenanceLapsed", { day: day(until_ms) });
}

/** All drones that the user may see. */
export function DronesPage({ place }: { place: Place & { room: PlainRoom } }): ReactElement {
  const api = useApi();
  const now_ms = useServerNow(60_000);
  const { query: chosen } = place;
  const status = STATUSES.find((each) => each === chosen["status"]);
  const sort = chosen["sort"] === "changed" ? "changed" : "id";
  const filters: DroneFilters = { limit: PAGE, sort, ...(chosen["q"] && { q: chosen["q"] }), ...(status && { status }) };
  const { query, rows } = usePages(["registry", "drones", filters], (cursor) => drones(api, { ...filters, ...(cursor !== undefined && { cursor }) }), { keep: true });
  const set = useCallback(
    (change: Record<string, string>) => toRegistry(["drones"], withChange(chosen, change), true),
    [chosen],
  );
  const search = useCallback((q: string) => set({ q }), [set]);
  return (
    <>
      <Bar
        actions={
          <a className="button primary" href={registryHref(["drones", "new"])}>
            {t("newDrone")}
          </a>
        }
      >
        <SearchBox label={t("search")} value={chosen["q"] ?? ""} hint={t("searchDrones")} onSearch={search} />
        <Choice label={t("status")} value={status ?? ""} options={STATUSES.map((each) => ({ value: each, name: statusWord(each) }))} onChange={(value) => set({ status: value })} />
        <Choice
          label={t("sort")}
          any={null}
          value={sort}
          options={(["id", "changed"] as const).map((each) => ({ value: each, name: t("sortBy", { sort: each }) }))}
          onChange={(value) => set({ sort: value === "id" ? "" : value })}
        />
      </Bar>
      <Scroll label={t("tab", { tab: "drones" })} className="float table-frame" busy={query.isPlaceholderData}>
        {rows.length > 0 && (
          <table className="table num">
            <thead>
              <tr>
                <th scope="col">{t("drone")}</th>
                <th scope="col">{t("status")}</th>
                <th scope="col">{t("model")}</th>
                <th scope="col">{t("operator")}</th>
                <th scope="col">{t("maintenance")}</th>
                <th scope="col" className="right">
                  {t("inForce")}
                </th>
              </tr>
            </thead>
            <tbody>
              {rows.map(({ record, in_force }) => (
                <tr key={record.uav_id}>
                  <th scope="row">
                    <a className="outcome" href={registryHref(["drones", record.uav_id])}>
                      {record.uav_id}
                    </a>
                  </th>
                  <td>
                    <Status status={record.status} />
                  </td>
                  <td>{record.model}</td>
                  <td>
                    {dotted(record.operator_id)} <span className="quiet">· {record.msp_id}</span>
                  </td>
                  <td className={(record.maintenance?.valid_until_ms ?? 0) > now_ms ? "" : "look-inconclusive"}>{maintenanceWord(record, now_ms)}</td>
                  <td className="right">{in_force}</td>
                </tr>
              ))}
            </tbody>
          </table>
        )}
        <More query={query} empty={t("noDrones")} count={rows.length} />
      </Scroll>
    </>
  );
}
