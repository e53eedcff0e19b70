import { useMutation } from "@tanstack/react-query";
import { useEffect, useRef, useState, type ReactElement, type ReactNode } from "react";
import { transactionHref } from "../address/ledgerLinks";
import { laidOut } from "../json";
import { useApi } from "../api/api";
import { count } from "../format";
import { sharedTexts } from "../texts";
import { Hash } from "../ui/Hash";
import { Phrases } from "../ui/Sentence";
import { Symbol } from "../ui/Symbol";
import { isFinal, Signing, type Change, type SignedTransaction } from "./flow";
import { ForeignBytesError } from "./inspect";
import type { StoredKey } from "./keys";
import { DemoKeys, problemText } from "./KeyPage";
import "./signing.css";
import { roleName, signingTexts as t } from "./texts";
import { choose, useSigner, type Signer } from "./useSigner";

const STEPS = ["proposed", "endorsed", "ordered", "valid"] as const;

function reached(transaction: SignedTransaction | undefined): number {
  if (transaction === undefined) return -1;
  const { state } = transaction;
  if (state === "endorsed") return 1;
  if (state === "submitted" || state === "unknown" || state === "invalid") return 2;
  return state === "valid" ? 3 : 0;
}

function Progress({ transaction }: { transaction: SignedTransaction | undefined }): ReactElement {
  const at = reached(transaction);
  const over = transaction !== undefined && isFinal(transaction);
  return (
    <ol className="sign-steps num" aria-label={t("progress")}>
      {STEPS.map((step, i) => {
        const look = i <= at ? "verified" : i === at + 1 && !over ? "proving" : i === at + 1 ? "refuted" : "unproved";
        let words = t("step", { step });
        if (step === "endorsed" && at >= 1 && transaction !== undefined) words = t("endorsedBy", { organisations: transaction.endorsers.join(", ") });
        if (step === "valid" && at === 3 && transaction?.block !== undefined) words = t("inBlock", { block: count(transaction.block) });
        return (
          <li key={step} data-reached={i <= at}>
            <Symbol look={look} size={16} />
            {words}
          </li>
        );
      })}
    </ol>
  );
}

/** Why it came to nothing, in whose words. */
export function Failure({ transaction, children }: { transaction: SignedTransaction; children?: ReactNode }): ReactElement {
  const { problem } = transaction;
  const kind = transaction.state === "expired" ? "expired" : (problem?.kind ?? "ledger");
  const organisations = problem?.organisations?.join(", ");
  return (
    <div role="alert" className="sign-failure">
      <b>{t("failed", { kind })}</b>
      <p>{t("failedHint", { kind })}</p>
      {problem && <p className="sign-words">{problem.text}</p>}
      {problem?.code !== undefined && (
        <p className="quiet mono">{organisations === undefined ? t("codeOnly", { code: problem.code }) : t("code", { code: problem.code, organisations })}</p>
      )}
      {children}
    </div>
  );
}

type Properties = {
  change: Change;
  /** What a reader needs to know before signing. */
  summary: ReactNode;
  /** Whom the contract lets do this. */
  roles: readonly string[];
  onDone: (transaction: SignedTransaction) => void;
  onBack: () => void;
  /** The record is not the one that was looked at; what to do about it. */
  conflict?: ReactNode;
};

function WithoutKey({ signer }: { signer: Signer }): ReactElement {
  if (signer.pending) return <p className="empty">{sharedTexts("fetching")}</p>;
  return (
    <div className="sign-without">
      <p role={signer.error === null ? "status" : "alert"}>{signer.error === null ? t("noKey") : problemText(signer.error)}</p>
      {signer.place !== undefined && signer.place.demo_roles.length > 0 && <DemoKeys signer={signer} place={signer.place} />}
      <p>
        <a className="button" href="#/registry/key">
          {t("getKey")}
        </a>
      </p>
    </div>
  );
}

