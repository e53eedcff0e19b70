import { useQuery } from "@tanstack/react-query";
import { useCallback, type ReactElement } from "react";
import { withChange, type Place, type PlainRoom } from "../shared/address/location";
import { useApi } from "../shared/api/api";
import { day } from "../shared/format";
import { Bar, Choice, SearchBox } from "../shared/ui/Filters";
import { More } from "../shared/ui/More";
import { commonPolicies, pads, type PadFilters } from "./calls";
import { ChangeForm } from "./ChangeForm";
import { registryHref, toRegistry } from "../shared/address/registryLinks";
import { isAction, Policies, policyBefore } from "./Policies";
import { Status } from "./Status";
import { registryTexts as t } from "./texts";
import { usePages } from "../shared/api/usePages";
import { statusWord } from "./words";

const STATUSES = ["registered", "commissioned", "retired"] as const;
const PAGE = 50;

/** The policies that hold where a pad has none of its own. `#/registry/pads?policy=land` opens the form. */
function Common({ action }: { action: string | undefined }): ReactElement | null {
  const api = useApi();
  const query = useQuery({ queryKey: ["registry", "policies"], queryFn: () => commonPolicies(api) });
  if (query.data === undefined) return null;
  const chosen = isAction(action) ? query.data.find((each) => each.action === action) : undefined;
  return (
    <section className="float card">
      <h2>{t("commonPolicies")}</h2>
      <p className="quiet">{t("commonHint")}</p>
      <Policies policies={query.data} pad_id="*" hrefOf={(each) => registryHref(["pads"], { policy: each })} />
      {chosen !== undefined && (
        <ChangeForm
          key={chosen.action}
          name="policy"
          about={{ pad_id: "*", action: chosen.action }}
          before={policyBefore(chosen)}
          onReload={() => query.refetch()}
          onDone={() => void query.refetch()}
          onCancel={() => toRegistry(["pads"])}
        />
      )}
    </section>
  );
}

/** All pads that the user may see. */
export function PadsPage({ place }: { place: Place & { room: PlainRoom } }): ReactElement {
  const api = useApi();
  const { query: chosen } = place;
  const status = STATUSES.find((each) => each === chosen["status"]);
  const filters: PadFilters = { limit: PAGE, ...(chosen["q"] && { q: chosen["q"] }), ...(status && { status }) };
  const { query, rows } = usePages(["registry", "pads", filters], (cursor) => pads(api, { ...filters, ...(cursor !== undefined && { cursor }) }), { keep: true });
  const set = useCallback(
    (change: Record<string, string>) => toRegistry(["pads"], withChange(chosen, change), true),
    [chosen],
  );
  const search = useCallback((q: string) => set({ q }), [set]);
  return (
    <>
      <Bar
        actions={
          <a className="button primary" href={registryHref(["pads", "new"])}>
            {t("newPad")}
          </a>
        }
      >
        <SearchBox label={t("search")} value={chosen["q"] ?? ""} hint={t("searchPads")} onSearch={search} />
        <Choice label={t("status")} value={status ?? ""} options={STATUSES.map((each) => ({ value: each, name: statusWord(each) }))} onChange={(value) => set({ status: value })} />
      </Bar>
      <div className="float table-frame" aria-busy={query.isPlaceholderData}>
        {rows.length > 0 && (
          <table className="table num">
            <thead>
              <tr>
                <th scope="col">{t("pad")}</th>
                <th scope="col">{t("status")}</th>
                <th scope="col">{t("operator")}</th>
                <th scope="col" className="right">
                  {t("anchors")}
                </th>
                <th scope="col">{t("commissioning")}</th>
              </tr>
            </thead>
            <tbody>
              {rows.map(({ record }) => (
                <tr key={record.pad_id}>
                  <th scope="row">
                    <a className="outcome" href={registryHref(["pads", record.pad_id])}>
                      {record.name}
                    </a>{" "}
                    <span className="quiet">{record.pad_id}</span>
                  </th>
                  <td>
                    <Status status={record.status} />
                  </td>
                  <td>
                    {record.operator_id} <span className="quiet">· {record.msp_id}</span>
                  </td>
                  <td className="right">{record.commissioning?.anchors.length ?? "–"}</td>
                  <td>{record.commissioning === undefined ? "–" : t("untilDay", { day: day(record.commissioning.valid_until_ms) })}</td>
                </tr>
              ))}
            </tbody>
          </table>
        )}
        <More query={query} empty={t("noPads")} count={rows.length} />
      </div>
      <Common action={chosen["policy"]} />
    </>
  );
}
