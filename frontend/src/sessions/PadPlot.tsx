import type { ReactElement } from "react";
import type { Covariance, Pad } from "../shared/api/records";
import { claimRing, measuredDiamond, type Tone } from "../shared/design/symbols";
import { length } from "../shared/format";
import { ellipse } from "../shared/geo/ellipse";
import type { Local } from "../shared/geo/frame";
import { Parts } from "../shared/ui/Symbol";
import { sessionTexts as t } from "./texts";
import { directionWord } from "./words";

/** `radius_mm`: the buffer of a signed claim, or how far a broadcast can mean. */
export type PlotClaim = { at: Local; tone: Tone; words: string; radius_mm: number };
export type PlotEstimate = { at: Local; covariance: Covariance | undefined; tone: Tone; verified: boolean };

type Properties = {
  pad: Pad;
  claims: readonly PlotClaim[];
  estimate: PlotEstimate | undefined;
  /** Where a reference has the drone, by the pad's word. */
  truth?: Local | undefined;
};

const WIDTH = 404;
const HEIGHT = 206;
const MARGIN = 30;
/** What lies further off than this is named beside the plot: drawn, it would leave no room for the rest. */
const FAR_MM = 150_000;
const STEPS_MM = [200, 500, 1_000, 2_000, 5_000, 10_000, 20_000, 50_000, 100_000] as const;

const SHARED_PX = 26;

type Label = { x: number; y: number; text: string };

/** Where a label stands without leaving the plot or lying over the one before. */
function place(x: number, y: number, text: string, below: boolean, taken: Label[]): Label {
  const half = text.length * 3;
  const label = {
    x: Math.min(WIDTH - half - 8, Math.max(half + 8, x)),
    y: Math.min(HEIGHT - 24, Math.max(14, y + (below ? 22 : -16))),
    text,
  };
  for (const other of taken) {
    if (Math.abs(other.y - label.y) < 13 && Math.abs(other.x - label.x) < half + other.text.length * 3) {
      label.y = Math.min(HEIGHT - 24, other.y + 14);
    }
  }
  taken.push(label);
  return label;
}

