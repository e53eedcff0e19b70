import type { ReactElement } from "react";
import { ThemeButton } from "./Header";

/** Without a sign-in: how to get a link, and what went wrong with the last one. */
export function SignInPage({ problem, onRetry }: { problem: string | undefined; onRetry: () => void }): ReactElement {
  return (
    <main className="sign-in">
      <div className="sign-in-corner">
        <ThemeButton />
      </div>
      <svg width="56" height="56" viewBox="0 0 24 24" aria-hidden="true">
        <circle cx="12" cy="12" r="9.5" fill="none" stroke="var(--accent)" strokeWidth="1" strokeDasharray="3 2.6" />
        <path d="M12 6.5l5 5.5-5 5.5-5-5.5z" fill="var(--accent)" />
      </svg>
      <h1>Wonderland</h1>
      <p className="sign-in-question">Is it where it says?</p>
      {problem !== undefined && (
        <p className="sign-in-problem" role="alert">
          {problem}
        </p>
      )}
      <p>
        Open the link that the server printed when it started. It works once and signs this browser in. A new one comes with{" "}
        <code className="mono">wonderland backend link</code> on the server.
      </p>
      <button type="button" className="button" onClick={onRetry}>
        Try again
      </button>
    </main>
  );
}
