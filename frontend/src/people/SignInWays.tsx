import { useMutation, useQuery } from "@tanstack/react-query";
import { useState, type SyntheticEvent, type ReactElement, type ReactNode } from "react";
import type { SignedIn } from "../shared/api/records";
import { sharedTexts } from "../shared/texts";
import { Sentence } from "../shared/ui/Sentence";
import { ROLES, usePeopleApi, type LinkShown, type SignInMethods } from "./api";
import "./people.css";
import { signInTexts as t } from "./texts";
import { isSite } from "./webauthn";

type Done = (person: SignedIn) => void;

function go(url: string): void {
  location.assign(url);
}

/** Where passkeys work, when it is not here. */
function OtherAddress({ ways }: { ways: SignInMethods }): ReactElement {
  const url = `${location.protocol}//${ways.site}${location.port === "" ? "" : `:${location.port}`}${location.pathname}${location.hash}`;
  return (
    <div className="sign-in-hint">
      <Sentence phrases={t.rich("otherAddress", { site: ways.site })} />
      <p>
        <a href={url}>{t("openThere")}</a>
      </p>
    </div>
  );
}

function OidcButton({ ways, token, name }: { ways: SignInMethods; token?: string; name?: string }): ReactElement | null {
  const api = usePeopleApi();
  const start = useMutation({ mutationFn: () => api.startOidc(token, name), onSuccess: go });
  if (ways.oidc === undefined) return null;
  return (
    <>
      <span className="sign-in-or">{t("or")}</span>
      <button type="button" className="button" disabled={start.isPending || (name?.trim() === "")} onClick={() => start.mutate()}>
        {t("oidc", { name: ways.oidc })}
      </button>
      {start.error !== null && (
        <p className="sign-in-problem" role="alert">
          {start.error.message}
        </p>
      )}
    </>
  );
}

function Hint({ children }: { children: ReactNode }): ReactElement {
  return (
    <p className="sign-in-hint">
      {children} <code className="mono">wonderland backend link</code> {t("onServer")}
    </p>
  );
}

/** How one can sign in here: by passkey, by the OpenID provider, and what to do without either. */
export function SignInWays({ onDone, onRetry }: { onDone: Done; onRetry: () => void }): ReactElement {
  const api = usePeopleApi();
  const ways = useQuery({ queryKey: ["sign-in-methods"], queryFn: () => api.signInMethods(), staleTime: Infinity });
  const passkey = useMutation({ mutationFn: () => api.signInByPasskey(), onSuccess: onDone });
  if (ways.data === undefined) {
    return (
      <>
        {ways.isError && (
          <p className="sign-in-problem" role="alert">
            {ways.error.message}
          </p>
        )}
        <Hint>{t("lost")}</Hint>
        <button type="button" className="button" onClick={() => (ways.isError ? void ways.refetch() : onRetry())}>
          {sharedTexts("tryAgain")}
        </button>
      </>
    );
  }
  if (!ways.data.set_up) {
    return (
      <>
        <p className="sign-in-question">{t("notSetUp")}</p>
        <Hint>{t("notSetUpHint")}</Hint>
      </>
    );
  }
  return (
    <>
      <div className="sign-in-ways">
        {isSite(ways.data.site) && (
          <button type="button" className={ways.data.demo ? "button" : "button primary"} disabled={passkey.isPending} onClick={() => passkey.mutate()}>
            {passkey.isPending ? t("waiting") : t("passkey")}
          </button>
        )}
        <OidcButton ways={ways.data} />
      </div>
      {passkey.error !== null && (
        <p className="sign-in-problem" role="alert">
          {passkey.error.message}
        </p>
      )}
      {!isSite(ways.data.site) && !ways.data.demo && <OtherAddress ways={ways.data} />}
      <Hint>{t(ways.data.demo ? "demo" : "lost")}</Hint>
    </>
  );
}

const KNOWN_KINDS = ["set_up", "invitation", "recovery"] as const;

/** A link that makes an account, or gives one back: its owner chooses how to sign in from now on. */
export function AcceptLink({ token, link, onDone }: { token: string; link: LinkShown; onDone: Done }): ReactElement {
  const api = usePeopleApi();
  const ways = useQuery({ queryKey: ["sign-in-methods"], queryFn: () => api.signInMethods(), staleTime: Infinity });
  const first = link.kind === "set_up";
  const [name, setName] = useState("");
  const [passkeyName, setPasskeyName] = useState(() => t("thisDevice"));
  const accept = useMutation({
    mutationFn: () => api.acceptByPasskey(token, first ? name : undefined, passkeyName),
    onSuccess: onDone,
  });
  const kind = KNOWN_KINDS.find((each) => each === link.kind) ?? "invitation";
  const title = first ? t("setUp") : t(kind === "recovery" ? "recovery" : "invitation", { name: link.name ?? "" });
  const roles = ROLES.filter((role) => link.roles.includes(role)).map((role) => t("role", { role })).join(", ");
  const submit = (event: SyntheticEvent): void => {
    event.preventDefault();
    accept.mutate();
  };
  return (
    <>
      <p className="sign-in-question">{title}</p>
      <p>{first ? t("setUpHint") : t(kind === "recovery" ? "recoveryHint" : "invitationHint", { roles })}</p>
      <form className="sign-in-ways" onSubmit={submit}>
        {first && (
          <label className="people-field">
            {t("name")}
            <input value={name} onChange={(event) => setName(event.target.value)} maxLength={100} required autoComplete="name" />
            <small>{t("nameHint")}</small>
          </label>
        )}
        {(ways.data === undefined || isSite(ways.data.site)) && (
          <>
            <label className="people-field">
              {t("passkeyName")}
              <input value={passkeyName} onChange={(event) => setPasskeyName(event.target.value)} maxLength={100} required />
              <small>{t("passkeyNameHint")}</small>
            </label>
            <button type="submit" className="button primary" disabled={accept.isPending}>
              {accept.isPending ? t("waiting") : t("makePasskey")}
            </button>
          </>
        )}
        {ways.data !== undefined && <OidcButton ways={ways.data} token={token} {...(first && { name })} />}
      </form>
      {accept.error !== null && (
        <p className="sign-in-problem" role="alert">
          {accept.error.message}
        </p>
      )}
      {ways.data !== undefined && !isSite(ways.data.site) && <OtherAddress ways={ways.data} />}
    </>
  );
}
