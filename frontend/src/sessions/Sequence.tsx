import type { ReactElement } from "react";
import { transactionHref } from "../shared/address/ledgerLinks";
import type { SessionDetail, SessionSummary, StepName } from "../shared/api/records";
import { count, duration, shortHash, timeOfDay } from "../shared/format";
import { Scroll } from "../shared/ui/Scroll";
import { signed, type Signed } from "./signed";
import { stepRows, type StepRow } from "./stepRows";
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

const WIDTH = 740;
const TOP = 40;
const ROW = 40;
const LINE = 14;
/** Where an arrow lies in its row: below its own words, above what was signed. */
const ARROW = 22;
const X: Record<Party, number> = { Drone: 130, Pad: 290, Ledger: 470, Authority: 610 };

function tone(row: StepRow, session: SessionSummary): string {
  if (row.step === "verdict" && session.outcome === "inconclusive") return "maybe";
  return { done: "ink2", failed: "bad", refused: "bad", now: "accent", waiting: "line", never: "line" }[row.state];
}

/** What stands below an arrow: signer and digest as text, the transaction as a way to the ledger view. */
function Notes({ of, x, y }: { of: Signed; x: number; y: number }): ReactElement {
  const { by, organisation, digest, transaction } = of;
  const lines = [...(by === undefined ? [] : [t("signedBy", { name: by })]), ...(digest === undefined ? [] : [digest])];
  return (
    <g stroke="none" textAnchor="middle" className="step-notes">
      {lines.map((line, i) => (
        <text key={line} x={x} y={y + LINE * (i + 1)}>
          {i === 0 && organisation !== undefined && <title>{`${by ?? ""} · ${organisation}`}</title>}
          {line}
        </text>
      ))}
      {transaction !== undefined && (
        <a href={transactionHref(transaction.tx_id)}>
          <text x={x} y={y + LINE * (lines.length + 1)}>
            <title>{transaction.tx_id}</title>
            {t("inBlock", { tx: shortHash(transaction.tx_id), block: count(transaction.block) })}
          </text>
        </a>
      )}
    </g>
  );
}

function noteLines({ by, digest, transaction }: Signed): number {
  return [by, digest, transaction].filter((each) => each !== undefined).length;
}

/** The eight steps as a sequence between drone, pad and ledger, filling in while they happen. */
export function Sequence({ session, detail }: { session: SessionSummary; detail?: SessionDetail | undefined }): ReactElement {
  const held = detail === undefined ? {} : signed(detail);
  const noted = stepRows(session).map((row) => {
    const ahead = row.state === "waiting" || row.state === "never";
    const notes: Signed = ahead ? {} : (held[row.step] ?? {});
    return { ...row, ahead, notes, tall: ROW + LINE * noteLines(notes) };
  });
  const above = (i: number): number => noted.slice(0, i).reduce((sum, { tall }) => sum + tall, TOP);
  const rows = noted.map((row, i) => ({ ...row, y: above(i) + ARROW }));
  const height = above(noted.length) + 4;
  return (
    <section className="float card">
      <h2 id="sequence">{t("stepByStep")}</h2>
      <Scroll label={t("stepByStep")}>
        <svg className="sequence num" viewBox={`0 0 ${WIDTH} ${height}`} role="group" aria-labelledby="sequence">
          {PARTIES.map((party) => (
            <g key={party}>
              <text x={X[party]} y="18" textAnchor="middle" className="party">
                {t("party", { party })}
              </text>
              <path d={`M${X[party]} 28V${height}`} stroke="var(--line)" />
            </g>
          ))}
          {rows.map(({ ahead, notes, y, ...row }) => {
            const { from, to, both } = ARROWS[row.step];
            const colour = `var(--${tone(row, session)})`;
            const ink = ahead ? "var(--ink3)" : "var(--ink)";
            const right = X[to] > X[from];
            const tip = right ? -7 : 7;
            // Clear of the pad's line, where an arrow passes it.
            const middle = row.step === "request" || row.step === "permission" ? (X.Pad + X.Ledger) / 2 : (X[from] + X[to]) / 2;
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
                  <g>
                    <path d={`M${X.Ledger + 8} ${y}H${X.Authority}`} strokeDasharray="3 3" />
                    <circle cx={X.Authority} cy={y} r="3" fill="var(--panel)" />
                    <g stroke="none" textAnchor="middle" fill={ink}>
                      <text x={(X.Ledger + X.Authority) / 2} y={y - 6} className="step-text">
                        {t("endorses", { step: row.step })}
                      </text>
                      {notes.transaction?.endorsers.slice(0, 2).map((endorser, i) => (
                        <text key={endorser} x={(X.Ledger + X.Authority) / 2} y={y + LINE * (i + 1)} className="step-text">
                          {endorser}
                        </text>
                      ))}
                    </g>
                  </g>
                )}
                <g stroke="none" fill={ink}>
                  <text x="14" y={y + 4} className="step-label">
                    {row.number} {t("short", { step: row.step })}
                  </text>
                  <text x={from === to ? X[from] + 12 : middle} y={from === to ? y + 4 : y - 6} textAnchor={from === to ? "start" : "middle"} className="step-text">
                    {t("says", { step: row.step })}
                  </text>
                  <text x={WIDTH - 14} y={y + 4} textAnchor="end" className="step-text">
                    {row.took_ms !== undefined ? duration(row.took_ms) : row.t_ms === undefined ? "" : timeOfDay(row.t_ms)}
                  </text>
                </g>
                <Notes of={notes} x={middle} y={y} />
              </g>
            );
          })}
        </svg>
      </Scroll>
    </section>
  );
}
