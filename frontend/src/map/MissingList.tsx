import type { ReactElement } from "react";
import type { Failing } from "./failures";
import { missingTexts, whyMissing } from "./missingTexts";
import type { BaseMap } from "./place";

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

/** What is missing, why, and where that is set; fetched when somebody asks. */
export default function MissingList({ base, elsewhere, failing }: { base: BaseMap; elsewhere: boolean; failing: readonly Failing[] }): ReactElement {
  return (
    <ul className="float map-missing" id="map-missing">
      {notes(base, elsewhere, failing).map(({ key, text, setting }) => (
        <li key={key}>
          {text} {setting !== undefined && <>{missingTexts("setBy")} <code>{setting}</code>.</>}
        </li>
      ))}
    </ul>
  );
}
