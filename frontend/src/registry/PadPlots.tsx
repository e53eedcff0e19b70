import type { ReactElement } from "react";
import { AsTable } from "../shared/charts/AsTable";
import { ticks } from "../shared/charts/scale";
import { length } from "../shared/format";
import type { RegistryPad, RegistryPadDetail } from "./calls";
import { registryTexts as t } from "./texts";

export type Commissioning = NonNullable<RegistryPad["record"]["commissioning"]>;

const SIZE = 260;
const WIDTH = 420;
const HEIGHT = 200;
const LEFT = 44;
const BOTTOM = 24;
const STEPS_MM = [500, 1_000, 2_000, 5_000, 10_000, 20_000, 50_000] as const;
/** Distinct on both themes by lightness and dash, since colour means a verdict. */
const DASHES = ["", "6 3", "2 3", "8 3 2 3"] as const;

/** The anchors from above, on a grid of metres. */
export function AnchorPlan({ commissioning }: { commissioning: Commissioning }): ReactElement {
  const { anchors } = commissioning;
  const reach = Math.max(1_000, ...anchors.flatMap(({ east_mm, north_mm }) => [Math.abs(east_mm), Math.abs(north_mm)])) * 1.35;
  const at = (mm: number): number => SIZE / 2 + (mm / reach) * (SIZE / 2 - 8);
  const step = STEPS_MM.find((each) => reach / each <= 6) ?? 100_000;
  const lines = Array.from({ length: 2 * Math.floor(reach / step) + 1 }, (_, i) => (i - Math.floor(reach / step)) * step);
  return (
    <figure className="registry-plot">
      <figcaption>{t("plan")}</figcaption>
      <svg viewBox={`0 0 ${SIZE} ${SIZE}`} role="img" aria-label={t("plan")}>
        {lines.map((mm) => (
          <path key={mm} d={`M${at(mm)} 4V${SIZE - 4}M4 ${at(mm)}H${SIZE - 4}`} stroke="var(--line)" strokeWidth={mm === 0 ? 1.6 : 0.8} />
        ))}
        {anchors.map((anchor) => (
          <g key={anchor.anchor_id}>
            <rect x={at(anchor.east_mm) - 4} y={at(-anchor.north_mm) - 4} width="8" height="8" rx="1.5" fill="var(--ink)" />
            <text x={at(anchor.east_mm)} y={at(-anchor.north_mm) - 9} textAnchor="middle">
              {anchor.anchor_id}
            </text>
            <title>{`${anchor.anchor_id}: ${length(anchor.east_mm)}, ${length(anchor.north_mm)}, ${length(anchor.up_mm)}; ${t("survey", { sigma: length(anchor.survey_sigma_mm) })}`}</title>
          </g>
        ))}
        <text x={SIZE - 8} y={SIZE - 8} textAnchor="end">
          {length(step, true)}
        </text>
      </svg>
    </figure>
  );
}

type Line = { name: string; points: readonly { x: number; y: number; sigma?: number }[] };

/** Lines over a distance, with their spread where they have one. */
function Lines({ lines, title, floor }: { lines: readonly Line[]; title: string; floor: number }): ReactElement {
  const all = lines.flatMap(({ points }) => points);
  const right = Math.max(1, ...all.map(({ x }) => x));
  const top = Math.max(floor, ...all.map(({ y, sigma = 0 }) => y + sigma));
  const bottom = Math.min(0, ...all.map(({ y, sigma = 0 }) => y - sigma));
  const x = (mm: number): number => LEFT + (mm / right) * (WIDTH - LEFT - 22);
  const y = (mm: number): number => 8 + ((top - mm) / (top - bottom)) * (HEIGHT - BOTTOM - 8);
  const path = (points: readonly { x: number; y: number }[]): string => points.map((each, i) => `${i === 0 ? "M" : "L"}${x(each.x).toFixed(1)} ${y(each.y).toFixed(1)}`).join("");
  return (
    <figure className="registry-plot">
      <figcaption>{title}</figcaption>
      <svg viewBox={`0 0 ${WIDTH} ${HEIGHT}`} role="img" aria-label={title} className="num">
        {ticks(top).filter((each) => each <= top).map((each) => (
          <g key={each}>
            <path d={`M${LEFT} ${y(each)}H${WIDTH - 8}`} stroke="var(--line)" />
            <text x={LEFT - 6} y={y(each) + 4} textAnchor="end">
              {length(each, true)}
            </text>
          </g>
        ))}
        {ticks(right).filter((each) => each <= right).map((each) => (
          <text key={each} x={x(each)} y={HEIGHT - 6} textAnchor="middle">
            {length(each, true)}
          </text>
        ))}
        {lines.map(({ name, points }, i) => (
          <g key={name}>
            {points.some(({ sigma }) => sigma !== undefined) && (
              <path
                d={`${path(points.map((each) => ({ x: each.x, y: each.y + (each.sigma ?? 0) })))}L${path([...points].reverse().map((each) => ({ x: each.x, y: each.y - (each.sigma ?? 0) }))).slice(1)}Z`}
                fill="var(--ink)"
                opacity="0.06"
              />
            )}
            <path d={path(points)} fill="none" stroke="var(--ink2)" strokeWidth="1.8" strokeDasharray={DASHES[i % DASHES.length]} />
            {points.map((each) => (
              <circle key={each.x} cx={x(each.x)} cy={y(each.y)} r="2.4" fill="var(--ink2)">
                <title>{`${name} ${length(each.x, true)}: ${length(each.y)}`}</title>
              </circle>
            ))}
          </g>
        ))}
      </svg>
    </figure>
  );
}

export function BiasPlot({ commissioning }: { commissioning: Commissioning }): ReactElement {
  const lines = commissioning.anchors.map(({ anchor_id, bias }) => ({
    name: anchor_id,
    points: bias.map((each) => ({ x: each.range_mm, y: each.bias_mm, sigma: each.sigma_mm })),
  }));
  return (
    <div>
      <Lines lines={lines} title={t("biasPlot")} floor={100} />
      <AsTable
        head={[t("anchors"), t("distance"), t("bias"), "σ"]}
        rows={commissioning.anchors.flatMap(({ anchor_id, bias }) =>
          bias.map((each) => ({ key: `${anchor_id} ${each.range_mm}`, cells: [anchor_id, length(each.range_mm, true), length(each.bias_mm), length(each.sigma_mm)] })),
        )}
      />
    </div>
  );
}

export function ReachPlot({ reach }: { reach: RegistryPadDetail["reach"] }): ReactElement | null {
  if (reach.length === 0) return null;
  return (
    <div>
      <Lines lines={[{ name: t("reach"), points: reach.map(({ distance_mm, buffer_mm }) => ({ x: distance_mm, y: buffer_mm })) }]} title={t("reachPlot")} floor={1_000} />
      <AsTable head={[t("distance"), t("reach")]} rows={reach.map((each) => ({ key: String(each.distance_mm), cells: [length(each.distance_mm, true), length(each.buffer_mm)] }))} />
    </div>
  );
}
