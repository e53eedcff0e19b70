import { useState, type ReactElement } from "react";
import type { VerdictSummary } from "../shared/api/records";
import { count, timeOfDay } from "../shared/format";
import { useLive } from "../shared/live/useLive";
import type { Topic } from "../shared/live/store";
import { liveTexts as t } from "./texts";
import { BINS, bins, type Bin } from "./timelineBins";

const TOPICS: readonly Topic[] = ["verdicts"];
const HEIGHT = 48;
const BASE = 44;

function words(bin: Bin): string {
  const parts = (["refuted", "inconclusive", "verified"] as const)
    .filter((outcome) => bin[outcome] > 0)
    .map((outcome) => t("binCount", { outcome, count: count(bin[outcome]) }));
  return parts.length === 0 ? t("noVerdict") : parts.join(", ");
}

/** Each bar of a bin, from the bottom: verified, then what was not, marked by height and gap as well as colour. */
function bars(bin: Bin, unit: number): { y: number; height: number; tone: string }[] {
  const result: { y: number; height: number; tone: string }[] = [];
  let y = BASE;
  for (const [n, tone] of [
    [bin.verified, "ok"],
    [bin.inconclusive, "maybe"],
    [bin.refuted, "bad"],
  ] as const) {
    if (n === 0) continue;
    const height = Math.max(4, n * unit);
    y -= height;
    result.push({ y, height, tone });
    y -= 1.5;
  }
  return result;
}

type Properties = { now_ms: number; onSelect: (verdict: VerdictSummary) => void };

/** The last hour's verdicts as a strip: press a bar for its gravest one. The Verdicts page has them as a table. */
export function Timeline({ now_ms, onSelect }: Properties): ReactElement {
  const all = useLive(TOPICS, (store) => bins(store.verdictsByTime(), now_ms));
  const [hovered, setHovered] = useState<number | undefined>();
  const most = Math.max(3, ...all.map((bin) => bin.verified + bin.inconclusive + bin.refuted));
  const unit = (BASE - 6) / most;
  const sum = (outcome: "verified" | "inconclusive" | "refuted"): number =>
    all.reduce((total, bin) => total + bin[outcome], 0);
  const [verified, inconclusive, refuted] = [sum("verified"), sum("inconclusive"), sum("refuted")];
  const total = verified + inconclusive + refuted;
  const told = hovered === undefined ? undefined : all[hovered];
  const summary = t("hourSummary", {
    total: count(total),
    verified: count(verified),
    inconclusive: count(inconclusive),
    refuted: count(refuted),
  });
  return (
    <>
      <div className="strip">
        <svg viewBox={`0 0 ${BINS * 8} ${HEIGHT}`} preserveAspectRatio="none" role="img" aria-label={summary}>
          <path d={`M0 ${BASE + 0.5}H${BINS * 8}`} stroke="var(--line)" vectorEffect="non-scaling-stroke" />
          {all.map((bin, i) =>
            bars(bin, unit).map(({ y, height, tone }) => (
              <rect
                key={`${bin.start_ms}${tone}`}
                x={i * 8 + 1}
                y={y}
                width={6}
                height={height}
                rx={1.2}
                fill={`var(--${tone})`}
                opacity={tone === "ok" && hovered !== i ? 0.75 : 1}
              />
            )),
          )}
        </svg>
        <div className="strip-bins">
          {all.map((bin, i) => (
            <button
              key={bin.start_ms}
              type="button"
              tabIndex={-1}
              disabled={bin.gravest === undefined}
              aria-label={`${timeOfDay(bin.start_ms)}: ${words(bin)}`}
              onPointerEnter={() => setHovered(i)}
              onPointerLeave={() => setHovered(undefined)}
              onClick={() => bin.gravest !== undefined && onSelect(bin.gravest)}
            />
          ))}
        </div>
      </div>
      <p className="strip-text num" aria-hidden="true">
        <b>{told === undefined ? timeOfDay(now_ms) : timeOfDay(told.start_ms)}</b>
        <br />
        {told === undefined ? t("hourTotal", { total: count(total) }) : words(told)}
      </p>
    </>
  );
}
