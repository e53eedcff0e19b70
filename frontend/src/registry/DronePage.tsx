import { useQuery, useQueryClient } from "@tanstack/react-query";
import { useCallback, useMemo, type ReactElement, type ReactNode } from "react";
import { placeHash } from "../shared/address/location";
import { Masked } from "../people/Masked";
import { useApi } from "../shared/api/api";
import { day, dayAndTime, dotted, length } from "../shared/format";
import { useServerNow } from "../shared/live/useLive";
import { sharedTexts } from "../shared/texts";
import { RECORD_MS, drone as fetchDrone, type RegistryAuthorisation, type RegistryDrone, type RegistryDroneDetail } from "./calls";
import { ChangeForm } from "./ChangeForm";
import { maintenanceWord } from "./DronesPage";
import { FORMS, formKey, type FormName } from "./forms";
import { History } from "./History";
import { registryHref, toRegistry } from "../shared/address/registryLinks";
import { Status } from "./Status";
import { registryTexts as t } from "./texts";
import { actionList } from "./words";

const DRONE_FORMS = ["suspend", "reactivate", "grant", "maintenance", "retire-drone", "revoke", "withdraw-calibration"] as const;
type DroneForm = (typeof DRONE_FORMS)[number];

function isDroneForm(name: string | undefined): name is DroneForm {
  return DRONE_FORMS.some((each) => each === name);
}

/** What makes sense in the drone's state; the contract has the last word. */
function fitting(status: string): readonly FormName[] {
  if (status === "retired") return [];
  return [status === "suspended" ? "reactivate" : "suspend", "grant", "maintenance", "retire-drone"];
}

function AuthorisationState({ record, now_ms }: { record: RegistryAuthorisation["record"]; now_ms: number }): ReactElement {
  if (record.revoked) return <span className="look-refuted">{t("revoked", { day: record.revoked_ms === undefined ? "" : day(record.revoked_ms) })}</span>;
  if (record.valid_until_ms <= now_ms) return <span className="quiet">{t("over")}</span>;
  if (record.valid_from_ms > now_ms) return <span className="quiet">{t("notYet", { day: day(record.valid_from_ms) })}</span>;
  return <span className="look-verified">{t("holds")}</span>;
}

function Authorisations({ detail, now_ms }: { detail: RegistryDroneDetail; now_ms: number }): ReactElement {
  return (
    <section className="float card">
      <h2>{t("authorisations")}</h2>
      {detail.authorisations.length === 0 ? (
        <p className="quiet">{t("noAuthorisations")}</p>
      ) : (
        <div className="scroll">
          <table className="table num">
            <thead>
              <tr>
                <th scope="col">{t("authorisations")}</th>
                <th scope="col">{t("status")}</th>
                <th scope="col">{t("pad")}</th>
                <th scope="col">{t("actions")}</th>
                <th scope="col">{t("until")}</th>
                <th scope="col">{t("by")}</th>
                <td />
              </tr>
            </thead>
            <tbody>
              {detail.authorisations.map(({ record }) => (
                <tr key={record.authorisation_id}>
                  <th scope="row">{record.authorisation_id}</th>
                  <td>
                    <AuthorisationState record={record} now_ms={now_ms} />
                  </td>
                  <td>{record.pad_id === "*" ? t("anyPad") : record.pad_id}</td>
                  <td>{actionList(record.actions)}</td>
                  <td>{day(record.valid_until_ms)}</td>
                  <td>{record.granted_by}</td>
                  <td className="right">
                    {!record.revoked && record.valid_until_ms > now_ms && (
                      <a className="button" href={registryHref(["drones", record.uav_id, "revoke", record.authorisation_id])}>
                        {t("form", { form: "revoke" })}
                      </a>
                    )}
                  </td>
                </tr>
              ))}
            </tbody>
          </table>
        </div>
      )}
    </section>
  );
}

function Calibrations({ detail, now_ms }: { detail: RegistryDroneDetail; now_ms: number }): ReactElement {
  const { calibrations, drone } = detail;
  return (
    <section className="float card">
      <h2>{t("calibrations")}</h2>
      <p className="quiet">{t(calibrations.length === 0 ? "noCalibrations" : "calibrationHint")}</p>
      {calibrations.length > 0 && (
        <div className="scroll">
          <table className="table num">
            <thead>
              <tr>
                {(["pad", "offset", "status", "measured", "until", "calibratedBy"] as const).map((each) => (
                  <th key={each} scope="col">
                    {t(each)}
                  </th>
                ))}
                <td />
              </tr>
            </thead>
            <tbody>
              {calibrations.map(({ record, state }) => (
                <tr key={record.pad_id}>
                  <th scope="row">{record.pad_id}</th>
                  <td title={record.node}>{t("offsetIs", { offset: length(record.offset_mm), sigma: length(record.sigma_mm) })}</td>
                  <td className={state === "holds" ? "look-verified" : "quiet"} title={record.withdrawn}>
                    {t("calibrationIs", { state })}
                  </td>
                  <td>{dayAndTime(record.measured_ms, now_ms)}</td>
                  <td>{day(record.valid_until_ms)}</td>
                  <td>{`${record.registered_by} · ${record.msp_id}`}</td>
                  <td className="right">
                    {state === "holds" && (
                      <a className="button" href={registryHref(["drones", drone.record.uav_id, "withdraw-calibration", record.pad_id])}>
                        {t("form", { form: "withdraw_calibration" })}
                      </a>
                    )}
                  </td>
                </tr>
              ))}
            </tbody>
          </table>
        </div>
      )}
    </section>
  );
}

