import { useQuery } from "@tanstack/react-query";
import type { ReactElement, ReactNode } from "react";
import { placeHash } from "../shared/address/location";
import { useApi } from "../shared/api/api";
import type { LedgerValue, TransactionContents } from "../shared/api/records";
import { count, dayAndTime } from "../shared/format";
import { useServerNow } from "../shared/live/useLive";
import { sharedTexts } from "../shared/texts";
import { Hash } from "../shared/ui/Hash";
import { laidOut } from "../shared/json";
import { blockHref, ledgerHref } from "../shared/address/ledgerLinks";
import { ledgerTexts as t } from "./texts";

const SESSION_FUNCTIONS = new Set(["RequestProof", "SubmitProof", "CompleteInteraction", "CancelProof"]);

/** JSON with its lines, other text as it is, bytes as base64url. Always as text, never as markup. */
function readable(value: LedgerValue): string {
  if (value.text === undefined) return value.base64 ?? "";
  try {
    return laidOut(JSON.parse(value.text));
  } catch {
    return value.text;
  }
}

function Value({ value }: { value: LedgerValue }): ReactElement {
  const shown = value.text ?? value.base64 ?? "";
  const cut = value.masked !== true && value.text !== undefined && value.bytes > new TextEncoder().encode(shown).length;
  if (value.bytes === 0) return <p className="quiet">–</p>;
  return (
    <>
      {/* A region that scrolls must be reachable by keyboard. */}
      {/* eslint-disable-next-line jsx-a11y/no-noninteractive-tabindex */}
      <pre className="mono value" tabIndex={0}>
        {readable(value)}
      </pre>
      {value.masked === true && <p className="note">{t("masked")}</p>}
      {cut && <p className="note">{t("cut", { count: count(value.bytes) })}</p>}
    </>
  );
}

function Card({ title, children }: { title: string; children: ReactNode }): ReactElement {
  return (
    <section className="float card">
      <h2>{title}</h2>
      {children}
    </section>
  );
}

function Accesses({ contents }: { contents: TransactionContents }): ReactElement {
  const accesses = (contents.accesses ?? []).filter(
    ({ reads, writes, range_queries }) => reads.length + writes.length + range_queries.length > 0,
  );
  return (
    <>
      {accesses.map(({ namespace, reads, writes, range_queries }) => (
        <Card key={namespace} title={`${t("writes")} · ${t("namespace", { namespace })}`}>
          {writes.map((write) => (
            <details key={write.key} className="write">
              <summary className="mono wrap">
                {write.key} {write.deleted === true && <span className="tag">{t("deleted")}</span>}
              </summary>
              {write.value !== undefined && <Value value={write.value} />}
            </details>
          ))}
          {reads.length > 0 && <h3>{t("reads")}</h3>}
          <ul className="reads num">
            {reads.map((read) => (
              <li key={read.key}>
                <span className="mono wrap">{read.key}</span>{" "}
                <span className="quiet">
                  {read.block === undefined ? (
                    t("notThere")
                  ) : (
                    <a href={blockHref(read.block)}>{t("fromBlock", { block: count(read.block) })}</a>
                  )}
                </span>
              </li>
            ))}
            {range_queries.map((range) => (
              <li key={range.start + range.end}>
                {t("ranges")} <span className="mono wrap">{`${range.start} … ${range.end}`}</span>
              </li>
            ))}
          </ul>
        </Card>
      ))}
    </>
  );
}

function Contents({ contents }: { contents: TransactionContents }): ReactElement {
  const [, ...values] = contents.arguments ?? [];
  return (
    <>
      {contents.problem !== undefined && (
        <p className="empty" role="alert">
          {contents.problem}
        </p>
      )}
      {contents.config !== undefined && (
        <Card title={t("configuration")}>
          <p>{contents.config.organisations.join(", ")}</p>
        </Card>
      )}
      {values.length > 0 && (
        <Card title={t("arguments")}>
          {values.map((value, i) => (
            <Value key={i} value={value} />
          ))}
        </Card>
      )}
      {contents.result !== undefined && (
        <Card title={t("result")}>
          <p className="num quiet">
            {contents.response?.status} {contents.response?.message}
          </p>
          <Value value={contents.result} />
        </Card>
      )}
      {contents.event !== undefined && (
        <Card title={`${t("event")} · ${contents.event.name}`}>
          <Value value={contents.event.payload} />
        </Card>
      )}
      <Accesses contents={contents} />
    </>
  );
}

