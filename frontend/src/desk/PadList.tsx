import type { ReactElement } from "react";
import type { Pad } from "../shared/api/records";
import { deskTexts as t } from "./texts";
import type { PadState, PadTone } from "../map/padState";

/** By shape as well as by colour. */
const MARKS: Record<PadTone, string> = {
  ok: "M6 10.3l2.7 2.7L14 7.4",
  maybe: "M10 5.5v5.5M10 14v.2",
  bad: "M6.5 6.5l7 7M13.5 6.5l-7 7",
};

function PadMark({ tone }: { tone: PadTone }): ReactElement {
  return (
    <svg className="symbol" width="20" height="20" viewBox="0 0 20 20" aria-hidden="true">
      <rect x="1.5" y="1.5" width="17" height="17" rx="4" fill="none" stroke={`var(--${tone})`} strokeWidth="1.8" />
      <path d={MARKS[tone]} fill="none" stroke={`var(--${tone})`} strokeWidth="2" strokeLinecap="round" strokeLinejoin="round" />
    </svg>
  );
}

/** How each pad does, those first that need a look; pressing one shows it on the map. */
export function PadList({ pads, onPad }: { pads: readonly { pad: Pad; state: PadState }[]; onPad: (pad_id: string) => void }): ReactElement {
  return (
    <ul className="rows pad-rows" aria-label={t("padsHead")}>
      {pads.map(({ pad, state }) => (
        <li key={pad.pad_id}>
          <button type="button" className="row" title={t("showPad", { name: pad.name })} onClick={() => onPad(pad.pad_id)}>
            <PadMark tone={state.tone} />
            <b>{pad.name}</b>
            <span className="row-right" />
            <small className={`row-second${state.tone === "ok" ? "" : ` tone-${state.tone}`}`}>{state.text}</small>
          </button>
        </li>
      ))}
    </ul>
  );
}
