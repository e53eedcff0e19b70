import { useMutation, useQuery } from "@tanstack/react-query";
import type { ReactElement } from "react";
import { useApi } from "../shared/api/api";
import type { LedgerBlock, LedgerTransaction } from "../shared/api/records";
import { bytes, count, dayAndTime } from "../shared/format";
import { useServerNow } from "../shared/live/useLive";
import { sharedTexts } from "../shared/texts";
import { Hash } from "../shared/ui/Hash";
import { Scroll } from "../shared/ui/Scroll";
import { checkLink, sha256 } from "./chain";
import { blockHref, ledgerHref, transactionHref } from "../shared/address/ledgerLinks";
import { ledgerTexts as t } from "./texts";

type Checked = { data: boolean; header: boolean; size: number };

/** Fetches the block's bytes and hashes them here; checks the header against the block before. */
function BytesCheck({ block }: { block: LedgerBlock }): ReactElement {
  const api = useApi();
  const check = useMutation({
    mutationFn: async (): Promise<Checked> => {
      const data = await api.blockData(block.number);
      const before = block.number === 0 ? undefined : await api.block(block.number - 1);
      const data_hash = await sha256(data);
      return { data: data_hash === block.data_hash, header: (await checkLink(block, before)) === "holds", size: data.byteLength };
    },
  });
  return (
    <div className="chain-check">
      <button type="button" className="button" disabled={check.isPending} onClick={() => check.mutate()}>
        {t("check")}
      </button>
      {check.isError && (
        <p role="alert" className="look-refuted">
          {check.error.message}
        </p>
      )}
      {check.data !== undefined && (
        <p role="status" className={check.data.data && check.data.header ? "look-verified" : "look-refuted"}>
          {check.data.data ? t("dataHolds", { size: bytes(check.data.size) }) : t("dataDiffers")}{" "}
          {check.data.header ? t("headerHolds") : t("chainBroken", { block: count(block.number), link: "other" })}
        </p>
      )}
    </div>
  );
}

function what(transaction: LedgerTransaction): string {
  if (transaction.type === "config") return t("configuration");
  return transaction.function ?? t("unreadable");
}

/** One block: its hashes, to be checked here, and its transactions. */
export function BlockPage({ number }: { number: number }): ReactElement {
  const api = useApi();
  const now_ms = useServerNow(10_000);
  const query = useQuery({ queryKey: ["block", number], queryFn: () => api.block(number) });
  const block = query.data;
  return (
    <div className="page">
      <div className="page-head">
        <h1>
          <a href={ledgerHref}>{t("ledger")}</a> <span className="quiet">/</span> {t("blockNumber", { block: count(number) })}
        </h1>
        <span className="page-actions">
          {number > 0 && (
            <a className="button" href={blockHref(number - 1)}>
              {t("earlier")}
            </a>
          )}
          <a className="button" href={blockHref(number + 1)}>
            {t("later")}
          </a>
        </span>
      </div>
      {block === undefined && (
        <p className="empty" role={query.isError ? "alert" : "status"}>
          {query.isError ? query.error.message : sharedTexts("fetching")}
        </p>
      )}
      {block !== undefined && (
        <>
          <section className="float card">
            <dl className="facts num">
              <div>
                <dt>{t("time")}</dt>
                <dd>{dayAndTime(block.t_ms, now_ms)}</dd>
              </div>
              <div>
                <dt>{t("size")}</dt>
                <dd>{bytes(block.size_bytes)}</dd>
              </div>
              <div>
                <dt>{t("headerHash")}</dt>
                <dd className="mono wrap">{block.header_hash}</dd>
              </div>
              <div>
                <dt>{t("previousHash")}</dt>
                <dd className="mono wrap">{block.previous_hash === "" ? "–" : block.previous_hash}</dd>
              </div>
              <div>
                <dt>{t("dataHash")}</dt>
                <dd className="mono wrap">{block.data_hash}</dd>
              </div>
            </dl>
            <BytesCheck key={number} block={block} />
          </section>
          <Scroll label={t("transactions")} className="table-frame float">
            <table className="table num">
              <thead>
                <tr>
                  <th scope="col">{t("function")}</th>
                  <th scope="col">{t("signedBy")}</th>
                  <th scope="col">{t("endorsedBy")}</th>
                  <th scope="col">{t("validity")}</th>
                  <th scope="col">{t("time")}</th>
                  <th scope="col">{t("transaction")}</th>
                </tr>
              </thead>
              <tbody>
                {block.items.map((each) => (
                  <tr key={each.tx_index}>
                    <td>{each.tx_id === "" ? <b>{what(each)}</b> : <a href={transactionHref(each.tx_id)}>{what(each)}</a>}</td>
                    <td>{each.creator ? `${each.creator.name} · ${each.creator.msp_id}` : "–"}</td>
                    <td>{each.endorsers.join(", ") || "–"}</td>
                    <td className={each.valid ? undefined : "look-inconclusive"}>{each.validation}</td>
                    <td>{dayAndTime(each.t_ms, now_ms)}</td>
                    <td>{each.tx_id === "" ? "–" : <Hash value={each.tx_id} label={sharedTexts("transaction")} />}</td>
                  </tr>
                ))}
              </tbody>
            </table>
          </Scroll>
        </>
      )}
    </div>
  );
}
