import { useEffect, useRef, type PointerEvent, type ReactElement } from "react";
import type { PastMarks } from "../shared/api/records";
import { day, timeOfDay } from "../shared/format";
import { alertTitle } from "../alerts/words";
import { replayTexts as t } from "./texts";

const HEIGHT = 60;
const BASE = 44;
/** Marks closer than this share of the width to one another are drawn as one: the gravest. */
const TOGETHER = 0.004;
const TICKS = 6;

type Mark = PastMarks["marks"][number];

function rank(mark: Mark): number {
  if (mark.kind === "refusal") return mark.outcome === "refuted" ? 4 : 3;
  if (mark.kind === "alert") return 2;
  return 1;
}

/** Marks that would lie on one another, as the gravest of them; verdicts that gave permission are only density. */
export function apart(marks: readonly Mark[], from_ms: number, until_ms: number): Mark[] {
  const shown: Mark[] = [];
  const room = (until_ms - from_ms) * TOGETHER;
  for (const mark of marks) {
    if (mark.kind === "verdict") continue;
    const last = shown.at(-1);
    if (last !== undefined && mark.t_ms - last.t_ms < room) {
      if (rank(mark) > rank(last)) shown[shown.length - 1] = mark;
    } else shown.push(mark);
  }
  return shown;
}

function words(mark: Mark): string {
  const time = timeOfDay(mark.t_ms);
  if (mark.kind === "alert") return t("alertAt", { title: alertTitle(mark.alert ?? ""), time });
  return t("refusalAt", { uav: mark.uav_id ?? "", time });
}

function area(values: readonly number[], most: number, height: number): string {
  const width = 1_000 / values.length;
  // A square root: one lone drone must be seen beside a thousand.
  const y = (value: number): number => BASE - (most === 0 ? 0 : Math.sqrt(value / most) * height);
  const points = values.flatMap((value, i) => [`${i * width} ${y(value)}`, `${(i + 1) * width} ${y(value)}`]);
  return `M0 ${BASE}L${points.join("L")}L1000 ${BASE}Z`;
}

type Properties = {
  marks: PastMarks | undefined;
  from_ms: number;
  until_ms: number;
  now_ms: number;
  t_ms: number;
  onSeek: (t_ms: number) => void;
  /** Held and moved: not yet where one wants to go. */
  onDrag: (t_ms: number) => void;
};

/** Time as a line: how much there is when, what was refused, and where one is. A slider, also for the keyboard. */
export function Scrubber({ marks, from_ms, until_ms, now_ms, t_ms, onSeek, onDrag }: Properties): ReactElement {
  const line = useRef<HTMLDivElement>(null);
  const held = useRef(false);
  const place = (at_ms: number): number => ((at_ms - from_ms) / (until_ms - from_ms)) * 100;
  const timeAt = (event: PointerEvent): number => {
    const box = line.current?.getBoundingClientRect();
    if (box === undefined || box.width === 0) return t_ms;
    const share = Math.max(0, Math.min(1, (event.clientX - box.left) / box.width));
    return Math.min(now_ms, from_ms + share * (until_ms - from_ms));
  };
  useEffect(() => {
    const end = (): void => {
      held.current = false;
    };
    addEventListener("pointercancel", end);
    return () => removeEventListener("pointercancel", end);
  }, []);
  const positions = marks?.density.positions ?? [];
  const sessions = marks?.density.sessions ?? [];
  const shown = marks === undefined ? [] : apart(marks.marks, from_ms, until_ms);
  const sum = (values: readonly number[] | undefined): number => (values ?? []).reduce((total, value) => total + value, 0);
  const long = until_ms - from_ms > 86_400_000;
  const ticks = Array.from({ length: TICKS }, (_, i) => from_ms + ((i + 0.5) / TICKS) * (until_ms - from_ms));
  return (
    <div className="scrubber">
      <div
        className="scrubber-line"
        ref={line}
        role="slider"
        tabIndex={0}
        aria-label={t("scrubber")}
        aria-valuemin={Math.round(from_ms)}
        aria-valuemax={Math.round(until_ms)}
        aria-valuenow={Math.round(t_ms)}
        aria-valuetext={`${day(t_ms)}, ${timeOfDay(t_ms)}`}
        onPointerDown={(event) => {
          if (event.button !== 0) return;
          event.currentTarget.setPointerCapture(event.pointerId);
          held.current = true;
          onDrag(timeAt(event));
        }}
        onPointerMove={(event) => held.current && onDrag(timeAt(event))}
        onPointerUp={(event) => {
          if (!held.current) return;
          held.current = false;
          onSeek(timeAt(event));
        }}
      >
        <svg
          viewBox={`0 0 1000 ${HEIGHT}`}
          preserveAspectRatio="none"
          role="img"
          aria-label={t("density", {
            positions: sum(positions),
            sessions: sum(sessions),
            refusals: sum(marks?.density.refusals),
            alerts: sum(marks?.density.alerts),
            from: timeOfDay(from_ms),
            until: timeOfDay(until_ms),
          })}
        >
          {positions.length > 0 && <path className="density-positions" d={area(positions, Math.max(...positions), 30)} />}
          {sessions.length > 0 && <path className="density-sessions" d={area(sessions, Math.max(...sessions), 22)} />}
          <path d={`M0 ${BASE + 0.5}H1000`} stroke="var(--line)" vectorEffect="non-scaling-stroke" />
        </svg>
        {until_ms > now_ms && <span className="scrubber-future" style={{ left: `${Math.max(0, place(now_ms))}%` }} />}
        {ticks.map((tick) => (
          <span key={tick} className="scrubber-tick num" style={{ left: `${place(tick)}%` }} aria-hidden="true">
            {long ? day(tick) : timeOfDay(tick).slice(0, -3)}
          </span>
        ))}
        {t_ms >= from_ms && t_ms <= until_ms && <span className="scrubber-now" style={{ left: `${place(t_ms)}%` }} />}
      </div>
      <div className="scrubber-marks">
        {shown.map((mark) => (
          <button
            key={`${mark.kind}${mark.t_ms}${mark.session_id ?? mark.alert_id ?? ""}`}
            type="button"
            tabIndex={-1}
            className={`scrubber-mark mark-${mark.kind}${mark.outcome === "refuted" ? " mark-refuted" : ""}`}
            style={{ left: `${place(mark.t_ms)}%` }}
            title={words(mark)}
            aria-label={words(mark)}
            onClick={() => onSeek(mark.t_ms)}
          />
        ))}
      </div>
    </div>
  );
}