/** The operator's number, as far as this server has it. */
function Registration({ uav_id, registration }: { uav_id: string; registration: RegistryDrone["registration"] }): ReactElement {
  const { state, number, held_by } = registration;
  if (number !== undefined) return <Masked value={number} uav_id={uav_id} field="registration" />;
  if (state === "altered") return <span className="look-refuted">{t("numberAltered")}</span>;
  return <>{state === "elsewhere" ? t("numberElsewhere", { msp: held_by ?? "" }) : "–"}</>;
}

function Record({ detail, now_ms }: { detail: RegistryDroneDetail; now_ms: number }): ReactElement {
  const { record } = detail.drone;
  const facts: [string, ReactNode][] = [
    [t("model"), record.model],
    [t("operator"), `${dotted(record.operator_id)} · ${record.msp_id}`],
    [t("registration"), <Registration key={record.uav_id} uav_id={record.uav_id} registration={detail.drone.registration} />],
    [t("maintenance"), maintenanceWord(record, now_ms)],
    [t("registered"), day(record.registered_ms)],
    [t("changed"), dayAndTime(record.updated_ms, now_ms)],
  ];
  if (record.status_reason !== undefined) facts.push([t("reason"), record.status_reason]);
  return (
    <section className="float card">
      <h2>{t("record")}</h2>
      <dl className="facts num">
        {facts.map(([name, value]) => (
          <div key={name}>
            <dt>{name}</dt>
            <dd className="wrap">{value}</dd>
          </div>
        ))}
      </dl>
    </section>
  );
}

/** One drone: its record, what can be done, its authorisations, who changed what. */
export function DronePage({ uav_id, form, part, reason }: { uav_id: string; form: string | undefined; part: string | undefined; reason?: string | undefined }): ReactElement {
  const api = useApi();
  const client = useQueryClient();
  const now_ms = useServerNow(30_000);
  const query = useQuery({ queryKey: ["registry", "drone", uav_id], queryFn: () => fetchDrone(api, uav_id), refetchInterval: RECORD_MS });
  const fresh = useCallback(() => client.invalidateQueries({ queryKey: ["registry"] }), [client]);
  const suggested = useMemo(() => (form === "suspend" && reason !== undefined ? { reason: reason.slice(0, 200) } : undefined), [form, reason]);
  const detail = query.data;
  if (detail === undefined) {
    return (
      <p className="empty" role={query.isError ? "alert" : "status"}>
        {query.isError ? query.error.message : sharedTexts("fetching")}
      </p>
    );
  }
  const { record, version } = detail.drone;
  const back = (): void => toRegistry(["drones", uav_id]);
  const authorisation = form === "revoke" ? detail.authorisations.find((each) => each.record.authorisation_id === part) : undefined;
  const calibration = form === "withdraw-calibration" ? detail.calibrations.find((each) => each.record.pad_id === part) : undefined;
  const about = {
    uav_id,
    ...(authorisation !== undefined && { authorisation_id: authorisation.record.authorisation_id }),
    ...(calibration !== undefined && { pad_id: calibration.record.pad_id }),
  };
  const before = authorisation ?? (form === "grant" ? undefined : { record, version });
  return (
    <>
      <div className="registry-head">
        <h2>{uav_id}</h2>
        <Status status={record.status} />
        <a className="button" href={placeHash({ room: "live", drone: uav_id })}>
          {t("showOnMap")}
        </a>
        <a className="button" href={placeHash({ room: "verdicts", filters: { drone: uav_id } })}>
          {t("sessions")}
        </a>
      </div>
      <nav className="form-actions actions-row" aria-label={t("what")}>
        {fitting(record.status).map((each) => (
          <a key={each} className={`button ${FORMS[each].danger === true ? "danger" : ""}`} href={registryHref(["drones", uav_id, each])} aria-current={each === form ? "true" : undefined}>
            {t("form", { form: formKey(each) })}
          </a>
        ))}
      </nav>
      {isDroneForm(form) && (form !== "revoke" || authorisation !== undefined) && (form !== "withdraw-calibration" || calibration !== undefined) && (
        <section className="float card" aria-labelledby="registry-form">
          <h2 id="registry-form">
            {t("form", { form: formKey(form) })} <span className="quiet">· {authorisation?.record.authorisation_id ?? calibration?.record.pad_id ?? uav_id}</span>
          </h2>
          <ChangeForm
            key={`${form} ${part ?? ""}`}
            name={form}
            about={about}
            before={before}
            suggested={suggested}
            onReload={fresh}
            onDone={() => void fresh()}
            onCancel={back}
          />
        </section>
      )}
      <div className="registry-record">
        <Record detail={detail} now_ms={now_ms} />
        <div className="registry-stack">
          <Authorisations detail={detail} now_ms={now_ms} />
          <Calibrations detail={detail} now_ms={now_ms} />
        </div>
      </div>
      <History kind="drone" id={uav_id} />
    </>
  );
}
