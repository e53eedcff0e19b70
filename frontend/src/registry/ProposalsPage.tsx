import { useQuery, useQueryClient } from "@tanstack/react-query";
import { useCallback, type ReactElement } from "react";
import { registryHref, toRegistry } from "../shared/address/registryLinks";
import { transactionHref } from "../shared/address/ledgerLinks";
import { useApi } from "../shared/api/api";
import { usePages } from "../shared/api/usePages";
import { dayAndTime } from "../shared/format";
import { useLive, useServerNow } from "../shared/live/useLive";
import type { Topic } from "../shared/live/store";
import type { JsonObject } from "../shared/signing/canonical";
import { SignPanel } from "../shared/signing/SignPanel";
import { useSigner } from "../shared/signing/useSigner";
import { sharedTexts } from "../shared/texts";
import { Hash } from "../shared/ui/Hash";
import { More } from "../shared/ui/More";
import { Symbol } from "../shared/ui/Symbol";
import { commonPolicies, pad as fetchPad, proposals, type RegistryProposal } from "./calls";
import { ChangeForm } from "./ChangeForm";
import { Summary } from "./Summary";
import { registryTexts as t } from "./texts";

const STATUS: readonly Topic[] = ["status"];
const PAGE = 20;
const LOOKS = { open: "inconclusive", approved: "verified", withdrawn: "refuted", expired: "silent" } as const;
const APPROVERS = ["admin", "inspector"] as const;

type Proposed = RegistryProposal["record"];

function titleOf({ policy, reinstatement }: Proposed): string {
  if (policy === undefined) return t("proposalOf", { what: "reinstatement", pad: "", action: "", drone: reinstatement?.uav_id ?? "" });
  const action = t("policyFor", { action: policy.action === "*" ? "any" : policy.action });
  return t("proposalOf", { what: "policy", pad: policy.pad_id === "*" ? t("anyPad") : policy.pad_id, action, drone: "" });
}

/** What is approved, word for word: this is what the second person signs. */
function approval({ change_id, policy, reinstatement }: Proposed): JsonObject {
  return { change_id, ...(policy !== undefined && { policy: policy }), ...(reinstatement !== undefined && { reinstatement: reinstatement }) };
}

/** What will be different; of a policy beside what holds there now. */
function Content({ record }: { record: Proposed }): ReactElement {
  const api = useApi();
  const { policy, reinstatement } = record;
  const now = useQuery({
    queryKey: ["registry", "policies-at", policy?.pad_id],
    queryFn: () => (policy?.pad_id === "*" ? commonPolicies(api) : fetchPad(api, policy?.pad_id ?? "").then(({ policies }) => policies)),
    enabled: policy !== undefined && record.state === "open",
  });
  if (policy === undefined) return <Summary argument={{ ...reinstatement }} about={{ uav_id: "" }} before={undefined} />;
  const holding = now.data?.find(({ action }) => action === policy.action)?.policy;
  return <Summary argument={policy} about={{ pad_id: "", action: "" }} before={holding === undefined ? undefined : { policy: holding }} />;
}

function Facts({ record }: { record: Proposed }): ReactElement {
  const now_ms = useServerNow(60_000);
  const { proposed_by, proposed_ms, expires_ms, note, decided_by, decided_ms, decided_note, state } = record;
  return (
    <dl className="facts num">
      <div>
        <dt>{t("proposedBy")}</dt>
        <dd>{`${proposed_by.name} · ${proposed_by.msp_id} · ${dayAndTime(proposed_ms, now_ms)}`}</dd>
      </div>
      {note !== undefined && (
        <div>
          <dt>{t("note")}</dt>
          <dd className="wrap">{note}</dd>
        </div>
      )}
      {decided_by === undefined ? (
        <div>
          <dt>{t("approvableUntil")}</dt>
          <dd>{dayAndTime(expires_ms, now_ms)}</dd>
        </div>
      ) : (
        <div>
          <dt>{t(state === "approved" ? "approvedBy" : "turnedDownBy")}</dt>
          <dd className="wrap">{[decided_by.name, decided_by.msp_id, dayAndTime(decided_ms ?? 0, now_ms), ...(decided_note === undefined ? [] : [decided_note])].join(" · ")}</dd>
        </div>
      )}
    </dl>
  );
}

function Deciding({ proposal, form, onDone }: { proposal: RegistryProposal; form: string; onDone: () => void }): ReactElement {
  const { record, version } = proposal;
  const { current } = useSigner();
  const back = (): void => toRegistry(["proposals"]);
  if (form === "turn-down") {
    return <ChangeForm name="withdraw-change" about={{ change_id: record.change_id }} before={{ record: {}, version }} onDone={onDone} onCancel={back} />;
  }
  return (
    <>
      {current?.certificate_sha256 === record.proposed_by.certificate_sha256 && (
        <p className="sign-warning" role="note">
          {t("notYourOwn")}
        </p>
      )}
      <SignPanel change={{ name: "ApproveChange", argument: approval(record), seen: version }} roles={APPROVERS} summary={<Content record={record} />} onDone={onDone} onBack={back} />
    </>
  );
}

function Proposal({ proposal, form, onDone }: { proposal: RegistryProposal; form: string | undefined; onDone: () => void }): ReactElement {
  const { record, state } = proposal;
  const deciding = form === "approve" || form === "turn-down";
  return (
    <section className="float card" aria-labelledby={record.change_id}>
      <h2 id={record.change_id}>
        {titleOf(record)}{" "}
        <span className={`status look-${LOOKS[state]}`}>
          <Symbol look={LOOKS[state]} size={15} />
          {t("proposalIs", { state })}
        </span>
      </h2>
      <Facts record={record} />
      {deciding ? <Deciding key={form} proposal={proposal} form={form} onDone={onDone} /> : <Content record={record} />}
      {!deciding && (
        <div className="form-actions">
          {state === "open" && (
            <>
              <a className="button primary" href={registryHref(["proposals", record.change_id, "approve"])} aria-describedby={record.change_id}>
                {t("approve")}
              </a>
              <a className="button danger" href={registryHref(["proposals", record.change_id, "turn-down"])} aria-describedby={record.change_id}>
                {t("turnDown")}
              </a>
            </>
          )}
          <a href={transactionHref(record.change_id)}>tx</a> <Hash value={record.change_id} label="tx" />
        </div>
      )}
    </section>
  );
}

/** What takes two people: what waits for the second one, and what became of the rest. */
export function ProposalsPage({ id, form }: { id: string | undefined; form: string | undefined }): ReactElement {
  const api = useApi();
  const client = useQueryClient();
  const mark = String(useLive(STATUS, (store) => store.status?.ledger.mirrored) ?? "");
  const { query, rows } = usePages(["registry", "proposals"], (cursor) => proposals(api, { limit: PAGE, ...(cursor !== undefined && { cursor }) }), {
    keep: true,
    fresh: { mark, newest: () => mark },
  });
  const fresh = useCallback(() => void client.invalidateQueries({ queryKey: ["registry"] }), [client]);
  if (query.data === undefined) {
    return (
      <p className="empty" role={query.isError ? "alert" : "status"}>
        {query.isError ? query.error.message : sharedTexts("fetching")}
      </p>
    );
  }
  return (
    <>
      <p className="quiet lead">{t("proposalHint")}</p>
      {rows.map((each) => (
        <Proposal key={each.record.change_id} proposal={each} form={each.record.change_id === id ? form : undefined} onDone={fresh} />
      ))}
      <More query={query} empty={t("noProposals")} count={rows.length} />
    </>
  );
}
