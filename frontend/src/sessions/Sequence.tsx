import type { ReactElement } from "react";
import type { SessionState, StepName } from "../shared/api/records";
import { duration, timeOfDay } from "../shared/format";
import { stepRows, type StepRow } from "./steps";

const PARTIES = ["Drone", "Pad", "Ledger", "Authority"] as const;
type Party = (typeof PARTIES)[number];

/** Who says what to whom in each step. */
const ARROWS: Record<StepName, { from: Party; to: Party; both?: true; text: string }> = {
  request: { from: "Drone", to: "Ledger", text: "claim, one-time key, action" },
  poll: { from: "Pad", to: "Drone", text: "poll with the session's code" },
  match: { from: "Drone", to: "Drone", text: "derives the keys, checks the code" },
  reply: { from: "Drone", to: "Pad", text: "its own code" },
  range: { from: "Pad", to: "Drone", both: true, text: "ranging, sealed claims" },
  confirm: { from: "Drone", to: "Pad", text: "signs ranges and claims" },
  verdict: { from: "Pad", to: "Ledger", text: "evidence" },
  permission: { from: "Ledger", to: "Drone", text: "committed verdict" },
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
      <h2>Step by step</h2>
      <div className="scroll">
        <svg className="sequence num" viewBox={`0 0 ${WIDTH} ${height}`} role="img" aria-label="Sequence of the eight steps; the list of steps says the same">
          {PARTIES.map((party) => (
            <g key={party}>
              <text x={X[party]} y="18" textAnchor="middle" className="party">
                {party}
              </text>
              <path d={`M${X[party]} 28V${height}`} stroke="var(--line)" />
            </g>
          ))}
          {rows.map((row, i) => {
            const { from, to, both, text } = ARROWS[row.step];
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
                      {row.step === "verdict" ? "decides, endorses" : "endorses"}
                    </text>
                  </g>
                )}
                <g stroke="none" fill={ahead ? "var(--ink3)" : "var(--ink)"}>
                  <text x="14" y={y + 4} className="step-label">
                    {row.number} {row.step}
                  </text>
                  <text x={from === to ? X[from] + 12 : (X[from] + X[to]) / 2} y={from === to ? y + 4 : y - 6} textAnchor={from === to ? "start" : "middle"} className="step-text">
                    {text}
                  </text>
                  <text x={WIDTH - 14} y={y + 4} textAnchor="end" className="step-text">
                    {row.took_ms !== undefined ? duration(row.took_ms) : row.t_ms === undefined ? "" : timeOfDay(row.t_ms)}
                  </text>
                </g>
              </g>
            );
          })}
        </svg>
      </div>
    </section>
  );
}
