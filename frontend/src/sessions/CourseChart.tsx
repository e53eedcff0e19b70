import type { ReactElement } from "react";
import type { Course } from "../shared/api/records";
import { AsTable } from "../shared/charts/AsTable";
import { Fitted } from "../shared/charts/Fitted";
import { count, decimal, length } from "../shared/format";
import { heightOf, roundsForAxis } from "./course";
import { courseTexts as t } from "./courseTexts";
import { lookTexts, sharedTexts } from "../shared/texts";
import { useCourse } from "./useCourse";

const HEIGHT = 190;
const LEFT = 44;
const RIGHT = 96;
const BOTTOM = 24;
const TOP = 10;

type Claim = "signed" | "broadcast";

function share(ppm: number): string {
  return decimal(ppm / 1e6, 6).replace(/(?<=[.,]\d*?)0+$/, "").replace(/[.,]$/, "");
}

function Line({ course, claim, x, y }: { course: Course; claim: Claim; x: (rounds: number) => number; y: (ppm: number) => number }): ReactElement | null {
  const places = course.points.flatMap((point) => {
    const found = point[claim];
    return found ? [{ rounds: point.rounds, outcome: point.outcome, ...found }] : [];
  });
  if (places.length === 0) return null;
  const path = places.map(({ rounds, likelihood_ppm }, i) => `${i === 0 ? "M" : "L"}${x(rounds).toFixed(1)} ${y(likelihood_ppm).toFixed(1)}`).join("");
  return (
    <g>
      <path d={path} fill="none" stroke={`var(--${claim === "signed" ? "accent" : "ink2"})`} strokeWidth="1.6" strokeDasharray={claim === "signed" ? undefined : "4 3"} />
      {places.map(({ rounds, likelihood_ppm, error_mm }, i) => (
        <circle key={rounds} cx={x(rounds)} cy={y(likelihood_ppm)} r={i === places.length - 1 ? 4.5 : 2.4} fill={`var(--${claim === "signed" ? "accent" : "ink2"})`}>
          <title>{`${t(claim)}: ${count(rounds)} · ${share(likelihood_ppm)} · ${length(error_mm)}`}</title>
        </circle>
      ))}
    </g>
  );
}

function Plot({ course, width }: { course: Course; width: number }): ReactElement {
  const last = course.points.at(-1);
  const most = Math.max(2, last?.rounds ?? 2);
  const x = (rounds: number): number => LEFT + ((width - LEFT - RIGHT) * (rounds - 1)) / (most - 1);
  const y = (ppm: number): number => TOP + (HEIGHT - BOTTOM - TOP) * (1 - heightOf(ppm));
  const summary = t("summary", {
    rounds: count(last?.rounds ?? 0),
    likelihood: last?.signed ? share(last.signed.likelihood_ppm) : t("none"),
    verify: share(course.verify_ppm),
    refute: share(course.refute_ppm),
  });
  const limits = [
    { ppm: course.verify_ppm, tone: "ok", word: t("verifies") },
    { ppm: course.refute_ppm, tone: "bad", word: t("refutes") },
  ] as const;
  return (
    <svg className="chart num" viewBox={`0 0 ${width} ${HEIGHT}`} role="img" aria-label={summary}>
      <path d={`M${LEFT} ${y(500_000)}H${width - RIGHT}`} stroke="var(--line)" />
      <text x={LEFT - 6} y={y(500_000) + 4} textAnchor="end">
        {share(500_000)}
      </text>
      {limits.map(({ ppm, tone, word }) => (
        <g key={tone}>
          <path d={`M${LEFT} ${y(ppm)}H${width - RIGHT}`} stroke={`var(--${tone})`} strokeDasharray="6 4" />
          <text x={LEFT - 6} y={y(ppm) + 4} textAnchor="end">
            {share(ppm)}
          </text>
          <text x={width - RIGHT + 8} y={y(ppm) + 4} style={{ fill: `var(--${tone})` }}>
            {word}
          </text>
        </g>
      ))}
      {roundsForAxis(course.points).map((rounds) => (
        <text key={rounds} x={x(rounds)} y={HEIGHT - 6} textAnchor="middle">
          {count(rounds)}
        </text>
      ))}
      <Line course={course} claim="broadcast" x={x} y={y} />
      <Line course={course} claim="signed" x={x} y={y} />
    </svg>
  );
}

/** How the likelihood of each claim went with the rounds, against both thresholds, on a scale of log-odds. */
export function CourseChart({ session_id }: { session_id: string }): ReactElement {
  const query = useCourse(session_id);
  const course = query.data;
  if (course === undefined || course.points.length < 2) {
    return (
      <section className="float card">
        <h2>{t("title")}</h2>
        <p className="quiet" role={query.isError ? "alert" : "status"}>
          {query.isError ? query.error.message : course === undefined ? sharedTexts("fetching") : t(course.points.length === 0 ? "noRound" : "oneRound")}
        </p>
      </section>
    );
  }
  return (
    <section className="float card">
      <h2>{t("title")}</h2>
      <p className="quiet">{t("is")}</p>
      <p className="course-key quiet">
        {(["signed", "broadcast"] as const)
          .filter((claim) => course.points.some((point) => point[claim]))
          .map((claim) => (
            <span key={claim}>
              <svg width="26" height="8" aria-hidden="true">
                <path d="M1 4H25" fill="none" stroke={`var(--${claim === "signed" ? "accent" : "ink2"})`} strokeWidth="1.6" strokeDasharray={claim === "signed" ? undefined : "4 3"} />
              </svg>
              {t(claim)}
            </span>
          ))}
      </p>
      <Fitted>{(width) => <Plot course={course} width={width} />}</Fitted>
      <AsTable
        head={[t("rounds"), t("outcome"), t("signed"), t("signedError"), t("broadcast")]}
        rows={course.points.map(({ rounds, outcome, signed, broadcast }) => ({
          key: String(rounds),
          cells: [
            count(rounds),
            lookTexts(outcome),
            signed ? share(signed.likelihood_ppm) : t("none"),
            signed ? length(signed.error_mm) : t("none"),
            broadcast ? share(broadcast.likelihood_ppm) : t("none"),
          ],
        }))}
      />
    </section>
  );
}
