import { useMutation, useQueryClient } from "@tanstack/react-query";
import { useState, type DragEvent, type ReactElement } from "react";
import { usePages } from "../shared/api/usePages";
import { useApi } from "../shared/api/api";
import { bytes, count, dayAndTime } from "../shared/format";
import { useServerNow } from "../shared/live/useLive";
import { problemText } from "../shared/signing/KeyPage";
import { More } from "../shared/ui/More";
import { bring, imports, type ImportReport, type ZoneFinding } from "./calls";
import { zonesHref } from "./links";
import { Scroll } from "./Scroll";
import { zoneTexts as t } from "./texts";

const MAX_BYTES = 32 * 2 ** 20;
const SOURCE = "[A-Za-z0-9][A-Za-z0-9._\\-]{0,62}";

function Findings({ rows, said }: { rows: readonly ZoneFinding[]; said: string }): ReactElement {
  return (
    <Scroll name={said} long>
      <table className="table num">
        <thead>
          <tr>
            <th scope="col">{t("line")}</th>
            <th scope="col">{t("column")}</th>
            <th scope="col">{said}</th>
            <th scope="col">{t("where")}</th>
          </tr>
        </thead>
        <tbody>
          {rows.map((each, i) => (
            <tr key={i}>
              <td>{each.line}</td>
              <td>{each.column}</td>
              <td className="wrap" lang="en">
                {each.message}
              </td>
              <td className="wrap mono quiet">{each.path}</td>
            </tr>
          ))}
        </tbody>
      </table>
    </Scroll>
  );
}

function Report({ report }: { report: ImportReport }): ReactElement {
  const { errors, error_count, notices, notice_count } = report;
  return (
    <div className="zones-report">
      {report.valid ? (
        <p role="status">
          <b className="look-verified">{t("valid", { format: report.format ?? "", count: report.zones })}</b> {t("change", { added: report.added, removed: report.removed, changed: report.changed })}
        </p>
      ) : (
        <>
          <p role="alert">
            <b className="look-refuted">{t("errors", { count: error_count })}</b>
            {error_count > errors.length && ` ${t("firstOf", { shown: count(errors.length), count: count(error_count) })}`}
          </p>
          <Findings rows={errors} said={t("wrong")} />
        </>
      )}
      {notices.length > 0 && (
        <details>
          <summary>
            {t("notices", { count: notice_count })}
            {notice_count > notices.length && ` ${t("firstOf", { shown: count(notices.length), count: count(notice_count) })}`}
          </summary>
          <Findings rows={notices} said={t("noticed")} />
        </details>
      )}
    </div>
  );
}

function DropZone({ file, onFile }: { file: File | undefined; onFile: (file: File) => void }): ReactElement {
  const [over, setOver] = useState(false);
  const drop = (event: DragEvent): void => {
    event.preventDefault();
    setOver(false);
    const [dropped] = event.dataTransfer.files;
    if (dropped !== undefined) onFile(dropped);
  };
  return (
    // Dropping is a second way for the mouse; the keyboard has the input inside.
    // eslint-disable-next-line jsx-a11y/no-noninteractive-element-interactions
    <label
      className="drop"
      data-over={over}
      onDragOver={(event) => {
        event.preventDefault();
        setOver(true);
      }}
      onDragLeave={() => setOver(false)}
      onDrop={drop}
    >
      <span>{file === undefined ? t("drop") : t("chosen", { name: file.name, size: bytes(file.size) })}</span>
      <input
        type="file"
        accept=".json,.geojson,application/json,application/geo+json"
        onChange={({ target }) => {
          const [chosen] = target.files ?? [];
          if (chosen !== undefined) onFile(chosen);
          // The same file, mended meanwhile, may be chosen again.
          target.value = "";
        }}
      />
    </label>
  );
}

function History(): ReactElement {
  const api = useApi();
  const now_ms = useServerNow(30_000);
  const { query, rows } = usePages(["zones", "imports"], (cursor) => imports(api, cursor), { keep: true });
  return (
    <div className="float table-frame">
      <h2 className="zones-title">{t("history")}</h2>
      {rows.length > 0 && (
        <table className="table num">
          <thead>
            <tr>
              <th scope="col">{t("source")}</th>
              <th scope="col">{t("when")}</th>
              <th scope="col">{t("who")}</th>
              <th scope="col" className="right">
                {t("count")}
              </th>
              <th scope="col">{t("state")}</th>
            </tr>
          </thead>
          <tbody>
            {rows.map((each) => (
              <tr key={each.import_id}>
                <th scope="row">{each.source}</th>
                <td>{dayAndTime(each.imported_ms, now_ms)}</td>
                <td>{each.imported_by}</td>
                <td className="right">{count(each.zones)}</td>
                <td>{each.replaced_ms === undefined ? t("holds") : t("replaced", { when: dayAndTime(each.replaced_ms, now_ms) })}</td>
              </tr>
            ))}
          </tbody>
        </table>
      )}
      <More query={query} empty={t("noImports")} count={rows.length} />
    </div>
  );
}

/** A file is read first, and imported once it has no error. */
export function ImportPage(): ReactElement {
  const api = useApi();
  const client = useQueryClient();
  const [source, setSource] = useState("");
  const [file, setFile] = useState<File>();
  const check = useMutation({ mutationFn: (chosen: File) => bring(api, chosen, source, true) });
  const take = useMutation({
    mutationFn: (chosen: File) => bring(api, chosen, source, false),
    onSuccess: () => client.invalidateQueries({ queryKey: ["zones"] }),
  });
  const forget = (): void => {
    check.reset();
    take.reset();
  };
  const tooLarge = file !== undefined && file.size > MAX_BYTES;
  const error = check.error ?? take.error;
  return (
    <>
      <section className="float card">
        <h2>{t("importTitle")}</h2>
        <p className="lead">{t("importIntro")}</p>
        <form
          className="zones-form"
          onSubmit={(event) => {
            event.preventDefault();
            if (file !== undefined && !tooLarge) check.mutate(file);
          }}
        >
          <label className="field">
            {t("source")}
            <input
              required
              pattern={SOURCE}
              title={t("sourceHint")}
              value={source}
              maxLength={63}
              onChange={({ target }) => {
                setSource(target.value);
                forget();
              }}
            />
            <small>{t("sourceHint")}</small>
          </label>
          <DropZone
            file={file}
            onFile={(chosen) => {
              setFile(chosen);
              forget();
            }}
          />
          {tooLarge && (
            <p role="alert" className="form-problem">
              {t("tooLarge", { size: bytes(file.size) })}
            </p>
          )}
          <div className="form-actions">
            <button className={`button ${check.data?.valid === true ? "" : "primary"}`} disabled={file === undefined || tooLarge || check.isPending}>
              {check.isPending ? t("checking") : t("check")}
            </button>
            {file !== undefined && check.data?.valid === true && !take.isSuccess && (
              <button type="button" className="button primary" disabled={take.isPending} onClick={() => take.mutate(file)}>
                {take.isPending ? t("importing") : t("doImport")}
              </button>
            )}
          </div>
        </form>
        {error !== null && (
          <p role="alert" className="form-problem">
            {problemText(error)}
          </p>
        )}
        {take.isSuccess ? (
          <p role="status" className="zones-done">
            {t("imported")}{" "}
            <a className="button primary" href={zonesHref(["pads"])}>
              {t("toPads")}
            </a>
          </p>
        ) : (
          check.data !== undefined && <Report report={check.data} />
        )}
      </section>
      <History />
    </>
  );
}
