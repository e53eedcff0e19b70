import type { ReactElement } from "react";
import { bearing } from "./course";
import { courseTexts } from "./courseTexts";

type Key = keyof (typeof courseTexts.all)["en"];

/** What a verdict of this assurance excludes, and what it cannot. */
export function Bearing({ level }: { level: number }): ReactElement {
  const { excluded, open } = bearing(level);
  return (
    <section className="float card bearing">
      <h2>{courseTexts("bears")}</h2>
      <p className="quiet">{courseTexts("level", { level })}</p>
      <h3>{courseTexts("excludes")}</h3>
      <ul>
        {excluded.map((key) => (
          <li key={key}>{courseTexts(key as Key)}</li>
        ))}
      </ul>
      <h3>{courseTexts("open")}</h3>
      <ul>
        {open.map((key) => (
          <li key={key}>{courseTexts(key as Key)}</li>
        ))}
      </ul>
    </section>
  );
}
