import { useMutation, useQuery } from "@tanstack/react-query";
import { useCallback, type ReactElement } from "react";
import { go, placeHash, withChange, type Filters as Chosen } from "../shared/address/location";
import { between } from "../shared/days";
import { count, dayAndTime } from "../shared/format";
import { transactionHref } from "../shared/address/ledgerLinks";
import { useServerNow } from "../shared/live/useLive";
import { shortHash } from "../shared/format";
import { Bar, Choice, Days, SearchBox } from "../shared/ui/Filters";
import { More } from "../shared/ui/More";
import { usePages } from "../shared/api/usePages";
import { usePeopleApi, type AuditCheck, type AuditEntry, type AuditFilters } from "./api";
import { actOf, actsByName, nameOf } from "./acts";
import { Problem } from "./parts";
import { personHref } from "./PeoplePage";
import { auditTexts as t } from "./texts";

const PAGE = 100;
/** What can speak against the log: a row or a transaction. */
const AGAINST = ["broken_seq", "misdated_seq", "contradicted_tx", "lost_tx", "late_seq"] as const;

function Verdict({ found, now_ms }: { found: AuditCheck; now_ms: number }): ReactElement {
  if (!found.ok) {
    return (
      <div className="people-problem" role="alert">
        {AGAINST.map((what) => {
          const where = found[what];
          if (where === undefined) return null;
          return (
            <p key={what}>
              {t("against", { what, seq: typeof where === "number" ? count(where) : "" })}{" "}
              {typeof where === "string" && <a href={transactionHref(where)}>{shortHash(where)}</a>}
            </p>
          );
        })}
      </div>
    );
  }
  const ledger =
    found.ledger !== "checked"
      ? t(found.ledger)
      : typeof found.anchored_seq !== "number"
        ? t("unanchored")
        : t("vouched", { seq: count(found.anchored_seq), when: dayAndTime(found.anchored_ms ?? 0, now_ms) });
  return (
    <p className="people-good num" role="status">
      {t("good", { rows: found.rows, count: count(found.rows) })} {ledger}
    </p>
  );
}

function Check(): ReactElement {
  const api = usePeopleApi();
  const now_ms = useServerNow(10_000);
  const check = useMutation({ mutationFn: () => api.verifyAudit() });
  return (
    <div className="audit-check">
      <button type="button" className="button" disabled={check.isPending} onClick={() => check.mutate()}>
        {t(check.isPending ? "checking" : "check")}
      </button>
      {check.data !== undefined && <Verdict found={check.data} now_ms={now_ms} />}
      <Problem error={check.error} />
    </div>
  );
}

/** Details in one line: names and values as they were recorded. */
function inWords(value: unknown): string {
  if (Array.isArray(value)) return value.map(inWords).join(", ");
  if (typeof value === "object" && value !== null) {
    return Object.entries(value)
      .filter(([, each]) => each !== "")
      .map(([name, each]) => `${name}: ${inWords(each)}`)
      .join(" · ");
  }
  return String(value);
}

const HREFS: Record<string, (id: string) => string> = {
  person: personHref,
  alert: (id) => placeHash({ room: "alerts", path: [id], query: {} }),
  transaction: transactionHref,
  session: (id) => placeHash({ room: "sessions", session: id }),
  block: (id) => placeHash({ room: "ledger", path: ["block", id], query: {} }),
};

function Subject({ subject }: { subject: string }): ReactElement {
  const [kind = "", id = ""] = subject.split("/", 2);
  const href = HREFS[kind];
  const text = id.length > 24 ? `${kind}/${shortHash(id)}` : subject;
  return href === undefined || id === "" ? <>{text}</> : <a href={href(id)}>{text}</a>;
}

function Row({ entry, now_ms }: { entry: AuditEntry; now_ms: number }): ReactElement {
  const person = entry.person === "" ? t("nobody") : entry.person;
  return (
    <tr>
      <td>{count(entry.seq)}</td>
      <td>{dayAndTime(entry.t_ms, now_ms)}</td>
      <td>{typeof entry.person_id === "string" ? <a href={personHref(entry.person_id)}>{person}</a> : <span className="quiet">{person}</span>}</td>
      <td className={entry.act === "sign_in_failed" ? "look-refuted" : undefined}>{nameOf(entry.act)}</td>
      <td>
        <Subject subject={entry.subject} />
      </td>
      <td className="audit-detail">{inWords(entry.detail)}</td>
      <td>{typeof entry.tx_id === "string" ? <a className="mono" href={transactionHref(entry.tx_id)}>{shortHash(entry.tx_id)}</a> : "–"}</td>
    </tr>
  );
}

function change(filters: Chosen, part: Chosen): void {
  go({ room: "people", path: ["audit"], query: withChange(filters, part) }, true);
}

function asked(filters: Chosen): AuditFilters {
  const act = actOf(filters["act"]);
  return {
    ...(filters["person"] !== undefined && { person: filters["person"] }),
    ...(act !== undefined && { act }),
    ...(filters["subject"] !== undefined && { subject: filters["subject"] }),
    ...between(filters["since"], filters["until"]),
  };
}

function Filters({ filters }: { filters: Chosen }): ReactElement {
  const api = usePeopleApi();
  const people = useQuery({ queryKey: ["people"], queryFn: () => api.people() });
  const subject = useCallback((named: string) => change(filters, { subject: named }), [filters]);
  return (
    <Bar onClear={Object.keys(filters).length === 0 ? undefined : () => go({ room: "people", path: ["audit"], query: {} }, true)}>
      <Choice
        label={t("person")}
        any={t("everybody")}
        value={filters["person"] ?? ""}
        options={people.data?.items.map(({ person_id, name }) => ({ value: person_id, name })) ?? []}
        onChange={(person) => change(filters, { person })}
      />
      <Choice
        label={t("act")}
        any={t("everything")}
        value={filters["act"] ?? ""}
        options={actsByName().map(({ act, name }) => ({ value: act, name }))}
        onChange={(act) => change(filters, { act })}
      />
      <SearchBox label={t("subject")} value={filters["subject"] ?? ""} hint="drone/…" onSearch={subject} />
      <Days since={filters["since"] ?? ""} until={filters["until"] ?? ""} onChange={(days) => change(filters, days)} />
    </Bar>
  );
}

/** What was done and read, newest first; and whether the log is what it was. */
export function AuditPage({ filters }: { filters: Chosen }): ReactElement {
  const api = usePeopleApi();
  const now_ms = useServerNow(10_000);
  const wanted = asked(filters);
  const { query, rows } = usePages(
    ["audit", wanted],
    (cursor) => api.audit({ ...wanted, limit: PAGE, ...(cursor !== undefined && { cursor }) }),
  );
  return (
    <>
      <section className="float people-card people-head" aria-label={t("check")}>
        <p className="quiet">{t("hint")}</p>
        <Check />
        <Filters filters={filters} />
      </section>
      <div className="table-frame float">
        <table className="table people-table num">
          <thead>
            <tr>
              <th scope="col">#</th>
              <th scope="col">{t("when")}</th>
              <th scope="col">{t("who")}</th>
              <th scope="col">{t("what")}</th>
              <th scope="col">{t("subject")}</th>
              <th scope="col">{t("detail")}</th>
              <th scope="col">{t("transaction")}</th>
            </tr>
          </thead>
          <tbody>
            {rows.map((entry) => (
              <Row key={entry.seq} entry={entry} now_ms={now_ms} />
            ))}
          </tbody>
        </table>
        <More query={query} empty={t("empty")} count={rows.length} />
      </div>
    </>
  );
}
