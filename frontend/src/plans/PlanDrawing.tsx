import { useId, type ReactElement } from "react";
import type { Pad } from "../shared/api/records";
import { length } from "../shared/format";
import { reachOf, type Metres, type Plan, type PlanFeature, type PlanKind } from "./plan";
import { planTexts as t } from "./texts";
import { LINE, planWords } from "./words";
import "./plans.css";

const SIZE = 420;
const MARGIN = 18;
const STEPS_M = [1, 2, 5, 10, 20, 50, 100, 200, 500] as const;
/** From the ground up. */
const ORDER: readonly PlanKind[] = ["approach_sector", "departure_sector", "surface", "safety_area", "fato", "tlof", "marking", "fence", "charger", "obstacle"];

type Anchor = NonNullable<Pad["commissioning"]>["anchors"][number];

/** The plan from above, north up, with the pad's anchors, a scale, and what stands there by name and height. */
export function PlanDrawing({ plan, anchors = [] }: { plan: Plan; anchors?: readonly Anchor[] }): ReactElement {
  const clip = useId();
  const reach_m = reachOf(plan) * 1.08;
  const scale = (SIZE / 2 - MARGIN) / reach_m;
  const x = (east_m: number): number => SIZE / 2 + east_m * scale;
  const y = (north_m: number): number => SIZE / 2 - north_m * scale;
  const path = (points: readonly Metres[], close: boolean): string => points.map(([east, north], i) => `${i === 0 ? "M" : "L"}${x(east).toFixed(1)} ${y(north).toFixed(1)}`).join("") + (close ? "Z" : "");
  const bar_m = STEPS_M.find((each) => each * scale >= 48) ?? 1000;
  const drawn = [...plan.features].sort((a, b) => ORDER.indexOf(a.kind) - ORDER.indexOf(b.kind));
  const shape = ({ kind, shape: form, rings }: PlanFeature, i: number): ReactElement => {
    const [first = []] = rings;
    const [point] = first;
    if (form === "Point") return point === undefined || kind === "marking" ? <g key={i} /> : <rect key={i} className={`plan-${kind}`} x={x(point[0]) - 3} y={y(point[1]) - 3} width="6" height="6" />;
    return <path key={i} className={`plan-${kind}`} fillRule="evenodd" d={form === "LineString" ? path(first, false) : rings.map((ring) => path(ring, true)).join("")} />;
  };
  const { image } = plan;
  const [upperLeft, upperRight, , lowerLeft] = image?.corners ?? [];
  return (
    <svg className="site-plan" viewBox={`0 0 ${SIZE} ${SIZE}`} role="img" aria-label={t("drawing", { count: plan.features.length, reach: length(Math.round(reachOf(plan)) * 1000, true) })}>
      <clipPath id={clip}>
        <rect width={SIZE} height={SIZE} />
      </clipPath>
      <g clipPath={`url(#${clip})`}>
        {image !== undefined && upperLeft !== undefined && upperRight !== undefined && lowerLeft !== undefined && (
          // A unit square, carried to three of its corners.
          <image
            href={image.href}
            width="1"
            height="1"
            preserveAspectRatio="none"
            transform={`matrix(${x(upperRight[0]) - x(upperLeft[0])} ${y(upperRight[1]) - y(upperLeft[1])} ${x(lowerLeft[0]) - x(upperLeft[0])} ${y(lowerLeft[1]) - y(upperLeft[1])} ${x(upperLeft[0])} ${y(upperLeft[1])})`}
          />
        )}
        {drawn.map(shape)}
        {anchors.map((anchor) => (
          <rect key={anchor.anchor_id} className="plan-anchor" x={x(anchor.east_mm / 1000) - 2} y={y(anchor.north_mm / 1000) - 2} width="4" height="4">
            <title>{anchor.anchor_id}</title>
          </rect>
        ))}
        {planWords(plan.features, { size: SIZE, x, y }).map(({ text, left, top, width }) => (
          <text key={`${left} ${top}`} x={left + width / 2} y={top + LINE - 3} textAnchor="middle">
            {text}
          </text>
        ))}
      </g>
      <path className="plan-scale" d={`M${MARGIN} ${SIZE - 14}v4h${bar_m * scale}v-4`} />
      <text x={MARGIN + (bar_m * scale) / 2} y={SIZE - 16} textAnchor="middle">
        {length(bar_m * 1000, true)}
      </text>
      <path className="plan-north" d={`M${SIZE - 20} 32V12m-4 6l4-6l4 6`} />
      <text x={SIZE - 20} y={44} textAnchor="middle">
        {t("north")}
      </text>
    </svg>
  );
}

/** What of the kinds is in this drawing, and how it looks. */
export function PlanLegend({ plan }: { plan: Plan }): ReactElement {
  const kinds = ORDER.filter((kind) => plan.features.some((each) => each.kind === kind));
  return (
    <ul className="plan-legend">
      {kinds.map((kind) => (
        <li key={kind}>
          <svg width="18" height="12" aria-hidden="true">
            <path className={`plan-${kind}`} d={kind === "fence" || kind === "marking" ? "M1 6H17" : "M2 2H16V10H2Z"} />
          </svg>
          {t("kind", { kind })}
        </li>
      ))}
    </ul>
  );
}
