import type { ReactElement } from "react";
import type { SessionState, StepName } from "../shared/api/records";
import { duration, timeOfDay } from "../shared/format";
import { Scroll } from "../shared/ui/Scroll";
import { stepRows, type StepRow } from "./steps";
import { stepTexts as t } from "./texts";

const PARTIES = ["Drone", "Pad", "Ledger", "Authority"] as const;
type Party = (typeof PARTIES)[number];

/** Who says what to whom in each step. */
const ARROWS: Record<StepName, { from: Party; to: Party; both?: true }> = {
  request: { from: "Drone", to: "Ledger" },
  poll: { from: "Pad", to: "Drone" },
  match: { from: "Drone", to: "Drone" },
  reply: { from: "Drone", to: "Pad" },
  range: { from: "Pad", to: "Drone", both: true },
  confirm: { from: "Drone", to: "Pad" },
  verdict: { from: "Pad", to: "Ledger" },
  permission: { from: "Ledger", to: "Drone" },
};

const WIDTH = 680;
const TOP = 40;
const ROW = 40;
const X: Record<Party, number> = { Drone: 146, Pad: 288, Ledger: 430, Authority: 550 };

function tone(row: StepRow, session: SessionState): string {
  if (row.step === "verdict" && session.outcome === "inconclusive") return "maybe";
  return { done: "ink2", failed: "bad", refused: "bad", now: "accent", waiting: "line", never: "line" }[row.state];
}

/** The eight steps as a sequence between drone, pad and ledger, filling in while they happen. */
export function Sequence({ session }: { session: SessionState }): ReactElement {
  const rows = stepRows(session);
  const height = TOP + rows.length * ROW + 12;
  return (
    <section className="float card">
      <h2>{t("stepByStep")}</h2>
      <Scroll label={t("stepByStep")}>
        <svg className="sequence num" viewBox={`0 0 ${WIDTH} ${height}`} role="img" aria-label={t("stepByStep")}>
          {PARTIES.map((party) => (
            <g key={party}>
              <text x={X[party]} y="18" textAnchor="middle" className="party">
                {t("party", { party })}
              </text>
              <path d={`M${X[party]} 28V${height}`} stroke="var(--line)" />
            </g>
          ))}
          {rows.map((row, i) => {
            const { from, to, both } = ARROWS[row.step];
            const y = TOP + i * ROW + 22;
            const colour = `var(--${tone(row, session)})`;
            const ahead = row.state === "waiting" || row.state === "never";
            const right = X[to] > X[from];
            const tip = right ? -7 : 7;
            return (
              <g key={row.step} opacity={ahead ? 0.75 : 1} stroke={colour} fill="none" strokeWidth="1.6">
                {from === to ? (
                  <circle cx={X[from]} cy={y} r="5" fill={ahead ? "var(--panel)" : colour} />
                ) : (
                  <>
                    <path d={`M${X[from]} ${y}H${X[to]}`} strokeDasharray={ahead ? "3 4" : undefined} />
                    <path d={`M${X[to] + tip} ${y - 4}L${X[to]} ${y}L${X[to] + tip} ${y + 4}`} />
                    {both === true && <path d={`M${X[from] - tip} ${y - 4}L${X[from]} ${y}L${X[from] - tip} ${y + 4}`} />}
                  </>
                )}
                {(row.step === "request" || row.step === "verdict") && (
                  <g strokeDasharray="3 3">
                    <path d={`M${X.Ledger + 8} ${y}H${X.Authority}`} />
                    <circle cx={X.Authority} cy={y} r="3" fill="var(--panel)" />
                    <text x={(X.Ledger + X.Authority) / 2 + 4} y={y - 6} textAnchor="middle" className="step-text" stroke="none" fill={ahead ? "var(--ink3)" : "var(--ink)"}>
                      {t("endorses", { step: row.step })}
                    </text>
                  </g>
                )}
                <g stroke="none" fill={ahead ? "var(--ink3)" : "var(--ink)"}>
                  <text x="14" y={y + 4} className="step-label">
                    {row.number} {t("short", { step: row.step })}
                  </text>
                  <text x={from === to ? X[from] + 12 : (X[from] + X[to]) / 2} y={from === to ? y + 4 : y - 6} textAnchor={from === to ? "start" : "middle"} className="step-text">
                    {t("says", { step: row.step })}
                  </text>
                  <text x={WIDTH - 14} y={y + 4} textAnchor="end" className="step-text">
                    {row.took_ms !== undefined ? duration(row.took_ms) : row.t_ms === undefined ? "" : timeOfDay(row.t_ms)}
                  </text>
                </g>
              </g>
            );
          })}
        </svg>
      </Scroll>
    </section>
  );
}