function Who({ signer, current }: { signer: Signer; current: StoredKey }): ReactElement {
  if (signer.usable.length === 1) {
    return (
      <p>
        <Phrases phrases={t.rich("youSign", { name: current.name, role: roleName(current.role), msp: current.msp_id })} />
      </p>
    );
  }
  return (
    <label className="inline-field">
      {t("signWith")}
      <select value={current.certificate_sha256} onChange={(event) => choose(event.target.value)}>
        {signer.usable.map((key) => (
          <option key={key.certificate_sha256} value={key.certificate_sha256}>
            {`${key.name} · ${roleName(key.role)} · ${key.msp_id}`}
          </option>
        ))}
      </select>
    </label>
  );
}

/** The last look before signing, then how far it is, then how it ended. */
export function SignPanel(properties: Properties): ReactElement {
  const signer = useSigner();
  const { current } = signer;
  if (current === undefined) return <WithoutKey signer={signer} />;
  return <WithKey {...properties} signer={signer} current={current} />;
}

function WithKey({ change, summary, roles, onDone, onBack, conflict, signer, current }: Properties & { signer: Signer; current: StoredKey }): ReactElement {
  const api = useApi();
  const [transaction, setTransaction] = useState<SignedTransaction>();
  const [argument, setArgument] = useState(change.argument);
  const running = useRef<Signing>(undefined);
  const button = useRef<HTMLButtonElement>(null);
  useEffect(() => () => running.current?.stop(), []);
  useEffect(() => button.current?.focus(), []);
  const go = useMutation({
    mutationFn: () => {
      const signing = (running.current ??= new Signing(api, current, change, () => {
        setTransaction(running.current?.transaction);
        setArgument(running.current?.argument ?? change.argument);
      }));
      return signing.go();
    },
    onSuccess: (outcome) => {
      if (outcome.state === "valid") onDone(outcome);
    },
  });
  const begun = transaction !== undefined || go.isPending;
  const failed = transaction !== undefined && isFinal(transaction) && transaction.state !== "valid";
  return (
    <div className="sign-panel">
      {summary}
      {!begun && <Who signer={signer} current={current} />}
      {!begun && !roles.includes(current.role) && (
        <p className="sign-warning" role="note">
          {t("notYours", { roles: roles.map(roleName).join(", "), role: roleName(current.role) })}
        </p>
      )}
      <details className="write">
        <summary>{t("exactly")}</summary>
        {/* A region that scrolls must be reachable by keyboard. */}
        {/* eslint-disable-next-line jsx-a11y/no-noninteractive-tabindex */}
        <pre className="mono value" tabIndex={0}>
          {`${change.name} ${laidOut(argument)}`}
        </pre>
        {change.registration !== undefined && <p className="quiet">{t("committed")}</p>}
      </details>
      {begun && (
        <div aria-live="polite">
          <Progress transaction={transaction} />
          {transaction?.state === "unknown" && <p className="sign-warning">{t("waiting")}</p>}
        </div>
      )}
      {go.error !== null && (
        <p role="alert" className="form-problem">
          {go.error instanceof ForeignBytesError ? t("foreign", { why: go.error.message }) : problemText(go.error)}
        </p>
      )}
      {failed && <Failure transaction={transaction}>{transaction.problem?.kind === "changed" && conflict}</Failure>}
      {transaction?.state === "valid" && (
        <p className="sign-done">
          {t("doneIs")} <a href={transactionHref(transaction.tx_id)}>{t("transaction")}</a> <Hash value={transaction.tx_id} label={t("transaction")} />
        </p>
      )}
      <div className="form-actions">
        {(!begun || go.error !== null) && !failed && (
          <button ref={button} type="button" className="button primary" disabled={go.isPending} onClick={() => go.mutate()}>
            {go.error !== null && transaction !== undefined ? t("tryAgain") : t("send")}
          </button>
        )}
        {transaction?.state !== "valid" && (
          <button type="button" className="button" disabled={go.isPending && !failed} onClick={onBack}>
            {t("back")}
          </button>
        )}
      </div>
    </div>
  );
}
