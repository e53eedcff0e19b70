import { useMutation, useQueryClient } from "@tanstack/react-query";
import { useCallback, useEffect, useRef, useState, type ReactElement } from "react";
import { transactionHref } from "../shared/address/ledgerLinks";
import { useApi } from "../shared/api/api";
import { count } from "../shared/format";
import { problemText } from "../shared/signing/KeyPage";
import { roleName } from "../shared/signing/texts";
import { useSigner } from "../shared/signing/useSigner";
import { Hash } from "../shared/ui/Hash";
import { Symbol } from "../shared/ui/Symbol";
import { checkFile, keepRun, keptRun, newRun, report, send, type ImportCheck, type ImportKind, type Run } from "./importing";
import { registryHref } from "../shared/address/registryLinks";
import { importTexts as t } from "./importTexts";

const KINDS = ["drones", "authorisations", "pads"] as const;
const COLUMNS: Readonly<Record<ImportKind, string>> = {
  drones: "uav_id,model,operator_id,registration",
  authorisations: "uav_id,authorisation_id,pad_id,actions,valid_from,valid_until",
  pads: "pad_id,name,operator_id,latitude,longitude,height_m,note",
};
const MAX_BYTES = 1 << 20;
const SHOWN = 200;
const LOOKS = { open: "unproved", valid: "verified", refused: "refuted", failed: "inconclusive" } as const;

function Errors({ check }: { check: ImportCheck }): ReactElement | null {
  if (check.error_count === 0) return null;
  return (
    <>
      <h3 className="look-refuted">{t("errors", { count: check.error_count })}</h3>
      <div className="scroll import-scroll">
        <table className="table num">
          <thead>
            <tr>
              <th scope="col">{t("line")}</th>
              <th scope="col">{t("column")}</th>
              <th scope="col">{t("wrong")}</th>
            </tr>
          </thead>
          <tbody>
            {check.errors.map((each, i) => (
              <tr key={i}>
                <td>{each.line}</td>
                <td>{each.column === "" ? t("wholeLine") : each.column}</td>
                <td className="wrap">{each.message}</td>
              </tr>
            ))}
          </tbody>
        </table>
      </div>
    </>
  );
}

function Lines({ run }: { run: Run }): ReactElement {
  // What needs the user first; thousands of lines need not all be drawn.
  const order = { failed: 0, refused: 1, open: 2, valid: 3 } as const;
  const lines = [...run.lines].sort((a, b) => order[a.state] - order[b.state] || a.line - b.line).slice(0, SHOWN);
  return (
    <div className="scroll import-scroll">
      <table className="table num">
        <thead>
          <tr>
            <th scope="col">{t("line")}</th>
            <th scope="col">{t("what")}</th>
            <th scope="col">{t("stateName")}</th>
            <th scope="col">{t("says")}</th>
          </tr>
        </thead>
        <tbody>
          {lines.map((each) => (
            <tr key={each.line}>
              <td>{each.line}</td>
              <th scope="row">{each.id}</th>
              <td>
                <span className={`status look-${LOOKS[each.state]}`}>
                  <Symbol look={LOOKS[each.state]} size={14} /> {t("state", { state: each.state })}
                </span>
              </td>
              <td className="wrap">
                {each.tx_id !== undefined && (
                  <>
                    <a href={transactionHref(each.tx_id)}>{t("transaction")}</a> <Hash value={each.tx_id} label={t("transaction")} />{" "}
                  </>
                )}
                {each.state === "valid" ? "" : each.text}
              </td>
            </tr>
          ))}
        </tbody>
      </table>
      {run.lines.length > SHOWN && <p className="note">{t("more", { count: count(run.lines.length - SHOWN) })}</p>}
    </div>
  );
}

function download(run: Run): void {
  const url = URL.createObjectURL(new Blob(["\ufeff", report(run)], { type: "text/csv" }));
  const link = document.createElement("a");
  link.href = url;
  link.download = `${run.name.replace(/\.csv$/i, "")}-report.csv`;
  link.click();
  URL.revokeObjectURL(url);
}

