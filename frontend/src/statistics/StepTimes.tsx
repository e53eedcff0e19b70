import type { ReactElement } from "react";
import { stepTexts } from "../sessions/texts";
import type { Statistics } from "../shared/api/records";
import { count, duration } from "../shared/format";
import { Scroll } from "../shared/ui/Scroll";
import { binLabel } from "./spans";
import { statisticsTexts as t } from "./texts";

type StepTime = Statistics["steps"][number];

const WIDTH = 220;
const HEIGHT = 34;

/** Weighted by the proofs of each bin: what a typical proof of the span took. */
function overall(times: readonly StepTime[], field: "p50_ms" | "p95_ms"): number {
  const sorted = [...times].sort((a, b) => a[field] - b[field]);
  const total = sorted.reduce((sum, each) => sum + each.count, 0);
  let seen = 0;
  for (const each of sorted) {
    seen += each.count;
    if (seen >= total / 2) return each[field];
  }
  return 0;
}

function Sparkline({ times, bin_ms, label }: { times: readonly StepTime[]; bin_ms: number; label: string }): ReactElement {
  const first = times[0]?.start_ms ?? 0;
  const last = times.at(-1)?.start_ms ?? first;
  const most = Math.max(1, ...times.map(({ p95_ms }) => p95_ms));
  const x = (start_ms: number): number => 4 + ((start_ms - first) / Math.max(bin_ms, last - first)) * (WIDTH - 8);
  const y = (value: number): number => HEIGHT - 4 - (value / most) * (HEIGHT - 8);
  const path = (field: "p50_ms" | "p95_ms"): string =>
    times.map((each, i) => `${i === 0 ? "M" : "L"}${x(each.start_ms).toFixed(1)} ${y(each[field]).toFixed(1)}`).join("");
  return (
    <svg className="sparkline" viewBox={`0 0 ${WIDTH} ${HEIGHT}`} role="img" aria-label={label}>
      <path d={path("p95_ms")} stroke="var(--ink3)" strokeDasharray="2 2" fill="none" />
      <path d={path("p50_ms")} stroke="var(--accent)" strokeWidth="1.6" fill="none" />
      {times.map((each) => (
        <circle key={each.start_ms} cx={x(each.start_ms)} cy={y(each.p50_ms)} r="2" fill="var(--accent)">
          <title>{`${binLabel(each.start_ms, bin_ms)}: ${duration(each.p50_ms)} · ${t("p95")} ${duration(each.p95_ms)}`}</title>
        </circle>
      ))}
    </svg>
  );
}

/** Each step's time, and how it changed. */
export function StepTimes({ times, bin_ms }: { times: readonly StepTime[]; bin_ms: number }): ReactElement {
  const steps = [...new Set(times.map(({ step }) => step))];
  return (
    <Scroll label={t("steps")}>
      <table className="table num">
        <thead>
          <tr>
            <th scope="col">{t("step")}</th>
            <th scope="col" className="right">
              {t("median")}
            </th>
            <th scope="col" className="right">
              {t("p95")}
            </th>
            <th scope="col" className="right">
              {t("count")}
            </th>
            <th scope="col">{t("p50OverTime")}</th>
          </tr>
        </thead>
        <tbody>
          {steps.map((step) => {
            const own = times.filter((each) => each.step === step);
            const name = stepTexts("name", { step });
            return (
              <tr key={step}>
                <th scope="row">{name}</th>
                <td className="right">{duration(overall(own, "p50_ms"))}</td>
                <td className="right">{duration(overall(own, "p95_ms"))}</td>
                <td className="right">{count(own.reduce((sum, each) => sum + each.count, 0))}</td>
                <td>
                  <Sparkline times={own} bin_ms={bin_ms} label={`${name}: ${t("p50OverTime")}`} />
                </td>
              </tr>
            );
          })}
        </tbody>
      </table>
    </Scroll>
  );
}
