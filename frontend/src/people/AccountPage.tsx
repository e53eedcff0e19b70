import { useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import { useState, type SyntheticEvent, type ReactElement } from "react";
import { useApi } from "../shared/api/api";
import type { SignedIn } from "../shared/api/records";
import { duration } from "../shared/format";
import { LOCALES, setReading, useReading } from "../shared/i18n/locale";
import { useServerNow } from "../shared/live/useLive";
import { usePeopleApi, type PasskeyShown, type PersonDetail } from "./api";
import { Card, Fetching, passkeyTimes, Problem, rolesInWords, SignIns } from "./parts";
import { peopleTexts as t, signInTexts } from "./texts";
import { canPasskeys } from "./webauthn";

type Change = (work: () => Promise<PersonDetail>) => void;

function Passkey({ passkey, now_ms, change }: { passkey: PasskeyShown; now_ms: number; change: Change }): ReactElement {
  const api = usePeopleApi();
  const [name, setName] = useState<string | undefined>(undefined);
  const rename = (event: SyntheticEvent): void => {
    event.preventDefault();
    if (name !== undefined) change(() => api.renamePasskey(passkey.credential_id, name));
    setName(undefined);
  };
  return (
    <li>
      {name === undefined ? (
        <span>
          <b>{passkey.name}</b>
          <small className="num">{passkeyTimes(passkey, now_ms)}</small>
        </span>
      ) : (
        <form className="people-field" onSubmit={rename}>
          <input aria-label={t("renameNamed", { name: passkey.name })} value={name} onChange={(event) => setName(event.target.value)} maxLength={100} required />
        </form>
      )}
      <span className="people-actions">
        {name === undefined && (
          <button type="button" className="button" onClick={() => setName(passkey.name)}>
            {t("rename")}
          </button>
        )}
        <button
          type="button"
          className="button"
          aria-label={t("removeNamed", { name: passkey.name })}
          onClick={() => change(() => api.removePasskey(passkey.credential_id))}
        >
          {t("remove")}
        </button>
      </span>
    </li>
  );
}

function NewPasskey({ change, busy }: { change: Change; busy: boolean }): ReactElement {
  const api = usePeopleApi();
  const [name, setName] = useState(() => signInTexts("thisDevice"));
  if (!canPasskeys()) return <p className="quiet">{t("noPasskeys")}</p>;
  const add = (event: SyntheticEvent): void => {
    event.preventDefault();
    change(() => api.addPasskey(name));
  };
  return (
    <form className="people-form" onSubmit={add}>
      <label className="people-field">
        {t("newPasskeyName")}
        <input value={name} onChange={(event) => setName(event.target.value)} maxLength={100} required />
      </label>
      <div className="people-actions">
        <button type="submit" className="button primary" disabled={busy}>
          {t("addPasskey")}
        </button>
      </div>
    </form>
  );
}

function Language(): ReactElement {
  const { locale } = useReading();
  return (
    <label className="people-field">
      {t("language")}
      <select
        value={locale}
        onChange={(event) => {
          const chosen = LOCALES.find((each) => each === event.target.value);
          if (chosen !== undefined) setReading({ locale: chosen });
        }}
      >
        {LOCALES.map((each) => (
          <option key={each} value={each} lang={each}>
            {t("languageName", { locale: each })}
          </option>
        ))}
      </select>
    </label>
  );
}

/** One's own passkeys, sign-ins, language. */
export function AccountPage(): ReactElement {
  const api = usePeopleApi();
  const client = useQueryClient();
  const now_ms = useServerNow(10_000);
  const me = useQuery({ queryKey: ["me"], queryFn: () => api.me() });
  const work = useMutation({
    mutationFn: (wanted: () => Promise<PersonDetail>) => wanted(),
    onSuccess: (found) => client.setQueryData(["me"], found),
  });
  const whole = useApi();
  const leave = useMutation({ mutationFn: () => whole.signOut(), onSettled: () => location.reload() });
  const idle_s = client.getQueryData<SignedIn>(["who"])?.idle_s;
  if (me.data === undefined) return <Fetching query={me} />;
  const { person, passkeys, sign_ins } = me.data;
  const roles = rolesInWords(person.roles);
  return (
    <div className="people-grid">
      <Card title={person.name}>
        <p>{person.msp_id === undefined ? t("mine", { roles }) : t("mineOf", { roles, msp: person.msp_id })}</p>
        <Language />
        <div className="people-actions">
          <button type="button" className="button" disabled={leave.isPending} onClick={() => leave.mutate()}>
            {t("signOut")}
          </button>
        </div>
      </Card>
      <Card title={t("yourPasskeys")}>
        <Problem error={work.error} />
        {passkeys.length === 0 ? (
          <p className="quiet">{t("noPasskeysYet")}</p>
        ) : (
          <ul className="people-rows">
            {passkeys.map((each) => (
              <Passkey key={each.credential_id} passkey={each} now_ms={now_ms} change={work.mutate} />
            ))}
          </ul>
        )}
        <NewPasskey change={work.mutate} busy={work.isPending} />
      </Card>
      <Card title={t("signIns")}>
        <SignIns sign_ins={sign_ins} now_ms={now_ms} onEnd={(id) => work.mutate(() => api.endOwnSignIn(id))} />
        {idle_s !== undefined && <p className="quiet num">{t("idle", { idle: duration(idle_s * 1000) })}</p>}
      </Card>
    </div>
  );
}
