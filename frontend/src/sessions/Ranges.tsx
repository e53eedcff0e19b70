import type { ReactElement } from "react";
import type { Evidence } from "../shared/api/records";
import { count, duration, length } from "../shared/format";
import { sessionTexts as t } from "./texts";

const WIDTH = 640;
const HEIGHT = 64;

type Row = { anchor_id: string; values: { t_ms: number; range_mm: number; blocked: boolean }[]; heard: number };

/** Every range of the evidence, an anchor a row: around its own median, on one scale for all. */
export function Ranges({ evidence }: { evidence: Evidence }): ReactElement | null {
  const { t_ms, anchors } = evidence.ranges;
  const [start = 0] = t_ms;
  const end = t_ms.at(-1) ?? start;
  if (t_ms.length === 0) return null;
  const rows: Row[] = anchors.map(({ anchor_id, range_mm, nlos }) => {
    const blocked = new Set(nlos);
    const values = range_mm.flatMap((range, i) => (range < 0 ? [] : [{ t_ms: t_ms[i] ?? start, range_mm: range, blocked: blocked.has(i) }]));
    return { anchor_id, values, heard: values.length };
  });
  const spread = Math.max(100, ...rows.map(({ values }) => (percentile(values, 0.98) - percentile(values, 0.02)) / 2));
  const x = (at: number): number => 6 + ((at - start) / Math.max(1, end - start)) * (WIDTH - 12);
  return (
    <section className="float card">
      <h2>{t("ranges")}</h2>
      <p className="quiet num">
        {t("rangesAre", { rounds: count(t_ms.length), duration: duration(end - start), spread: length(spread * 1.2) })}
      </p>
      <ul className="ranges num">
        {rows.map(({ anchor_id, values, heard }) => {
          const middle = percentile(values, 0.5);
          const y = (range: number): number =>
            Math.min(HEIGHT - 3, Math.max(3, HEIGHT / 2 - ((range - middle) / (spread * 1.2)) * (HEIGHT / 2)));
          return (
            <li key={anchor_id}>
              <span>
                <b>{anchor_id}</b>
                <br />
                {values.length === 0 ? t("nothing") : length(middle)}
                <br />
                <small className="quiet">
                  {t("heardOf", { heard: count(heard), rounds: count(t_ms.length) })}
                </small>
              </span>
              <svg viewBox={`0 0 ${WIDTH} ${HEIGHT}`} preserveAspectRatio="none" role="img" aria-label={t("anchorMedian", { anchor: anchor_id, median: length(middle), heard, rounds: t_ms.length })}>
                <path d={`M0 ${HEIGHT / 2}H${WIDTH}`} stroke="var(--line)" vectorEffect="non-scaling-stroke" />
                {values.map((value) => (
                  <ellipse key={value.t_ms} cx={x(value.t_ms)} cy={y(value.range_mm)} rx="2" ry="2.2" fill={`var(--${value.blocked ? "maybe" : "accent"})`} opacity="0.8" />
                ))}
              </svg>
            </li>
          );
        })}
      </ul>
    </section>
  );
}

function percentile(values: readonly { range_mm: number }[], share: number): number {
  const sorted = values.map(({ range_mm }) => range_mm).sort((a, b) => a - b);
  return sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))] ?? 0;
}
