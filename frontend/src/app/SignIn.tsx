import type { ReactElement } from "react";
import { sharedTexts } from "../shared/texts";
import { LanguageButton, ThemeButton } from "./Header";
import { appTexts as t } from "./texts";

/** Without a sign-in: how to get a link, and what went wrong with the last one. */
export function SignInPage({ problem, onRetry }: { problem: string | undefined; onRetry: () => void }): ReactElement {
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
      <p className="sign-in-question">{t("question")}</p>
      {problem !== undefined && (
        <p className="sign-in-problem" role="alert">
          {problem}
        </p>
      )}
      <p>
        {t("openLink")} <code className="mono">wonderland backend link</code> {t("onServer")}
      </p>
      <button type="button" className="button" onClick={onRetry}>
        {sharedTexts("tryAgain")}
      </button>
    </main>
  );
}
