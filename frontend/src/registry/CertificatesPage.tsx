import { useCallback, type ReactElement } from "react";
import { withChange, type Place, type PlainRoom } from "../shared/address/location";
import { blockHref } from "../shared/address/ledgerLinks";
import { useApi } from "../shared/api/api";
import { count, day } from "../shared/format";
import { roleName } from "../shared/signing/texts";
import { Hash } from "../shared/ui/Hash";
import { Bar, SearchBox } from "../shared/ui/Filters";
import { More } from "../shared/ui/More";
import { Scroll } from "../shared/ui/Scroll";
import { certificates, type CertificateFilters } from "./calls";
import { toRegistry } from "../shared/address/registryLinks";
import { registryTexts as t } from "./texts";
import { usePages } from "../shared/api/usePages";

const PAGE = 50;
const LOOKS = { valid: "verified", expiring: "inconclusive", expired: "silent", revoked: "refuted" } as const;

/** Certificates that have acted on the chain; those that end first first. */
export function CertificatesPage({ place }: { place: Place & { room: PlainRoom } }): ReactElement {
  const api = useApi();
  const { query: chosen } = place;
  const expiring = chosen["expiring"] === "1";
  const filters: CertificateFilters = { limit: PAGE, ...(chosen["q"] && { q: chosen["q"] }), ...(chosen["msp"] && { msp: chosen["msp"] }), ...(expiring && { expiring }) };
  const { query, rows } = usePages(["registry", "certificates", filters], (cursor) => certificates(api, { ...filters, ...(cursor !== undefined && { cursor }) }), { keep: true });
  const set = useCallback(
    (change: Record<string, string>) => toRegistry(["certificates"], withChange(chosen, change), true),
    [chosen],
  );
  const search = useCallback((q: string) => set({ q }), [set]);
  return (
    <>
      <Bar>
        <SearchBox label={t("search")} value={chosen["q"] ?? ""} hint={t("searchCertificates")} onSearch={search} />
        <label>
          <input type="checkbox" checked={expiring} onChange={(event) => set({ expiring: event.target.checked ? "1" : "" })} /> {t("expiringOnly")}
        </label>
        {chosen["msp"] !== undefined && (
          <button type="button" className="button" onClick={() => set({ msp: "" })}>
            {t("organisation")}: {chosen["msp"]} ×
          </button>
        )}
      </Bar>
      <Scroll label={t("tab", { tab: "certificates" })} className="float table-frame">
        {rows.length > 0 && (
          <table className="table num">
            <thead>
              <tr>
                <th scope="col">{t("certificate")}</th>
                <th scope="col">{t("organisation")}</th>
                <th scope="col">{t("role")}</th>
                <th scope="col">{t("status")}</th>
                <th scope="col">{t("until")}</th>
                <th scope="col">{t("lastSeen")}</th>
                <th scope="col">SHA-256</th>
              </tr>
            </thead>
            <tbody>
              {rows.map((each) => (
                <tr key={each.certificate_sha256}>
                  <th scope="row">{each.name}</th>
                  <td>{each.msp_id}</td>
                  <td>
                    {each.role === "" ? each.node_ou : roleName(each.role)}
                    {each.pol_id !== "" && each.pol_id !== each.name && <span className="quiet"> · {each.pol_id}</span>}
                  </td>
                  <td className={`look-${LOOKS[each.state]}`}>{t("state", { state: each.state })}</td>
                  <td>{day(each.not_after_ms)}</td>
                  <td>
                    <a href={blockHref(each.last_block)}>{count(each.last_block)}</a>
                  </td>
                  <td>
                    <Hash value={each.certificate_sha256} label={t("certificate")} />
                  </td>
                </tr>
              ))}
            </tbody>
          </table>
        )}
        <More query={query} empty={t("noCertificates")} count={rows.length} />
      </Scroll>
    </>
  );
}
