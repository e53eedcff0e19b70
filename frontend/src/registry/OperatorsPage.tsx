import { useQuery } from "@tanstack/react-query";
import type { ReactElement } from "react";
import { blockHref } from "../shared/address/ledgerLinks";
import { useApi } from "../shared/api/api";
import { count, day } from "../shared/format";
import { sharedTexts } from "../shared/texts";
import { organisations, type RegistryOrganisation } from "./calls";
import { registryHref } from "../shared/address/registryLinks";
import { registryTexts as t } from "./texts";

function Organisation({ found }: { found: RegistryOrganisation }): ReactElement {
  return (
    <section className="float card">
      <h2>
        {found.msp_id} {!found.application && <span className="tag">{t("ordersOnly")}</span>}
      </h2>
      <dl className="facts num">
        <div>
          <dt>{t("authorities")}</dt>
          <dd>
            {found.authorities.map((each) => (
              <span key={each.serial} className="party-line wrap">
                {each.name} <span className="quiet">{t("untilDay", { day: day(each.not_after_ms) })}</span>
              </span>
            ))}
          </dd>
        </div>
        <div>
          <dt>{t("pads")}</dt>
          <dd>{count(found.pads)}</dd>
        </div>
        <div>
          <dt>{t("drones")}</dt>
          <dd>{count(found.drones)}</dd>
        </div>
        <div>
          <dt>{t("seen")}</dt>
          <dd>
            <a href={registryHref(["certificates"], { msp: found.msp_id })}>{count(found.certificates)}</a>
          </dd>
        </div>
        <div>
          <dt>{t("revokedCount")}</dt>
          <dd>{count(found.revoked)}</dd>
        </div>
        <div>
          <dt>{t("changed")}</dt>
          <dd>
            <a href={blockHref(found.version.block)}>{t("inBlock", { block: count(found.version.block) })}</a>
          </dd>
        </div>
      </dl>
    </section>
  );
}

/** The organisations of the channel. */
export function OperatorsPage(): ReactElement {
  const api = useApi();
  const query = useQuery({ queryKey: ["registry", "organisations"], queryFn: () => organisations(api) });
  if (query.data === undefined) {
    return (
      <p className="empty" role={query.isError ? "alert" : "status"}>
        {query.isError ? query.error.message : sharedTexts("fetching")}
      </p>
    );
  }
  return (
    <>
      <p className="quiet lead">{t("organisationHint", { block: count(query.data[0]?.version.block ?? 0) })}</p>
      <div className="registry-columns">
        {query.data.map((each) => (
          <Organisation key={each.msp_id} found={each} />
        ))}
      </div>
    </>
  );
}