function Sending({ run, onRun, onNew }: { run: Run; onRun: (run: Run) => void; onNew: () => void }): ReactElement {
  const api = useApi();
  const client = useQueryClient();
  const signer = useSigner();
  const { current } = signer;
  const stop = useRef(false);
  useEffect(
    () => () => {
      stop.current = true;
    },
    [],
  );
  const sending = useMutation({
    mutationFn: async () => {
      stop.current = false;
      if (current !== undefined) await send(api, current, run, () => stop.current, onRun);
    },
    onSettled: () => client.invalidateQueries({ queryKey: ["registry"] }),
  });
  const done = run.lines.filter(({ state }) => state === "valid" || state === "refused").length;
  const left = run.lines.length - done;
  return (
    <section className="float card">
      <h2>
        {run.name} <span className="quiet">· {t("kind", { kind: run.kind })}</span>
      </h2>
      <p className="num" role="status">
        {t("progress", {
          done: count(done),
          all: count(run.lines.length),
          valid: count(run.lines.filter(({ state }) => state === "valid").length),
          refused: count(run.lines.filter(({ state }) => state === "refused").length),
        })}
      </p>
      <progress value={done} max={Math.max(1, run.lines.length)} aria-label={t("progressName")} />
      {sending.isError && (
        <p role="alert" className="form-problem">
          {problemText(sending.error)} {t("resume")}
        </p>
      )}
      {current === undefined && !signer.pending && (
        <p className="sign-warning">
          {t("noKey")} <a href={registryHref(["key"])}>{t("getKey")}</a>
        </p>
      )}
      <div className="form-actions">
        {left > 0 && !sending.isPending && (
          <button type="button" className="button primary" disabled={current === undefined} onClick={() => sending.mutate()}>
            {t("send", { count: left })}
          </button>
        )}
        {sending.isPending && (
          <button
            type="button"
            className="button"
            onClick={() => {
              stop.current = true;
            }}
          >
            {t("pause")}
          </button>
        )}
        <button type="button" className="button" onClick={() => download(run)}>
          {t("report")}
        </button>
        {!sending.isPending && (
          <button type="button" className="button" onClick={onNew}>
            {t("another")}
          </button>
        )}
        {current !== undefined && <span className="quiet">{t("as", { name: current.name, role: roleName(current.role) })}</span>}
      </div>
      <Lines run={run} />
    </section>
  );
}

/** A list by CSV: read and checked first, then signed line by line. */
export function ImportPage(): ReactElement {
  const api = useApi();
  const [kind, setKind] = useState<ImportKind>("drones");
  const [file, setFile] = useState<File>();
  const [run, setRun] = useState<Run | undefined>(keptRun);
  const keep = useCallback((next: Run | undefined) => {
    keepRun(next);
    setRun(next);
  }, []);
  const check = useMutation({ mutationFn: (chosen: File) => checkFile(api, kind, chosen) });
  const found = check.data;
  if (run !== undefined) return <Sending run={run} onRun={keep} onNew={() => keep(undefined)} />;
  const fresh = found?.rows.filter(({ exists }) => !exists).length ?? 0;
  return (
    <section className="float card">
      <h2>{t("import")}</h2>
      <p className="quiet lead">{t("importHint")}</p>
      <div className="form-grid">
        <label className="field">
          {t("list")}
          <select
            value={kind}
            onChange={(event) => {
              setKind(KINDS.find((each) => each === event.target.value) ?? "drones");
              check.reset();
            }}
          >
            {KINDS.map((each) => (
              <option key={each} value={each}>
                {t("kind", { kind: each })}
              </option>
            ))}
          </select>
        </label>
        <label className="field">
          {t("file")}
          <input
            type="file"
            accept=".csv,text/csv,text/plain"
            // The same file, mended meanwhile, may be chosen again.
            onClick={(event) => {
              event.currentTarget.value = "";
            }}
            onChange={(event) => {
              setFile(event.target.files?.[0]);
              check.reset();
            }}
          />
        </label>
        <p className="wide quiet">
          {t("columns")} <code className="mono wrap">{COLUMNS[kind]}</code>
        </p>
        <div className="form-actions">
          <button type="button" className="button primary" disabled={file === undefined || file.size > MAX_BYTES || check.isPending} onClick={() => file !== undefined && check.mutate(file)}>
            {t("check")}
          </button>
        </div>
      </div>
      {file !== undefined && file.size > MAX_BYTES && (
        <p role="alert" className="form-problem">
          {t("tooLarge")}
        </p>
      )}
      {check.isError && (
        <p role="alert" className="form-problem">
          {check.error.message}
        </p>
      )}
      {found !== undefined && (
        <div className="import-found" role="status">
          <p className="num">{t("found", { fresh, exists: found.rows.length - fresh, encoding: found.encoding })}</p>
          <Errors check={found} />
          {fresh > 0 && (
            <div className="form-actions">
              <button type="button" className="button primary" onClick={() => keep(newRun(file?.name ?? "list.csv", kind, found))}>
                {t("take", { count: fresh })}
              </button>
              {found.error_count > 0 && <span className="quiet">{t("errorsLeft")}</span>}
            </div>
          )}
        </div>
      )}
    </section>
  );
}
