import { useQuery, useQueryClient } from "@tanstack/react-query";
import { useCallback, type ReactElement } from "react";
import { placeHash } from "../shared/address/location";
import { SitePlanCard } from "../plans/SitePlanCard";
import { SitePlanForm } from "../plans/SitePlanForm";
import { useApi } from "../shared/api/api";
import { ago, coordinates, count, day, dayAndTime, length } from "../shared/format";
import { useLive, useServerNow } from "../shared/live/useLive";
import type { Topic } from "../shared/live/store";
import { sharedTexts } from "../shared/texts";
import { Hash } from "../shared/ui/Hash";
import { RECORD_MS, pad as fetchPad, type RegistryPadDetail } from "./calls";
import { ChangeForm } from "./ChangeForm";
import { FORMS, formKey } from "./forms";
import { History } from "./History";
import { registryHref, toRegistry } from "../shared/address/registryLinks";
import { AnchorPlan, BiasPlot, ReachPlot, type Commissioning } from "./PadPlots";
import { isAction, Policies, policyBefore } from "./Policies";
import type { JsonObject } from "../shared/signing/canonical";
import { QueueCard } from "./QueueCard";
import { Status } from "./Status";
import { registryTexts as t } from "./texts";

const TOPICS: readonly Topic[] = ["pads"];
/** Of one session in the pad's queue, or of one reservation; a new one is of none. */
const QUEUE_FORMS = ["put-first", "departed", "turn-away", "reserve", "cancel-reservation"] as const;

function aboutQueued(form: (typeof QUEUE_FORMS)[number], pad_id: string, part: string): JsonObject {
  if (form === "reserve") return { pad_id };
  return form === "cancel-reservation" ? { pad_id, reservation_id: part } : { session_id: part };
}
const PAD_FORMS = ["edit-pad", "commission", "site-plan", "retire-pad"] as const;

function Facts({ rows }: { rows: readonly (readonly [string, string])[] }): ReactElement {
  return (
    <dl className="facts num">
      {rows.map(([name, value]) => (
        <div key={name}>
          <dt>{name}</dt>
          <dd className="wrap">{value}</dd>
        </div>
      ))}
    </dl>
  );
}

/** What bounds the assurance that a proof at this pad can have; nodes that nobody asked count as able. */
function bearing({ nodes, timestamp_sigma_mm }: Commissioning): string {
  if (nodes?.sts === "static") return "static";
  if (nodes?.blinks === "none") return "blind";
  return timestamp_sigma_mm === undefined ? "unclocked" : "timed";
}

function Commissioned({ detail }: { detail: RegistryPadDetail }): ReactElement {
  const { commissioning, commissioning_sha256 } = detail.pad.record;
  const { reach } = detail;
  if (commissioning === undefined) return <p className="quiet">{t("notCommissioned")}</p>;
  const middle = reach[Math.floor((reach.length - 1) / 2)];
  return (
    <>
      {middle !== undefined && <p>{t("reachWords", { distance: length(middle.distance_mm, true), buffer: length(middle.buffer_mm) })}</p>}
      <div className="plots">
        <AnchorPlan commissioning={commissioning} />
        <ReachPlot reach={reach} />
        <BiasPlot commissioning={commissioning} />
      </div>
      <Facts
        rows={[
          [t("method"), commissioning.method],
          [t("valid"), t("validSpan", { from: day(commissioning.valid_from_ms), until: day(commissioning.valid_until_ms) })],
          [t("rangeSigma"), length(commissioning.range_sigma_mm)],
          [t("installationSigma"), length(commissioning.installation_sigma_mm)],
          [t("maxRange"), length(commissioning.max_range_mm, true)],
          [t("assurance"), t("assuranceReached", { by: bearing(commissioning) })],
        ]}
      />
      {commissioning_sha256 !== undefined && (
        <p className="quiet">
          SHA-256 <Hash value={commissioning_sha256} label={t("commissioning")} />
        </p>
      )}
    </>
  );
}

function HealthCard({ pad_id, now_ms }: { pad_id: string; now_ms: number }): ReactElement {
  const health = useLive(TOPICS, (store) => store.pads.get(pad_id)?.health);
  return (
    <section className="float card">
      <h2>{t("health")}</h2>
      {health === undefined ? (
        <p className="quiet">{t("noHealth")}</p>
      ) : (
        <>
          <p>{t("healthIs", { connected: String(health.connected), ago: ago(now_ms - health.t_ms) })}</p>
          <Facts
            rows={[
              [
                t("anchors"),
                health.anchors
                  .map(({ anchor_id, state, detail }) => `${anchor_id} ${t("anchorState", { state })}${detail === undefined ? "" : ` (${detail})`}`)
                  .join(" · "),
              ],
              [t("prekeys"), health.prekeys === undefined ? "–" : count(health.prekeys)],
              [t("version"), health.version ?? "–"],
            ]}
          />
        </>
      )}
    </section>
  );
}

