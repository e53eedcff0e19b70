import type { ReactElement } from "react";
import { useApi } from "../shared/api/api";
import type { Status } from "../shared/api/records";
import { usePages } from "../shared/api/usePages";
import { bytes, count, dayAndTime, duration } from "../shared/format";
import { useLive, useServerNow } from "../shared/live/useLive";
import type { Topic } from "../shared/live/store";
import { Hash } from "../shared/ui/Hash";
import { More } from "../shared/ui/More";
import { Scroll } from "../shared/ui/Scroll";
import { ChainCheck } from "./ChainCheck";
import { blockHref } from "../shared/address/ledgerLinks";
import { ledgerTexts as t } from "./texts";

const STATUS: readonly Topic[] = ["status"];
const PAGE = 50;

function rowsChecked(ledger: Status["ledger"], now_ms: number): string {
  if (ledger.rows_checked_ms === null) return t("rowsNever");
  const at = dayAndTime(ledger.rows_checked_ms, now_ms);
  return ledger.rows_differ.length === 0 ? t("rowsAgree", { at }) : t("rowsDiffer", { at, count: ledger.rows_differ.length });
}

function Summary({ ledger }: { ledger: Status["ledger"] }): ReactElement {
  const now_ms = useServerNow(10_000);
  const said = ledger.kind === "embedded" ? t("embedded") : t(ledger.kind === "fabric" ? "fabric" : "unknown", { channel: ledger.channel });
  const state =
    typeof ledger.halted === "string"
      ? t("halted")
      : !ledger.connected
        ? t("away")
        : ledger.lag_ms < 1_000
          ? t("connected")
          : t("behind", { duration: duration(ledger.lag_ms) });
  return (
    <section className="float card ledger-summary" data-testid="ledger-summary">
      <p className={ledger.kind === "embedded" ? "ledger-notice" : undefined}>{said}</p>
      <dl className="figures num">
        <div>
          <dt>{t("blocksOnLedger")}</dt>
          <dd>{count(ledger.height)}</dd>
        </div>
        <div>
          <dt>{t("blocksMirrored")}</dt>
          <dd>{count(ledger.mirrored)}</dd>
        </div>
        <div>
          <dt>{t("connection")}</dt>
          <dd>{state}</dd>
        </div>
        {ledger.kind === "fabric" && (
          <div>
            <dt>{t("confirmed")}</dt>
            <dd>{ledger.alone_since_ms === null ? t("confirmedByOthers") : t("confirmedByNobody", { at: dayAndTime(ledger.alone_since_ms, now_ms) })}</dd>
          </div>
        )}
        <div>
          <dt>{t("rowsChecked")}</dt>
          <dd data-testid="rows-checked">{rowsChecked(ledger, now_ms)}</dd>
        </div>
        <div>
          <dt>{t("organisations")}</dt>
          <dd className="ledger-organisations">{ledger.organisations.join(", ")}</dd>
        </div>
      </dl>
      <ChainCheck />
    </section>
  );
}

/** Which ledger this is, and its blocks, the newest first. */
export function BlocksPage(): ReactElement {
  const api = useApi();
  const now_ms = useServerNow(10_000);
  const ledger = useLive(STATUS, (store) => store.status?.ledger);
  const mark = String(ledger?.mirrored ?? "");
  const { query, rows } = usePages(
    ["blocks"],
    (cursor) => api.blocks({ limit: PAGE, ...(cursor !== undefined && { cursor }) }),
    { fresh: { mark: mark, newest: () => mark } },
  );
  return (
    <div className="page">
      <div className="page-head">
        <h1>{t("ledger")}</h1>
      </div>
      {ledger !== undefined && <Summary ledger={ledger} />}
      <Scroll label={t("blocks")} className="table-frame float">
        <table className="table num">
          <thead>
            <tr>
              <th scope="col">{t("block")}</th>
              <th scope="col">{t("time")}</th>
              <th scope="col" className="right">
                {t("transactions")}
              </th>
              <th scope="col" className="right">
                {t("valid")}
              </th>
              <th scope="col" className="right">
                {t("size")}
              </th>
              <th scope="col">{t("hash")}</th>
              <th scope="col">{t("follows")}</th>
            </tr>
          </thead>
          <tbody>
            {rows.map((block) => (
              <tr key={block.number}>
                <td>
                  <a href={blockHref(block.number)}>
                    <b>{count(block.number)}</b>
                  </a>
                </td>
                <td>{dayAndTime(block.t_ms, now_ms)}</td>
                <td className="right">{count(block.transactions)}</td>
                <td className={`right ${block.valid < block.transactions ? "look-inconclusive" : ""}`}>
                  {block.valid === block.transactions
                    ? t("allValid")
                    : t("someValid", { valid: count(block.valid), total: count(block.transactions) })}
                </td>
                <td className="right">{bytes(block.size_bytes)}</td>
                <td>
                  <Hash value={block.header_hash} label={t("headerHash")} />
                </td>
                <td>{block.previous_hash === "" ? "–" : <Hash value={block.previous_hash} label={t("previousHash")} />}</td>
              </tr>
            ))}
          </tbody>
        </table>
        <More query={query} empty={t("none")} count={rows.length} />
      </Scroll>
    </div>
  );
}
