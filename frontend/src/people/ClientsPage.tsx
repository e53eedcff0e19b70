import { useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import { useState, type ReactElement, type SyntheticEvent } from "react";
import { usePages } from "../shared/api/usePages";
import { readDraft } from "../shared/drafts";
import { dayAndTime } from "../shared/format";
import { useServerNow } from "../shared/live/useLive";
import { More } from "../shared/ui/More";
import { Scroll } from "../shared/ui/Scroll";
import { useDraft } from "../shared/useDraft";
import { usePeopleApi, type ClientShown, type ClientRegistration } from "./api";
import { clientTexts as t, scopeWord } from "./clientTexts";
import { useOrganisations } from "./InvitePage";
import { Card, CopyOnce, OrganisationField, Problem } from "./parts";

const PAGE = 50;
const ROLES = ["viewer", "inspector", "pad_operator", "fleet_operator"] as const satisfies readonly ClientRegistration["role"][];
type Draft = Pick<ClientRegistration, "name" | "scopes"> & { role: (typeof ROLES)[number]; msp_id: string };
const EMPTY: Draft = { name: "", scopes: ["wonderland.proofs.read"], role: "viewer", msp_id: "" };

/** Once, and then nowhere. */
function Secret({ client, secret, onDone }: { client: ClientShown; secret: string; onDone: () => void }): ReactElement {
  return (
    <Card title={t("secretOf", { name: client.name })}>
      <p>{t("secretHint")}</p>
      <dl className="facts">
        <div>
          <dt>{t("id")}</dt>
          <dd className="people-link mono">{client.client_id}</dd>
        </div>
        <div>
          <dt>{t("secret")}</dt>
          <dd className="people-link mono" data-testid="client-secret">
            {secret}
          </dd>
        </div>
      </dl>
      <CopyOnce text={secret} labels={{ copy: t("copy"), copied: t("copied"), done: t("done") }} onDone={onDone} />
    </Card>
  );
}

function Register({ start, of, onDone }: { start: Draft; of: string | undefined; onDone: () => void }): ReactElement {
  const api = usePeopleApi();
  const client = useQueryClient();
  const organisations = useOrganisations();
  const [draft, setDraft, clear] = useDraft("client", start);
  const leave = (): void => {
    clear();
    onDone();
  };
  const known = useQuery({ queryKey: ["client-scopes"], queryFn: () => api.clientScopes(), staleTime: Infinity });
  const add = useMutation({
    mutationFn: () => api.addClient(draft),
    onSuccess: clear,
    onSettled: () => client.invalidateQueries({ queryKey: ["clients"] }),
  });
  if (add.data?.client_secret !== undefined) return <Secret client={add.data.client} secret={add.data.client_secret} onDone={onDone} />;
  const own = draft.role === "pad_operator" || draft.role === "fleet_operator";
  const submit = (event: SyntheticEvent): void => {
    event.preventDefault();
    add.mutate();
  };
  return (
    <Card title={t("register")}>
      {of !== undefined && <p className="quiet">{t("rotateHint", { name: of })}</p>}
      <form className="people-form" onSubmit={submit}>
        <label className="people-field">
          {t("name")}
          <input value={draft.name} maxLength={120} required onChange={(event) => setDraft({ ...draft, name: event.target.value })} />
          <small>{t("nameHint")}</small>
        </label>
        <fieldset>
          <legend>{t("mayRead")}</legend>
          {(known.data ?? draft.scopes).map((scope) => (
            <label key={scope} className="people-role">
              <input
                type="checkbox"
                checked={draft.scopes.includes(scope)}
                onChange={(event) => setDraft({ ...draft, scopes: event.target.checked ? [...draft.scopes, scope] : draft.scopes.filter((each) => each !== scope) })}
              />
              <b>{scopeWord(scope)}</b>
              <small className="mono">{scope}</small>
            </label>
          ))}
        </fieldset>
        <label className="people-field">
          {t("asRole")}
          <select value={draft.role} onChange={(event) => setDraft({ ...draft, role: ROLES.find((each) => each === event.target.value) ?? "viewer" })}>
            {ROLES.map((role) => (
              <option key={role} value={role}>
                {t("role", { role })}
              </option>
            ))}
          </select>
        </label>
        {own && <OrganisationField value={draft.msp_id} known={organisations} onChange={(msp_id) => setDraft({ ...draft, msp_id })} />}
        <Problem error={add.error ?? known.error} />
        <div className="people-actions">
          <button type="submit" className="button primary" disabled={add.isPending || draft.scopes.length === 0 || (own && draft.msp_id === "")}>
            {t("register")}
          </button>
          <button type="button" className="button" onClick={leave}>
            {t("back")}
          </button>
        </div>
      </form>
    </Card>
  );
}

function Row({ machine, now_ms, onRotate }: { machine: ClientShown; now_ms: number; onRotate: () => void }): ReactElement {
  const api = usePeopleApi();
  const client = useQueryClient();
  const [sure, setSure] = useState(false);
  const disable = useMutation({
    mutationFn: () => api.disableClient(machine.client_id),
    onSettled: () => client.invalidateQueries({ queryKey: ["clients"] }),
  });
  const over = machine.revoked_ms;
  return (
    <tr>
      <td className="wrap">
        <b>{machine.name}</b>
        <br />
        <small className="mono quiet">{machine.client_id}</small>
      </td>
      <td className="wrap">
        <ul>
          {machine.scopes.map((scope) => (
            <li key={scope} title={scope}>
              {scopeWord(scope)}
            </li>
          ))}
        </ul>
      </td>
      <td className="wrap">
        {t("role", { role: machine.role })}
        {machine.msp_id !== undefined && <span className="quiet"> · {machine.msp_id}</span>}
      </td>
      <td>{t("method", { method: machine.method })}</td>
      <td>{machine.last_token_ms === undefined ? t("never") : dayAndTime(machine.last_token_ms, now_ms)}</td>
      <td>{t("created", { when: dayAndTime(machine.created_ms, now_ms), who: machine.created_by })}</td>
      <td className="right">
        {over !== undefined ? (
          <span className="quiet">{t("disabled", { when: dayAndTime(over, now_ms) })}</span>
        ) : sure ? (
          <span className="people-actions">
            <button type="button" className="button danger" disabled={disable.isPending} onClick={() => disable.mutate()}>
              {t("disableSure")}
            </button>
            <button type="button" className="button" onClick={() => setSure(false)}>
              {t("keep")}
            </button>
          </span>
        ) : (
          <span className="people-actions">
            {machine.method === "client_secret_basic" && (
              <button type="button" className="button" onClick={onRotate}>
                {t("rotate")}
              </button>
            )}
            <button type="button" className="button danger" onClick={() => setSure(true)}>
              {t("disable")}
            </button>
          </span>
        )}
        <Problem error={disable.error} />
      </td>
    </tr>
  );
}

function asDraft({ name, scopes, role, msp_id }: ClientShown): Draft {
  return { name, scopes, role: ROLES.find((each) => each === role) ?? "viewer", msp_id: msp_id ?? "" };
}

/** The machines that may read the API: `#/people/clients`. Only administrators come here, and the backend asks again. */
export function ClientsPage(): ReactElement {
  const api = usePeopleApi();
  const now_ms = useServerNow(10_000);
  // One that was begun before the session ended is open again.
  const [form, setForm] = useState<{ start: Draft; of: string | undefined } | undefined>(() => (readDraft("client") === undefined ? undefined : { start: EMPTY, of: undefined }));
  const { query, rows } = usePages(["clients"], (cursor) => api.clients({ limit: PAGE, ...(cursor !== undefined && { cursor }) }));
  if (form !== undefined) {
    return (
      <div className="people-grid">
        <Register start={form.start} of={form.of} onDone={() => setForm(undefined)} />
      </div>
    );
  }
  return (
    <>
      <p className="quiet">{t("hint")}</p>
      <p className="people-actions people-head">
        <button type="button" className="button primary" onClick={() => setForm({ start: EMPTY, of: undefined })}>
          {t("register")}
        </button>
      </p>
      <Scroll label={t("clients")} className="table-frame float">
        <table className="table people-table num">
          <thead>
            <tr>
              <th scope="col">{t("name")}</th>
              <th scope="col">{t("may")}</th>
              <th scope="col">{t("sees")}</th>
              <th scope="col">{t("authenticates")}</th>
              <th scope="col">{t("used")}</th>
              <th scope="col">{t("registered")}</th>
              <td />
            </tr>
          </thead>
          <tbody>
            {rows.map((machine) => (
              <Row key={machine.client_id} machine={machine} now_ms={now_ms} onRotate={() => setForm({ start: asDraft(machine), of: machine.name })} />
            ))}
          </tbody>
        </table>
        <More query={query} empty={t("none")} count={rows.length} />
      </Scroll>
    </>
  );
}