/** One transaction in full: who signed and endorsed it, what it said, what it changed. */
export function TransactionPage({ tx_id }: { tx_id: string }): ReactElement {
  const api = useApi();
  const now_ms = useServerNow(10_000);
  const query = useQuery({ queryKey: ["transaction", tx_id], queryFn: () => api.transaction(tx_id) });
  const contents = useQuery({ queryKey: ["contents", tx_id], queryFn: () => api.transactionContents(tx_id), staleTime: Infinity });
  const transaction = query.data;
  const inFull = contents.data;
  if (transaction === undefined) {
    return (
      <div className="page">
        <h1 className="visually-hidden">{t("ledger")}</h1>
        <p className="empty" role={query.isError ? "alert" : "status"}>
          {query.isError ? query.error.message : sharedTexts("fetching")} <a href={ledgerHref}>{t("ledger")}</a>
        </p>
      </div>
    );
  }
  const named = transaction.type === "config" ? t("configuration") : (transaction.function ?? t("unreadable"));
  const session = sessionOf(transaction.function ?? undefined, transaction.event_payload ?? undefined);
  return (
    <div className="page">
      <div className="page-head">
        <h1>
          <a href={ledgerHref}>{t("ledger")}</a> <span className="quiet">/</span> {named}
        </h1>
        {session !== undefined && (
          <a className="button" href={placeHash({ room: "sessions", session })}>
            {t("session")}
          </a>
        )}
      </div>
      <section className="float card">
        <p className={transaction.valid ? "look-verified" : "look-inconclusive"}>
          {transaction.valid ? t("isValid") : t("isInvalid", { code: transaction.validation })}
        </p>
        <dl className="facts num">
          <div>
            <dt>{t("transaction")}</dt>
            <dd className="mono wrap">{transaction.tx_id}</dd>
          </div>
          <div>
            <dt>{t("block")}</dt>
            <dd>
              <a href={blockHref(transaction.block)}>{count(transaction.block)}</a>
            </dd>
          </div>
          <div>
            <dt>{t("time")}</dt>
            <dd>{dayAndTime(transaction.t_ms, now_ms)}</dd>
          </div>
          <div>
            <dt>{t("signedBy")}</dt>
            <dd>
              {transaction.creator ? (
                <>
                  {transaction.creator.name} · {transaction.creator.msp_id}{" "}
                  <Hash value={transaction.creator.certificate_sha256} label={t("certificate")} />
                </>
              ) : (
                "–"
              )}
            </dd>
          </div>
          <div>
            <dt>{t("endorsedBy")}</dt>
            <dd>
              {(inFull?.endorsements ?? transaction.endorsers.map((msp_id) => ({ msp_id, name: "" }))).map((each, i) => (
                <span key={i} className="party-line">
                  {each.name === "" ? each.msp_id : `${each.name} · ${each.msp_id}`}
                </span>
              ))}
            </dd>
          </div>
          {inFull !== undefined && (
            <>
              <div>
                <dt>{t("orderedBy")}</dt>
                <dd>
                  {inFull.ordered_by.map((each, i) => (
                    <span key={i} className="party-line">
                      {each.problem ?? (each.name ? `${each.name} · ${each.msp_id ?? ""}` : t("consenter", { id: each.consenter_id ?? 0 }))}
                    </span>
                  ))}
                </dd>
              </div>
              {inFull.chaincode !== undefined && (
                <div>
                  <dt>{t("contract")}</dt>
                  <dd>{t("contractIs", { name: inFull.chaincode, version: inFull.chaincode_version ?? "" })}</dd>
                </div>
              )}
            </>
          )}
        </dl>
      </section>
      {contents.isError && (
        <p className="empty" role="alert">
          {contents.error.message}
        </p>
      )}
      {contents.isPending && <p className="empty">{sharedTexts("fetching")}</p>}
      {inFull !== undefined && <Contents contents={inFull} />}
    </div>
  );
}

/** The session that a transaction of a proof belongs to, from its event. */
function sessionOf(name: string | undefined, event: string | undefined): string | undefined {
  if (name === undefined || event === undefined || !SESSION_FUNCTIONS.has(name)) return undefined;
  return /"session_id":"([0-9a-f]{64})"/.exec(event)?.[1];
}
