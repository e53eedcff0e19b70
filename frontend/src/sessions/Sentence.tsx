import type { ReactElement } from "react";
import type { Phrase } from "./words";

/** A sentence whose weightiest words stand out. */
export function Sentence({ phrases }: { phrases: readonly Phrase[] }): ReactElement {
  return (
    <p>
      {phrases.map((phrase, i) => (typeof phrase === "string" ? phrase : <b key={i}>{phrase.strong}</b>))}
    </p>
  );
}
