import type { ReactElement } from "react";
import { transactionHref } from "../shared/address/ledgerLinks";
import { useApi } from "../shared/api/api";
import { count, dayAndTime } from "../shared/format";
import { useServerNow } from "../shared/live/useLive";
import { Hash } from "../shared/ui/Hash";
import { More } from "../shared/ui/More";
import { history, type RegistryChange } from "./calls";
import { registryTexts as t } from "./texts";
import { usePages } from "../shared/api/usePages";
import { differences } from "./values";
import { fieldName, valueWord } from "./words";

const PAGE = 20;
/** These follow from every change, and say nothing of it. */
const NOISE = new Set(["updated_ms", "commissioning_sha256", "set_ms"]);

function Differences({ change }: { change: RegistryChange }): ReactElement {
  const rows = differences(change.before ?? {}, change.record).filter(({ path }) => !NOISE.has(path) && !path.startsWith("commissioning."));
  if (rows.length === 0) return <p className="quiet">{t("nothingDiffers")}</p>;
  return (
    <dl className="differences num">
      {rows.map(({ path, before, after }) => (
        <div key={path}>
          <dt>{fieldName(path)}</dt>
          <dd>
            {change.before !== undefined && (
              <>
                <del>{valueWord(path, before)}</del> <span aria-hidden="true">→</span>{" "}
              </>
            )}
            <ins>{valueWord(path, after)}</ins>
          </dd>
        </div>
      ))}
    </dl>
  );
}

/** Who changed what, in which transaction; newest first. */
export function History({ kind, id }: { kind: "drone" | "pad"; id: string }): ReactElement {
  const api = useApi();
  const now_ms = useServerNow(60_000);
  const { query, rows } = usePages(["registry", "history", kind, id], (cursor) => history(api, { kind, id, limit: PAGE, ...(cursor !== undefined && { cursor }) }), { keep: true });
  return (
    <section className="float card">
      <h2>{t("history")}</h2>
      <p className="quiet">{t("historyHint")}</p>
      <ol className="history">
        {rows.map((change) => (
          <li key={`${change.tx_id} ${change.id}`}>
            <p className="num">
              <b>{change.function}</b>
              {change.kind !== kind && <span className="quiet"> · {change.kind === "closures" ? t("closuresOf") : change.id.slice(id.length + 1)}</span>}
              {change.before === undefined && <span className="tag">{t("first")}</span>}
            </p>
            <p className="quiet num">
              {dayAndTime(change.t_ms, now_ms)} · {change.by.name} · {change.by.msp_id} · <a href={transactionHref(change.tx_id)}>{t("inBlock", { block: count(change.block) })}</a>{" "}
              <Hash value={change.tx_id} label="tx" />
            </p>
            <Differences change={change} />
          </li>
        ))}
      </ol>
      <More query={query} empty={t("noHistory")} count={rows.length} />
    </section>
  );
}
