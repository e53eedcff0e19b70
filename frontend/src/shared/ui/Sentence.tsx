import type { ReactElement } from "react";
import type { Phrase } from "../i18n/texts";

/** Phrases whose weightiest words stand out. */
export function Phrases({ phrases }: { phrases: readonly Phrase[] }): ReactElement {
  return <>{phrases.map((phrase, i) => (typeof phrase === "string" ? phrase : <b key={i}>{phrase.strong}</b>))}</>;
}

/** A sentence of such phrases, as a paragraph. */
export function Sentence({ phrases }: { phrases: readonly Phrase[] }): ReactElement {
  return (
    <p>
      <Phrases phrases={phrases} />
    </p>
  );
}
