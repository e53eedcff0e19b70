import { useMutation } from "@tanstack/react-query";
import { useEffect, useState, type SyntheticEvent, type ReactElement } from "react";
import { useOfficer } from "../shared/api/who";
import { dotted } from "../shared/format";
import { useDraft } from "../shared/useDraft";
import { usePeopleApi, type MaskedField } from "./api";
import "./people.css";
import { auditTexts as t } from "./texts";

/** An operator's number in part; officers may see all of it for a while, with a reason that is recorded. */
export function Masked({ value, uav_id, field }: { value: string; uav_id: string; field: MaskedField }): ReactElement {
  const api = usePeopleApi();
  const officer = useOfficer();
  const [reason, setReason, clearReason] = useDraft(`unmask/${uav_id}/${field}`, "");
  const [asking, setAsking] = useState(reason !== "");
  const leave = (): void => {
    clearReason();
    setAsking(false);
  };
  const show = useMutation({ mutationFn: () => api.unmask(uav_id, field, reason), onSuccess: leave });
  const { data, reset } = show;
  useEffect(() => {
    if (data === undefined) return undefined;
    const timer = setTimeout(reset, data.show_ms);
    return () => clearTimeout(timer);
  }, [data, reset]);
  const submit = (event: SyntheticEvent): void => {
    event.preventDefault();
    show.mutate();
  };
  if (data !== undefined) {
    return (
      <span className="masked">
        <span className="mono">{data.value}</span>
        <small className="quiet">{t("shown", { seconds: Math.round(data.show_ms / 1000) })}</small>
      </span>
    );
  }
  return (
    <span className="masked">
      <span className="mono">{dotted(value)}</span>
      {officer && value.includes("---") && !asking && (
        <button type="button" className="button" onClick={() => setAsking(true)}>
          {t("show")}
        </button>
      )}
      {asking && (
        <form onSubmit={submit}>
          <input aria-label={t("why")} placeholder={t("why")} title={t("whyHint")} value={reason} onChange={(event) => setReason(event.target.value)} minLength={5} maxLength={500} required />
          <button type="submit" className="button primary" disabled={show.isPending}>
            {t("show")}
          </button>
          <button type="button" className="button" onClick={leave}>
            {t("cancel")}
          </button>
        </form>
      )}
      {show.error !== null && <span role="alert">{show.error.message}</span>}
    </span>
  );
}
