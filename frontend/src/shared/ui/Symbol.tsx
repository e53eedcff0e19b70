import type { ReactElement } from "react";
import type { Look } from "../drones";
import { SYMBOLS, type Part } from "../design/symbols";
import { lookTexts } from "../texts";

export function Parts({ parts }: { parts: readonly Part[] }): ReactElement[] {
  return parts.map((part) => (
    <path
      key={part.d}
      d={part.d}
      fill={part.fill === undefined ? "none" : `var(--${part.fill})`}
      stroke={part.stroke === undefined ? "none" : `var(--${part.stroke})`}
      strokeWidth={part.width}
      strokeDasharray={part.dash?.join(" ")}
      strokeLinecap="round"
      strokeLinejoin="round"
      className={part.turning === true ? "arc" : undefined}
    />
  ));
}

/** The symbol of a state. Named for screen readers unless the words stand beside it. */
export function Symbol({ look, size = 20, named = false }: { look: Look; size?: number; named?: boolean }): ReactElement {
  return (
    <svg
      className="symbol"
      width={size}
      height={size}
      viewBox="0 0 20 20"
      {...(named ? { role: "img", "aria-label": lookTexts(look) } : { "aria-hidden": true })}
    >
      <Parts parts={SYMBOLS[look]} />
    </svg>
  );
}
