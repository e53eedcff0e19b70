import type { ReactElement } from "react";
import type { ZoneType } from "./calls";
import { zoneTexts as t } from "./texts";

/** Each type has a colour and a line of its own, so that colour is not needed to tell them apart. */
export const LOOKS: Readonly<Record<ZoneType, { colour: string; dash: readonly number[]; width: number; hatched: boolean }>> = {
  PROHIBITED: { colour: "bad", dash: [1], width: 2.4, hatched: true },
  REQ_AUTHORIZATION: { colour: "maybe", dash: [6, 2], width: 1.8, hatched: false },
  USPACE: { colour: "accent", dash: [8, 2, 2, 2], width: 1.8, hatched: false },
  CONDITIONAL: { colour: "maybe", dash: [2, 2], width: 1.6, hatched: false },
  NO_RESTRICTION: { colour: "none", dash: [1, 4], width: 1.6, hatched: false },
};
/** The most restrictive first. */
export const TYPES = ["PROHIBITED", "REQ_AUTHORIZATION", "USPACE", "CONDITIONAL", "NO_RESTRICTION"] as const satisfies readonly ZoneType[];

/** How a type looks on the map; thinner while it is not in force. */
export function Swatch({ type, active = true }: { type: ZoneType; active?: boolean }): ReactElement {
  const { colour, dash, width, hatched } = LOOKS[type];
  return (
    <svg className="swatch" width="22" height="16" viewBox="0 0 22 16" aria-hidden="true">
      <rect
        x="2"
        y="2"
        width="18"
        height="12"
        fill={active ? `var(--${colour})` : "none"}
        fillOpacity="0.14"
        stroke={`var(--${colour})`}
        strokeWidth={active ? width : 1}
        strokeDasharray={dash.length === 1 ? undefined : dash.map((part) => part * 0.9).join(" ")}
      />
      {hatched && active && <path d="M2 9l7-7M5 14L17 2M12 14l8-8" stroke={`var(--${colour})`} strokeWidth="1" />}
    </svg>
  );
}

export function TypeTag({ type, active = true }: { type: ZoneType; active?: boolean }): ReactElement {
  return (
    <span className="zone-type">
      <Swatch type={type} active={active} />
      {t("type", { type })}
    </span>
  );
}
