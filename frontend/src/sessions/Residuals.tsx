import type { ReactElement } from "react";
import type { AnchorResiduals } from "../shared/api/records";
import { AsTable } from "../shared/charts/AsTable";
import { Fitted } from "../shared/charts/Fitted";
import { count, length } from "../shared/format";
import { courseTexts as t } from "./courseTexts";
import { band_mm, mean, reach_mm } from "./residualRows";
import { useCourse } from "./useCourse";

const HEIGHT = 58;
const EDGE = 6;
const SERIES = [
  { key: "estimate_mm", name: "againstEstimate", tone: "ink2", radius: 1.8 },
  { key: "claim_mm", name: "againstClaim", tone: "accent", radius: 2.6 },
] as const;

function signed(mm: number): string {
  return (mm > 0 ? "+" : "") + length(mm);
}

function words(row: AnchorResiduals): string {
  return t("anchorResiduals", {
    anchor: row.anchor_id,
    claim: signed(mean(row.claim_mm)),
    estimate: row.estimate_mm ? signed(mean(row.estimate_mm)) : t("none"),
    band: length(band_mm(row)),
  });
}

function Plot({ row, width, reach, start_ms, end_ms }: { row: AnchorResiduals; width: number; reach: number; start_ms: number; end_ms: number }): ReactElement {
  const x = (t_ms: number): number => EDGE + ((t_ms - start_ms) / Math.max(1, end_ms - start_ms)) * (width - 2 * EDGE);
  const y = (mm: number): number => HEIGHT / 2 - Math.max(-1, Math.min(1, mm / reach)) * (HEIGHT / 2 - 3);
  const band = Math.max(band_mm(row), reach / HEIGHT);
  return (
    <svg viewBox={`0 0 ${width} ${HEIGHT}`} width={width} height={HEIGHT} role="img" aria-label={words(row)}>
      <rect x="0" width={width} y={y(band)} height={y(-band) - y(band)} className="noise-band" />
      <path d={`M0 ${HEIGHT / 2}H${width}`} stroke="var(--control)" />
      {SERIES.map(({ key, tone, radius }) =>
        (row[key] ?? []).map((mm, i) => <circle key={`${key}${i}`} cx={x(row.t_ms[i] ?? start_ms)} cy={y(mm)} r={radius} fill={`var(--${tone})`} opacity="0.85" />),
      )}
    </svg>
  );
}

/** What each range says against the claim and against the estimate: a lie lifts an anchor's dots out of the band. */
export function Residuals({ session_id }: { session_id: string }): ReactElement | null {
  const rows = useCourse(session_id).data?.residuals ?? [];
  if (rows.length === 0) return null;
  const times = rows.flatMap(({ t_ms }) => [t_ms[0] ?? 0, t_ms.at(-1) ?? 0]);
  const [start_ms, end_ms] = [Math.min(...times), Math.max(...times)];
  const reach = reach_mm(rows);
  return (
    <section className="float card" aria-labelledby="residuals">
      <h2 id="residuals">{t("residuals")}</h2>
      <p className="quiet">{t("residualsAre", { reach: length(reach, true) })}</p>
      <p className="course-key quiet">
        {SERIES.toReversed().map(({ key, name, tone, radius }) => (
          <span key={key}>
            <svg width="8" height="8" aria-hidden="true">
              <circle cx="4" cy="4" r={radius + 0.6} fill={`var(--${tone})`} />
            </svg>
            {t(name)}
          </span>
        ))}
        <span>
          <svg width="22" height="10" aria-hidden="true">
            <rect width="22" height="10" rx="2" className="noise-band" />
          </svg>
          {t("noise")}
        </span>
      </p>
      <ul className="ranges num">
        {rows.map((row) => (
          <li key={row.anchor_id}>
            <span>
              <b>{row.anchor_id}</b>
              <br />
              <span className="residual-claim">{signed(mean(row.claim_mm))}</span>
              <br />
              <small className="quiet">{row.estimate_mm ? signed(mean(row.estimate_mm)) : t("none")}</small>
            </span>
            <Fitted>{(width) => <Plot row={row} width={width} reach={reach} start_ms={start_ms} end_ms={end_ms} />}</Fitted>
          </li>
        ))}
      </ul>
      <AsTable
        head={[t("anchor"), t("rounds"), t("againstClaim"), t("againstEstimate"), t("noise")]}
        rows={rows.map((row) => ({
          key: row.anchor_id,
          cells: [
            row.anchor_id,
            count(row.claim_mm.length),
            signed(mean(row.claim_mm)),
            row.estimate_mm ? signed(mean(row.estimate_mm)) : t("none"),
            `± ${length(band_mm(row))}`,
          ],
        }))}
      />
    </section>
  );
}
