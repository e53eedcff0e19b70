import type { ReactElement } from "react";
import { stepTexts } from "../sessions/texts";
import type { Statistics } from "../shared/api/records";
import { count, duration } from "../shared/format";
import { Scroll } from "../shared/ui/Scroll";
import { binLabel } from "./spans";
import { statisticsTexts as t } from "./texts";

type StepTime = Statistics["steps"][number];
type StepTotal = Statistics["step_totals"][number];

const WIDTH = 220;
const HEIGHT = 34;

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
export function StepTimes({ totals, times, bin_ms }: { totals: readonly StepTotal[]; times: readonly StepTime[]; bin_ms: number }): ReactElement {
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
          {totals.map(({ step, p50_ms, p95_ms, count: proofs }) => {
            const name = stepTexts("name", { step });
            return (
              <tr key={step}>
                <th scope="row">{name}</th>
                <td className="right">{duration(p50_ms)}</td>
                <td className="right">{duration(p95_ms)}</td>
                <td className="right">{count(proofs)}</td>
                <td>
                  <Sparkline times={times.filter((each) => each.step === step)} bin_ms={bin_ms} label={`${name}: ${t("p50OverTime")}`} />
                </td>
              </tr>
            );
          })}
        </tbody>
      </table>
    </Scroll>
  );
}
