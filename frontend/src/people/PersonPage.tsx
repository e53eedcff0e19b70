import { useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import type { SyntheticEvent, ReactElement } from "react";
import { go, placeHash } from "../shared/address/location";
import { ApiError } from "../shared/api/api";
import { keepDraft } from "../shared/drafts";
import { useServerNow } from "../shared/live/useLive";
import { useDraft } from "../shared/useDraft";
import { usePeopleApi, type PersonChange, type PersonDetail, type PersonShown, type Role } from "./api";
import { useOrganisations } from "./InvitePage";
import { Card, Fetching, MadeLink, needsOrganisation, OrganisationField, passkeyTimes, Problem, RoleBoxes, SignIns } from "./parts";
import { signInMethodWords } from "./PeoplePage";
import { peopleTexts as t } from "./texts";

const BACK = { room: "people", path: [], query: {} } as const;

type Draft = { name: string; email: string; roles: Role[]; msp_id: string };

function draftOf(person: PersonShown): Draft {
  return { name: person.name, email: person.email ?? "", roles: [...person.roles], msp_id: person.msp_id ?? "" };
}

/** Only what differs; so that two administrators who change different things do not undo each other's. */
function changes(person: PersonShown, draft: Draft): Omit<PersonChange, "revision"> {
  const before = draftOf(person);
  return {
    ...(draft.name !== before.name && { name: draft.name }),
    ...(draft.email !== before.email && { email: draft.email }),
    ...(draft.roles.join() !== before.roles.join() && { roles: draft.roles }),
    ...(draft.msp_id !== before.msp_id && { msp_id: draft.msp_id }),
  };
}

type FormProperties = { person: PersonShown; onChange: (change: Omit<PersonChange, "revision">) => void; busy: boolean };

function PersonForm({ person, onChange, busy }: FormProperties): ReactElement {
  const organisations = useOrganisations();
  const [draft, setDraft] = useDraft(`person/${person.person_id}`, draftOf(person));
  const change = (part: Partial<Draft>): void => setDraft({ ...draft, ...part });
  const wanted = changes(person, draft);
  const submit = (event: SyntheticEvent): void => {
    event.preventDefault();
    onChange(wanted);
  };
  const complete = draft.roles.length > 0 && (!needsOrganisation(draft.roles) || draft.msp_id !== "");
  return (
    <form className="people-form" onSubmit={submit}>
      <label className="people-field">
        {t("name")}
        <input value={draft.name} onChange={(event) => change({ name: event.target.value })} maxLength={100} required />
      </label>
      <label className="people-field">
        {t("email")}
        <input type="email" value={draft.email} onChange={(event) => change({ email: event.target.value })} maxLength={254} />
      </label>
      <RoleBoxes roles={draft.roles} onChange={(roles) => change({ roles })} />
      <OrganisationField value={draft.msp_id} known={organisations} onChange={(msp_id) => change({ msp_id })} />
      <div className="people-actions">
        <button type="submit" className="button primary" disabled={busy || !complete || Object.keys(wanted).length === 0}>
          {t("save")}
        </button>
      </div>
    </form>
  );
}

/** One account: what its owner may, how and where they sign in. */
export function PersonPage({ person_id }: { person_id: string }): ReactElement {
  const api = usePeopleApi();
  const client = useQueryClient();
  const now_ms = useServerNow(10_000);
  const key = ["person", person_id];
  const query = useQuery({ queryKey: key, queryFn: () => api.person(person_id) });
  const put = (found: PersonDetail): void => {
    client.setQueryData(key, found);
    void client.invalidateQueries({ queryKey: ["people"] });
  };
  const work = useMutation({
    mutationFn: (wanted: () => Promise<PersonDetail>) => wanted(),
    onSuccess: (found) => {
      keepDraft(`person/${person_id}`, undefined);
      put(found);
    },
    // What somebody else has changed is shown; what was entered stays.
    onError: (error) => error instanceof ApiError && error.status === 409 && void query.refetch(),
  });
  const link = useMutation({ mutationFn: () => api.newLink(person_id) });
  const withdraw = useMutation({
    mutationFn: () => api.withdraw(person_id),
    onSuccess: () => {
      void client.invalidateQueries({ queryKey: ["people"] });
      go(BACK);
    },
  });
  if (query.data === undefined) return <Fetching query={query} />;
  const { person, passkeys, sign_ins } = query.data;
  const change = (wanted: Omit<PersonChange, "revision">): void => work.mutate(() => api.change(person_id, { revision: person.revision, ...wanted }));
  return (
    <>
      <p className="people-actions people-head">
        <a className="button" href={placeHash(BACK)}>
          {t("back")}
        </a>
      </p>
      <div className="people-grid">
        <Card title={person.name}>
          {person.state !== "active" && <p className={`people-state-${person.state}`}>{t("state", { state: person.state })}</p>}
          <Problem error={work.error ?? withdraw.error ?? link.error} />
          {work.isSuccess && (
            <p className="people-good" role="status">
              {t("saved")}
            </p>
          )}
          <PersonForm person={person} onChange={change} busy={work.isPending} />
        </Card>
        <Card title={t("ways")}>
          <p>{signInMethodWords(person)}</p>
          {passkeys.length > 0 && (
            <ul className="people-rows">
              {passkeys.map((each) => (
                <li key={each.credential_id}>
                  <span>
                    <b>{each.name}</b>
                    <small className="num">{passkeyTimes(each, now_ms)}</small>
                  </span>
                </li>
              ))}
            </ul>
          )}
          {person.state !== "suspended" && (
            <>
              <p className="quiet">{t("newLinkHint", { state: person.state })}</p>
              <div className="people-actions">
                <button type="button" className="button" disabled={link.isPending} onClick={() => link.mutate()}>
                  {t("newLink", { state: person.state })}
                </button>
                {person.state === "invited" && (
                  <button type="button" className="button" disabled={withdraw.isPending} onClick={() => withdraw.mutate()}>
                    {t("withdraw")}
                  </button>
                )}
                {person.state === "active" && (
                  <button type="button" className="button" disabled={work.isPending} onClick={() => change({ state: "suspended" })}>
                    {t("suspend")}
                  </button>
                )}
              </div>
            </>
          )}
          {person.state === "suspended" && (
            <div className="people-actions">
              <button type="button" className="button primary" disabled={work.isPending} onClick={() => change({ state: "active" })}>
                {t("restore")}
              </button>
            </div>
          )}
        </Card>
        {link.data !== undefined && <MadeLink key={link.data.token} made={link.data} now_ms={now_ms} onDone={() => link.reset()} />}
        <Card title={t("theirSignIns")}>
          <SignIns sign_ins={sign_ins} now_ms={now_ms} onEnd={(id) => work.mutate(() => api.endSignIn(person_id, id))} />
        </Card>
      </div>
    </>
  );
}