/** The pad's square metres: anchors, ranges, the claim with its buffer, the measurement with its ellipse. */
export function PadPlot({ pad, claims, estimate, truth }: Properties): ReactElement | null {
  const anchors = pad.commissioning?.anchors ?? [];
  const reference: Local = estimate?.at ?? { east_mm: 0, north_mm: 0 };
  const isFar = ({ at }: PlotClaim): boolean =>
    Math.hypot(at.east_mm - reference.east_mm, at.north_mm - reference.north_mm) > FAR_MM;
  const near = claims.filter((claim) => !isFar(claim));
  const far = claims.filter(isFar);
  // One that lies far off is told by its distance alone: drawn, it would leave no room for the rest.
  const cross = truth !== undefined && Math.hypot(truth.east_mm - reference.east_mm, truth.north_mm - reference.north_mm) <= FAR_MM ? truth : undefined;
  const radius = estimate?.covariance === undefined ? 0 : ellipse(estimate.covariance).major_mm;
  const extents: { at: Local; reach: number }[] = [
    ...anchors.map((at) => ({ at, reach: 300 })),
    ...near.map(({ at, radius_mm }) => ({ at, reach: radius_mm })),
    ...(estimate === undefined ? [] : [{ at: estimate.at, reach: Math.min(radius, 20_000) }]),
    ...(cross === undefined ? [] : [{ at: cross, reach: 300 }]),
  ];
  if (claims.length === 0 && estimate === undefined) return null;
  const west = Math.min(...extents.map(({ at, reach }) => at.east_mm - reach));
  const east = Math.max(...extents.map(({ at, reach }) => at.east_mm + reach));
  const south = Math.min(...extents.map(({ at, reach }) => at.north_mm - reach));
  const north = Math.max(...extents.map(({ at, reach }) => at.north_mm + reach));
  const scale = Math.min((WIDTH - 2 * MARGIN) / (east - west), (HEIGHT - 2 * MARGIN) / (north - south));
  const x = (local: Local): number => WIDTH / 2 + (local.east_mm - (east + west) / 2) * scale;
  const y = (local: Local): number => HEIGHT / 2 - (local.north_mm - (north + south) / 2) * scale;
  const step = STEPS_MM.find((each) => each * scale >= 34) ?? 200_000;
  const lines = (from: number, to: number): number[] => {
    const first = Math.ceil(from / step);
    return Array.from({ length: Math.max(0, Math.floor(to / step) - first + 1) }, (_, i) => (first + i) * step);
  };
  const halfWidth = WIDTH / 2 / scale;
  const halfHeight = HEIGHT / 2 / scale;
  const shape = estimate?.covariance === undefined ? undefined : ellipse(estimate.covariance);
  const taken: Label[] = [];
  const labels: Label[] = [];
  const highest = near.reduce((best, { at }) => Math.max(best, at.north_mm), -Infinity);
  // A claim that lies where the measurement is shares its label.
  const shared = near.find(
    ({ at }) => estimate !== undefined && Math.hypot(x(at) - x(estimate.at), y(at) - y(estimate.at)) < SHARED_PX,
  );
  for (const claim of near) {
    if (claim === shared) continue;
    const below = estimate !== undefined && estimate.at.north_mm > highest;
    labels.push(place(x(claim.at), y(claim.at) + (below ? 1 : -1) * (claim.radius_mm * scale - 4), claim.words, below, taken));
  }
  if (estimate !== undefined) {
    // Away from the other claims; with none, away from the pad and the lines that lead there.
    const below = shared === undefined || near.length > 1 ? estimate.at.north_mm <= highest : estimate.at.north_mm < 0;
    const measured = t(estimate.verified ? "measured" : "measuring");
    const words = shared === undefined ? measured : `${shared.words} · ${measured}`;
    const clear = shared === undefined ? 0 : Math.max(0, shared.radius_mm * scale - 6);
    labels.push(place(x(estimate.at), y(estimate.at) + (below ? clear : -clear), words, below, taken));
  }
  return (
    <figure className="plot">
      <svg viewBox={`0 0 ${WIDTH} ${HEIGHT}`} role="img" aria-label={alternative(claims, estimate)}>
        <g stroke="var(--line)" strokeWidth="1">
          {lines((east + west) / 2 - halfWidth, (east + west) / 2 + halfWidth).map((e) => (
            <path key={`e${e}`} d={`M${x({ east_mm: e, north_mm: 0 })} 0V${HEIGHT}`} />
          ))}
          {lines((north + south) / 2 - halfHeight, (north + south) / 2 + halfHeight).map((n) => (
            <path key={`n${n}`} d={`M0 ${y({ east_mm: 0, north_mm: n })}H${WIDTH}`} />
          ))}
        </g>
        {estimate !== undefined && (
          <g stroke="var(--ink3)" strokeOpacity="0.5">
            {anchors.map((anchor) => (
              <path key={anchor.anchor_id} d={`M${x(anchor)} ${y(anchor)}L${x(estimate.at)} ${y(estimate.at)}`} />
            ))}
          </g>
        )}
        <g fill="var(--ink)">
          {anchors.map((anchor) => (
            <circle key={anchor.anchor_id} cx={x(anchor)} cy={y(anchor)} r="3">
              <title>{t("anchor", { anchor: anchor.anchor_id })}</title>
            </circle>
          ))}
        </g>
        {near.map((claim) => (
          <g key={claim.words} stroke={`var(--${claim.tone})`}>
            <circle cx={x(claim.at)} cy={y(claim.at)} r={claim.radius_mm * scale} fill="none" strokeDasharray="5 4" />
            {estimate !== undefined && (
              <path d={`M${x(claim.at)} ${y(claim.at)}L${x(estimate.at)} ${y(estimate.at)}`} strokeWidth="1.8" />
            )}
          </g>
        ))}
        {estimate !== undefined && shape !== undefined && (
          <ellipse
            rx={shape.major_mm * scale}
            ry={shape.minor_mm * scale}
            transform={`translate(${x(estimate.at)} ${y(estimate.at)}) rotate(${(-shape.angle_rad * 180) / Math.PI})`}
            fill={`var(--${estimate.tone})`}
            fillOpacity="0.18"
            stroke={`var(--${estimate.tone})`}
            strokeDasharray={estimate.verified ? undefined : "3 2"}
          />
        )}
        {near.map((claim) => (
          <g key={claim.words} transform={`translate(${x(claim.at) - 6} ${y(claim.at) - 6}) scale(0.6)`}>
            <Parts parts={claimRing(claim.tone)} />
          </g>
        ))}
        {estimate !== undefined && (
          <g transform={`translate(${x(estimate.at) - 6} ${y(estimate.at) - 6}) scale(0.6)`}>
            <Parts parts={measuredDiamond(estimate.tone, estimate.verified)} />
          </g>
        )}
        {cross !== undefined && (
          <path d={`M${x(cross) - 5} ${y(cross) - 5}l10 10m0 -10l-10 10`} stroke="var(--ink)" strokeWidth="1.6" data-testid="truth">
            <title>{t("truth")}</title>
          </path>
        )}
        <g className="plot-labels" textAnchor="middle">
          {labels.map((label) => (
            <text key={label.text} x={label.x} y={label.y}>
              {label.text}
            </text>
          ))}
        </g>
      </svg>
      <figcaption className="num">
        {t("padFrame", { grid: length(step, true) })}
        {truth !== undefined && estimate !== undefined && (
          <span>
            {" "}
            · {t("truthError", { error: length(Math.hypot(truth.east_mm - estimate.at.east_mm, truth.north_mm - estimate.at.north_mm)) })}
          </span>
        )}
        {far.map((claim) => (
          <span key={claim.words}>
            {" "}
            ·{" "}
            {t("offPlot", {
              what: claim.words,
              distance: length(Math.hypot(claim.at.east_mm, claim.at.north_mm), true),
              direction: directionWord(claim.at),
            })}
          </span>
        ))}
      </figcaption>
    </figure>
  );
}

function alternative(claims: readonly PlotClaim[], estimate: PlotEstimate | undefined): string {
  const side = (east_mm: number, north_mm: number): string =>
    `${length(Math.abs(east_mm + north_mm), true)} ${directionWord({ east_mm, north_mm })}`;
  const say = (what: string, at: Local): string =>
    t("plotPart", { what, north: side(0, at.north_mm), east: side(at.east_mm, 0) });
  const parts = claims.map((claim) => say(claim.words, claim.at));
  if (estimate !== undefined) parts.push(say(t(estimate.verified ? "plotMeasured" : "plotMeasuring"), estimate.at));
  return t("plotOf", { parts: parts.join("; ") });
}
