import { useMutation } from "@tanstack/react-query";
import type { ReactElement, ReactNode } from "react";
import { useApi } from "../shared/api/api";
import type { components } from "../shared/api/schema";
import { keepPlan, PlanRefused } from "./calls";
import { readPlan, type Plan } from "./plan";
import { PlanDrawing, PlanLegend } from "./PlanDrawing";
import { planTexts as t } from "./texts";

/** Larger files are refused anyway; the browser need not read them. */
const MOST_BYTES = (3 << 20) + 1;

type Properties = {
  record: components["schemas"]["RegistryPad"]["record"];
  /** What signs the hash of a plan; undefined: that there is none any more. */
  sign: (site_plan_sha256: string | undefined) => ReactNode;
};

/** A plan is chosen, checked, looked at, and only then signed. */
export function SitePlanForm({ record, sign }: Properties): ReactElement {
  const api = useApi();
  const kept = useMutation({
    mutationFn: async (file: File): Promise<{ plan: Plan; sha256: string }> => {
      const text = await file.slice(0, MOST_BYTES).text();
      const { sha256 } = await keepPlan(api, record.pad_id, text);
      return { plan: readPlan(text), sha256 };
    },
  });
  const { error, data } = kept;
  return (
    <>
      <p className="quiet">{t("hint")}</p>
      <label className="field wide">
        {t("file")}
        <input
          type="file"
          accept=".json,.geojson,application/geo+json,application/json"
          // The same file, mended meanwhile, may be chosen again.
          onClick={(event) => {
            event.currentTarget.value = "";
          }}
          onChange={(event) => {
            const [file] = event.target.files ?? [];
            if (file !== undefined) kept.mutate(file);
          }}
        />
      </label>
      {kept.isPending && <p role="status">{t("checking")}</p>}
      {error !== null && (
        <div role="alert">
          <p className="field-error">{error instanceof PlanRefused ? t("refused") : error.message}</p>
          {error instanceof PlanRefused && (
            <ul className="plan-problems">
              {error.problems.map(({ path, message }, i) => (
                <li key={i}>
                  <code>{path}</code> {message}
                </li>
              ))}
            </ul>
          )}
        </div>
      )}
      {data !== undefined && (
        <>
          <p>{t("look")}</p>
          <PlanDrawing plan={data.plan} anchors={record.commissioning?.anchors ?? []} />
          <PlanLegend plan={data.plan} />
          {sign(data.sha256)}
        </>
      )}
      {data === undefined && record.site_plan_sha256 !== undefined && (
        <details>
          <summary>{t("remove")}</summary>
          {sign(undefined)}
        </details>
      )}
    </>
  );
}
