import type { ReactElement } from "react";
import type { Pad } from "../shared/api/records";
import { sharedTexts } from "../shared/texts";
import { Hash } from "../shared/ui/Hash";
import { PlanDrawing, PlanLegend } from "./PlanDrawing";
import { planTexts as t } from "./texts";
import { usePlan } from "./usePlans";

type Properties = { pad_id: string; sha256: string | undefined; anchors: NonNullable<Pad["commissioning"]>["anchors"] | undefined; then?: boolean };

/** The plan that holds, or (`then`) that held when a session was requested. */
export function SitePlanCard({ pad_id, sha256, anchors = [], then = false }: Properties): ReactElement {
  const found = usePlan(pad_id, sha256);
  return (
    <section className="float card">
      <h2>{t("plan")}</h2>
      {then && <p className="quiet">{t("heldThen")}</p>}
      {sha256 === undefined ? (
        <p className="quiet">{t("none")}</p>
      ) : found.data === undefined ? (
        <p role={found.isError ? "alert" : "status"}>{found.isError ? t("missing", { why: found.error.message }) : sharedTexts("fetching")}</p>
      ) : (
        <>
          <PlanDrawing plan={found.data} anchors={anchors} />
          <PlanLegend plan={found.data} />
          <p className="quiet">
            SHA-256 <Hash value={sha256} label={t("plan")} />
          </p>
        </>
      )}
    </section>
  );
}
