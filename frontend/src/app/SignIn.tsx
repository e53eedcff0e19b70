import type { ReactElement } from "react";
import type { SignedIn } from "../shared/api/records";
import { AcceptLink, SignInWays } from "../people/SignInWays";
import type { LinkShown } from "../people/api";
import { LanguageButton, ThemeButton } from "./Header";
import { signInTexts as t } from "../people/texts";

type Properties = {
  problem: string | undefined;
  /** A link that is not for signing in at once, and its token. */
  accepting: { token: string; link: LinkShown } | undefined;
  onRetry: () => void;
  onDone: (person: SignedIn) => void;
};

/** Without a sign-in: how to get one, and what went wrong with the last. */
export function SignInPage({ problem, accepting, onRetry, onDone }: Properties): ReactElement {
  return (
    <main className="sign-in">
      <div className="sign-in-corner">
        <LanguageButton />
        <ThemeButton />
      </div>
      <svg width="56" height="56" viewBox="0 0 24 24" aria-hidden="true">
        <circle cx="12" cy="12" r="9.5" fill="none" stroke="var(--accent)" strokeWidth="1" strokeDasharray="3 2.6" />
        <path d="M12 6.5l5 5.5-5 5.5-5-5.5z" fill="var(--accent)" />
      </svg>
      <h1>Wonderland</h1>
      {problem !== undefined && (
        <p className="sign-in-problem" role="alert">
          {problem}
        </p>
      )}
      {accepting === undefined ? (
        <>
          <p className="sign-in-question">{t("question")}</p>
          <SignInWays onDone={onDone} onRetry={onRetry} />
        </>
      ) : (
        <AcceptLink {...accepting} onDone={onDone} />
      )}
    </main>
  );
}
