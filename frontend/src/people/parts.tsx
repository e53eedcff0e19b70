import { useState, type ReactElement, type ReactNode } from "react";
import { dayAndTime } from "../shared/format";
import { sharedTexts } from "../shared/texts";
import { ROLES, type LinkMade, type PasskeyShown, type Role, type SignInShown } from "./api";
import { peopleTexts as t } from "./texts";

export function Problem({ error }: { error: Error | null }): ReactElement | null {
  return error === null ? null : (
    <p className="people-problem" role="alert">
      {error.message}
    </p>
  );
}

/** While something is fetched, and when it cannot be. */
export function Fetching({ query }: { query: { error: Error | null; refetch: () => unknown } }): ReactElement {
  if (query.error === null) return <p className="empty">{t("loading")}</p>;
  return (
    <p className="empty" role="alert">
      {query.error.message}{" "}
      <button type="button" className="button" onClick={() => void query.refetch()}>
        {sharedTexts("tryAgain")}
      </button>
    </p>
  );
}

export function Card({ title, children }: { title: string; children: ReactNode }): ReactElement {
  return (
    <section className="float people-card" aria-label={title}>
      <h2>{title}</h2>
      {children}
    </section>
  );
}

export function rolesInWords(roles: readonly Role[]): string {
  return roles.map((role) => t("role", { role })).join(", ");
}

/** Which roles somebody has, each with what it means. */
export function RoleBoxes({ roles, onChange }: { roles: readonly Role[]; onChange: (roles: Role[]) => void }): ReactElement {
  return (
    <fieldset>
      <legend>{t("roles")}</legend>
      {ROLES.map((role) => (
        <label key={role} className="people-role">
          <input
            type="checkbox"
            checked={roles.includes(role)}
            onChange={(event) => onChange(ROLES.filter((each) => (each === role ? event.target.checked : roles.includes(each))))}
          />
          <b>{t("role", { role })}</b>
          <small>{t("roleHint", { role })}</small>
        </label>
      ))}
    </fieldset>
  );
}

export function needsOrganisation(roles: readonly Role[]): boolean {
  return roles.includes("pad_operator") || roles.includes("fleet_operator");
}

export function OrganisationField({ value, known, onChange }: { value: string; known: readonly string[]; onChange: (value: string) => void }): ReactElement {
  const all = value === "" || known.includes(value) ? known : [...known, value];
  return (
    <label className="people-field">
      {t("organisation")}
      <select value={value} onChange={(event) => onChange(event.target.value)}>
        <option value="">{t("none")}</option>
        {all.map((each) => (
          <option key={each}>{each}</option>
        ))}
      </select>
      <small>{t("organisationHint")}</small>
    </label>
  );
}

const BROWSERS = ["Edg", "OPR", "Firefox", "Chrome", "Safari"] as const;
const NAMES: Record<string, string> = { Edg: "Edge", OPR: "Opera" };
const SYSTEMS = ["Windows", "Android", "iPhone", "iPad", "Mac OS", "Linux"] as const;

/** "Firefox on Linux": enough to recognise one's own. */
export function browserInWords(agent: string): string {
  const browser = BROWSERS.find((each) => agent.includes(`${each}/`));
  if (browser === undefined) return agent === "" ? t("unknownBrowser") : agent.slice(0, 60);
  const system = SYSTEMS.find((each) => agent.includes(each));
  const name = NAMES[browser] ?? browser;
  return system === undefined ? name : t("browser", { browser: name, system: system === "Mac OS" ? "macOS" : system });
}

export function SignIns({ sign_ins, now_ms, onEnd }: { sign_ins: readonly SignInShown[]; now_ms: number; onEnd: (id: string) => void }): ReactElement {
  if (sign_ins.length === 0) return <p className="quiet">{t("noSignIns")}</p>;
  return (
    <ul className="people-rows num">
      {sign_ins.map((each) => (
        <li key={each.sign_in_id}>
          <span>
            <b>{browserInWords(each.browser)}</b> {t("method", { method: each.method })}
            {each.current && ` · ${t("thisBrowser")}`}
            <small>
              {t("since", {
                since: dayAndTime(each.created_ms, now_ms),
                seen: dayAndTime(each.last_seen_ms, now_ms),
                until: dayAndTime(each.expires_ms, now_ms),
              })}
            </small>
          </span>
          {!each.current && (
            <button type="button" className="button" onClick={() => onEnd(each.sign_in_id)}>
              {t("end")}
            </button>
          )}
        </li>
      ))}
    </ul>
  );
}

export function passkeyTimes(passkey: PasskeyShown, now_ms: number): string {
  const used = passkey.last_used_ms === undefined ? t("neverUsed") : t("used", { when: dayAndTime(passkey.last_used_ms, now_ms) });
  return `${t("created", { when: dayAndTime(passkey.created_ms, now_ms) })} · ${used}`;
}

/** Under what is shown once: copies it, and says that it was; then it is put away. */
export function CopyOnce({ text, labels, onDone }: { text: string; labels: { copy: string; copied: string; done: string }; onDone: () => void }): ReactElement {
  const [copied, setCopied] = useState(false);
  return (
    <div className="people-actions">
      <button type="button" className="button primary" onClick={() => void navigator.clipboard.writeText(text).then(() => setCopied(true), () => setCopied(false))}>
        <span aria-live="polite">{copied ? labels.copied : labels.copy}</span>
      </button>
      <button type="button" className="button" onClick={onDone}>
        {labels.done}
      </button>
    </div>
  );
}

/** A link that was made just now. It goes when the page does. */
export function MadeLink({ made, now_ms, onDone }: { made: LinkMade; now_ms: number; onDone: () => void }): ReactElement {
  const url = `${location.origin}/#token=${made.token}`;
  return (
    <Card title={t("linkFor", { name: made.person.name })}>
      <p>{t("linkHint", { until: dayAndTime(made.expires_ms, now_ms) })}</p>
      <p className="people-link mono" data-testid="made-link">
        {url}
      </p>
      <CopyOnce text={url} labels={{ copy: t("copyLink"), copied: t("copied"), done: t("done") }} onDone={onDone} />
    </Card>
  );
}