/** One pad: its record, what it was commissioned to, what holds there, who changed what. */
export function PadPage({ pad_id, form, part }: { pad_id: string; form: string | undefined; part: string | undefined }): ReactElement {
  const api = useApi();
  const client = useQueryClient();
  const now_ms = useServerNow(30_000);
  const query = useQuery({ queryKey: ["registry", "pad", pad_id], queryFn: () => fetchPad(api, pad_id), refetchInterval: RECORD_MS });
  const fresh = useCallback(() => client.invalidateQueries({ queryKey: ["registry"] }), [client]);
  const detail = query.data;
  if (detail === undefined) {
    return (
      <p className="empty" role={query.isError ? "alert" : "status"}>
        {query.isError ? query.error.message : sharedTexts("fetching")}
      </p>
    );
  }
  const { record, version } = detail.pad;
  const back = (): void => toRegistry(["pads", pad_id]);
  const chosen = PAD_FORMS.find((each) => each === form);
  const policy = form === "policy" && isAction(part) ? detail.policies.find((each) => each.action === part) : undefined;
  const queued = part === undefined ? undefined : QUEUE_FORMS.find((each) => each === form);
  return (
    <>
      <div className="registry-head">
        <h2>{record.name}</h2>
        <span className="quiet">{pad_id}</span>
        <Status status={record.status} />
        <a className="button" href={placeHash({ room: "live", camera: { lat: record.lat_e7 / 1e7, lon: record.lon_e7 / 1e7, zoom: 18 } })}>
          {t("showOnMap")}
        </a>
        <a className="button" href={placeHash({ room: "verdicts", filters: { pad: pad_id } })}>
          {t("sessions")}
        </a>
      </div>
      {record.status !== "retired" && (
        <nav className="form-actions actions-row" aria-label={t("what")}>
          {PAD_FORMS.map((each) => (
            <a key={each} className={`button ${FORMS[each].danger === true ? "danger" : ""}`} href={registryHref(["pads", pad_id, each])} aria-current={each === form ? "true" : undefined}>
              {t("form", { form: formKey(each) })}
            </a>
          ))}
        </nav>
      )}
      {queued !== undefined && part !== undefined && (
        <section className="float card" aria-labelledby="queue-form">
          <h2 id="queue-form">
            {t("form", { form: formKey(queued) })} <span className="quiet">· {queued === "reserve" ? record.name : `${part.slice(0, 12)}…`}</span>
          </h2>
          <ChangeForm key={`${queued} ${part}`} name={queued} about={aboutQueued(queued, pad_id, part)} onDone={() => void fresh()} onCancel={back} />
        </section>
      )}
      {(chosen !== undefined || policy !== undefined) && (
        <section className="float card" aria-labelledby="registry-form">
          <h2 id="registry-form">
            {t("form", { form: chosen === undefined ? "policy" : formKey(chosen) })} <span className="quiet">· {record.name}</span>
          </h2>
          {chosen === "site-plan" ? (
            <SitePlanForm
              record={record}
              sign={(site_plan_sha256) => (
                <ChangeForm key={site_plan_sha256} name="site-plan" about={{ pad_id, ...(site_plan_sha256 !== undefined && { site_plan_sha256 }) }} before={{ record, version }} onReload={fresh} onDone={() => void fresh()} onCancel={back} />
              )}
            />
          ) : (
            <ChangeForm
              key={`${form ?? ""} ${part ?? ""}`}
              name={chosen ?? "policy"}
              about={policy === undefined ? { pad_id } : { pad_id, action: policy.action }}
              before={policy === undefined ? { record, version } : policyBefore(policy)}
              onReload={fresh}
              onDone={() => void fresh()}
              onCancel={back}
            />
          )}
        </section>
      )}
      {record.status !== "retired" && <QueueCard pad_id={pad_id} chosen={queued === undefined ? undefined : `${queued} ${part ?? ""}`} />}
      <div className="registry-columns">
        <div className="registry-stack">
        <section className="float card">
          <h2>{t("record")}</h2>
          <Facts
            rows={[
              [t("operator"), `${record.operator_id} · ${record.msp_id}`],
              [t("position"), coordinates(record.lat_e7, record.lon_e7)],
              [t("registered"), day(record.registered_ms)],
              [t("changed"), dayAndTime(record.updated_ms, now_ms)],
              ...(record.note === undefined ? [] : [[t("note"), record.note] as const]),
            ]}
          />
        </section>
        <HealthCard pad_id={pad_id} now_ms={now_ms} />
        </div>
        <SitePlanCard pad_id={pad_id} sha256={record.site_plan_sha256} anchors={record.commissioning?.anchors} />
      </div>
      <section className="float card">
        <h2>{t("policies")}</h2>
        <p className="quiet">{t("policyHint")}</p>
        <Policies policies={detail.policies} pad_id={pad_id} hrefOf={(action) => registryHref(["pads", pad_id, "policy", action])} />
      </section>
      <section className="float card">
        <h2>{t("commissioning")}</h2>
        <Commissioned detail={detail} />
      </section>
      <History kind="pad" id={pad_id} />
    </>
  );
}
