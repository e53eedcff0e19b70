import { useState, type ReactElement } from "react";
import { useLive } from "../shared/live/useLive";
import type { Topic } from "../shared/live/store";
import type { Failing } from "./failures";
import { missingTexts, whyMissing } from "./missingTexts";
import type { BaseMap } from "./place";
import { mapTexts as t } from "./texts";

const TOPICS: readonly Topic[] = ["status"];
const SETTING = "WONDERLAND_BACKEND_MAP__";

type Note = { key: string; text: string; setting?: string };

function notes(base: BaseMap, elsewhere: boolean, failing: readonly Failing[]): Note[] {
  const settings = { archive: "ARCHIVE", terrain: "TERRAIN", imagery: base.imagery?.kind === "wmts" ? "WMTS" : "IMAGERY" };
  return [
    ...base.missing.map((each) => ({ key: `missing ${each.what}`, text: missingTexts("missing", { what: each.what, why: whyMissing(each) }), setting: each.setting })),
    ...(elsewhere ? [{ key: "elsewhere", text: missingTexts("elsewhere"), setting: `${SETTING}ARCHIVE` }] : []),
    ...failing.map(({ what, why }) => ({
      key: `failing ${what}`,
      text: missingTexts(why, { what }),
      ...(what !== "base" && why === "damaged" && { setting: `${SETTING}${settings[what]}` }),
    })),
  ];
}

/** Whose map this is: always in sight. What of it is missing, with where that is set, folds into the same line. */
export function Credits({ base, elsewhere, failing }: { base: BaseMap; elsewhere: boolean; failing: readonly Failing[] }): ReactElement | null {
  const demo = useLive(TOPICS, (store) => store.status?.server.demo === true);
  const [open, setOpen] = useState(false);
  const missing = notes(base, elsewhere, failing);
  const pieces = [base.archive, base.terrain, base.imagery].flatMap((each) => each?.attribution ?? []);
  if (pieces.length === 0 && missing.length === 0) return null;
  return (
    <div className="map-credits" data-testid="credits">
      {missing.length > 0 && open && (
        <ul className="float map-missing" id="map-missing">
          {missing.map(({ key, text, setting }) => (
            <li key={key}>
              {text} {setting !== undefined && <>{missingTexts("setBy")} <code>{setting}</code>.</>}
            </li>
          ))}
        </ul>
      )}
      <p>
        {missing.length > 0 && (
          <>
            <span role="status">{missingTexts("count", { count: missing.length })}</span>
            <button type="button" className="link" aria-expanded={open} aria-controls={open ? "map-missing" : undefined} onClick={() => setOpen(!open)}>
              {missingTexts(open ? "hide" : "show")}
            </button>
          </>
        )}
        {pieces.map(({ text, href }, i) =>
          href === "" ? (
            <span key={i}>{text}</span>
          ) : (
            <a key={i} href={href} target="_blank" rel="noreferrer">
              {text}
            </a>
          ),
        )}
        {demo && pieces.length > 0 && <span>{t("fictional")}</span>}
      </p>
    </div>
  );
}
