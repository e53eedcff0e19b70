import { useMutation, useQuery } from "@tanstack/react-query";
import { useEffect, useRef, useState, type ReactElement, type SyntheticEvent } from "react";
import { bytes, count, day, timeOfDay } from "../shared/format";
import type { Area, ExportFormat, ReplayApi } from "./api";
import { replayTexts as t } from "./texts";
import { typedTime } from "./typedTime";

const FORMATS: readonly ExportFormat[] = ["geojson", "csv", "mfjson"];
const LOOK_MS = 1_000;

type Properties = {
  api: ReplayApi;
  from_ms: number;
  until_ms: number;
  now_ms: number;
  drone: string | undefined;
  pad: string | undefined;
  /** What the map shows; undefined before it shows anything. */
  area: () => Area | undefined;
  onClose: () => void;
};

function When({ label, value_ms, now_ms, onChange }: { label: string; value_ms: number; now_ms: number; onChange: (t_ms: number) => void }): ReactElement {
  const [text, setText] = useState(`${new Date(value_ms).toISOString().slice(0, 19)}Z`);
  const read = typedTime(text, now_ms);
  return (
    <label>
      <span>{label}</span>
      <input
        type="text"
        value={text}
        maxLength={60}
        aria-invalid={read === undefined}
        onChange={(event) => {
          setText(event.target.value);
          const t_ms = typedTime(event.target.value, now_ms);
          if (t_ms !== undefined) onChange(Math.round(t_ms));
        }}
      />
      <small className={read === undefined ? "look-inconclusive" : "quiet"}>
        {read === undefined ? t("timeUnknown", { hint: t("timeHint") }) : `${day(read)}, ${timeOfDay(read)}`}
      </small>
    </label>
  );
}

/** A window of the past as files. */
export function ExportDialog({ api, from_ms, until_ms, now_ms, drone, pad, area, onClose }: Properties): ReactElement {
  const dialog = useRef<HTMLDialogElement>(null);
  const [format, setFormat] = useState<ExportFormat>("geojson");
  const [begin_ms, setBegin] = useState(Math.max(0, from_ms));
  const [end_ms, setEnd] = useState(Math.min(until_ms, Math.round(now_ms)));
  const [onlyDrone, setOnlyDrone] = useState(drone !== undefined);
  const [onlyPad, setOnlyPad] = useState(false);
  const [onlyArea, setOnlyArea] = useState(false);
  useEffect(() => dialog.current?.showModal(), []);
  const offered = useQuery({ queryKey: ["export-formats"], queryFn: () => api.exportFormats() });
  const formats = offered.data ?? FORMATS;
  const chosen = formats.includes(format) ? format : formats[0];
  const prepared = useMutation({
    mutationFn: () => {
      if (chosen === undefined) throw new Error(t("exportsOff"));
      const shown = onlyArea ? area() : undefined;
      return api.prepareExport({
        format: chosen,
        from_ms: begin_ms,
        until_ms: end_ms,
        ...(onlyDrone && drone !== undefined && { drone }),
        ...(onlyPad && pad !== undefined && { pad }),
        ...(shown !== undefined && { area: shown }),
      });
    },
  });
  const progress = useQuery({
    queryKey: ["export", prepared.data?.export_id],
    queryFn: () => api.readExport(prepared.data?.export_id ?? ""),
    enabled: prepared.data !== undefined,
    refetchInterval: (query) => (query.state.data?.state === "done" || query.state.data?.state === "broken" ? false : LOOK_MS),
  });
  const submit = (event: SyntheticEvent): void => {
    event.preventDefault();
    prepared.mutate();
  };
  const check = (label: string, value: string | undefined, checked: boolean, set: (on: boolean) => void): ReactElement | false =>
    value !== undefined && (
      <label className="export-check">
        <input type="checkbox" checked={checked} onChange={(event) => set(event.target.checked)} /> {label}
        {value !== "" && <b>{value}</b>}
      </label>
    );
  const now = progress.data ?? prepared.data;
  return (
    <dialog ref={dialog} className="float export" aria-labelledby="export-title" onClose={onClose}>
      <form onSubmit={submit}>
        <h2 id="export-title">{t("exportTitle")}</h2>
        <p className="quiet">{t("exportWhy")}</p>
        <div className="export-window">
          <When label={t("exportFrom")} value_ms={begin_ms} now_ms={now_ms} onChange={setBegin} />
          <When label={t("exportUntil")} value_ms={end_ms} now_ms={now_ms} onChange={setEnd} />
        </div>
        <fieldset>
          <legend>{t("exportFormat")}</legend>
          {formats.map((each) => (
            <label key={each} className="export-check">
              <input type="radio" name="format" checked={chosen === each} onChange={() => setFormat(each)} /> {t("formatOf", { format: each })}
            </label>
          ))}
          {chosen === undefined && <p className="look-inconclusive">{t("exportsOff")}</p>}
        </fieldset>
        {check(t("exportDrone"), drone, onlyDrone, setOnlyDrone)}
        {check(t("exportPad"), pad, onlyPad, setOnlyPad)}
        {check(t("exportArea"), "", onlyArea, setOnlyArea)}
        {prepared.error !== null && (
          <p role="alert" className="look-inconclusive">
            {prepared.error.message}
          </p>
        )}
        {now !== undefined && (
          <p role="status" className="num export-state">
            {now.state === "prepared" && t("about", { rows: now.expected })}
            {now.state === "running" && t("exporting", { rows: count(now.rows), total: count(now.expected) })}
            {now.state === "done" && t("exported", { rows: count(now.rows), size: bytes(now.bytes), sha256: now.sha256 ?? "" })}
            {now.state === "broken" && t("exportFailed")}
          </p>
        )}
        <div className="export-buttons">
          {now?.state === "prepared" ? (
            <a className="button primary" href={api.exportFile(now.export_id)} download onClick={() => void progress.refetch()}>
              {t("download")}
            </a>
          ) : (
            <button type="submit" className="button primary" disabled={prepared.isPending || chosen === undefined || now?.state === "running" || end_ms <= begin_ms}>
              {t("prepare")}
            </button>
          )}
          <button type="button" className="button" onClick={() => dialog.current?.close()}>
            {t("close")}
          </button>
        </div>
      </form>
    </dialog>
  );
}
