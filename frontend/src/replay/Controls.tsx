import { useRef, useState, type ReactElement, type SyntheticEvent } from "react";
import { day, timeOfDay } from "../shared/format";
import { SPANS, SPEEDS, type Span, type Speed } from "../shared/address/replayPlace";
import type { PlayerState } from "./player";
import { replayTexts as t } from "./texts";
import { typedTime } from "./typedTime";

function Icon({ path }: { path: string }): ReactElement {
  return (
    <svg viewBox="0 0 20 20" aria-hidden="true">
      <path d={path} />
    </svg>
  );
}

/** A time, typed as people say it. */
function TimeField({ now_ms, onGo }: { now_ms: number; onGo: (t_ms: number) => void }): ReactElement {
  const [text, setText] = useState("");
  const [problem, setProblem] = useState<string | undefined>();
  const field = useRef<HTMLInputElement>(null);
  const submit = (event: SyntheticEvent): void => {
    event.preventDefault();
    const t_ms = typedTime(text, now_ms);
    if (t_ms === undefined) setProblem(t("timeUnknown", { hint: t("timeHint") }));
    else if (t_ms > now_ms) setProblem(t("later"));
    else {
      setProblem(undefined);
      setText("");
      // So that the keys of the player are the player's again.
      field.current?.blur();
      onGo(t_ms);
    }
  };
  return (
    <form className="time-field" onSubmit={submit}>
      <input
        ref={field}
        type="text"
        value={text}
        maxLength={60}
        placeholder={t("timeHint").split(",")[0]}
        title={t("timeHint")}
        aria-label={t("time")}
        aria-invalid={problem !== undefined}
        aria-describedby={problem === undefined ? undefined : "time-problem"}
        onChange={(event) => {
          setText(event.target.value);
          setProblem(undefined);
        }}
      />
      <button type="submit" className="button">
        {t("go")}
      </button>
      {problem !== undefined && (
        <p id="time-problem" className="time-problem" role="alert">
          {problem}
        </p>
      )}
    </form>
  );
}

type Properties = {
  state: PlayerState;
  now_ms: number;
  span: Span;
  said: string | undefined;
  onPlay: () => void;
  onMove: (by_ms: number) => void;
  onRefusal: (direction: "next" | "previous") => void;
  onSpeed: (speed: Speed) => void;
  onSpan: (span: Span) => void;
  onGo: (t_ms: number) => void;
  onExport: () => void;
};

/** What a player of the past has for buttons. */
export function Controls({ state, now_ms, span, said, onPlay, onMove, onRefusal, onSpeed, onSpan, onGo, onExport }: Properties): ReactElement {
  const button = (title: string, key: string, path: string, act: () => void): ReactElement => (
    <button type="button" className="icon-button" title={`${title} (${key})`} aria-label={title} onClick={act}>
      <Icon path={path} />
    </button>
  );
  return (
    <div className="replay-controls">
      <p className="replay-time num" aria-live="off">
        <b data-testid="replay-time">{timeOfDay(state.t_ms)}</b> <span>{day(state.t_ms)}</span>
      </p>
      <div className="replay-buttons" role="group" aria-label={t("replay")}>
        {button(t("previousRefusal"), "p", "M4 4v12M16 4l-9 6 9 6z", () => onRefusal("previous"))}
        {button(t("back"), "←", "M10 5l-6 5 6 5zM17 5l-6 5 6 5z", () => onMove(-10_000))}
        <button
          type="button"
          className="icon-button replay-play"
          aria-pressed={state.playing}
          title={`${t(state.playing ? "pause" : "play")} (␣)`}
          aria-label={t(state.playing ? "pause" : "play")}
          onClick={onPlay}
        >
          <Icon path={state.playing ? "M6 4v12M14 4v12" : "M6 3.5l10 6.5-10 6.5z"} />
        </button>
        {button(t("on"), "→", "M10 5l6 5-6 5zM3 5l6 5-6 5z", () => onMove(10_000))}
        {button(t("nextRefusal"), "n", "M16 4v12M4 4l9 6-9 6z", () => onRefusal("next"))}
      </div>
      <label className="replay-choice">
        <span>{t("speed")}</span>
        <select value={state.speed} onChange={(event) => onSpeed(SPEEDS.find((each) => String(each) === event.target.value) ?? 1)}>
          {SPEEDS.map((speed) => (
            <option key={speed} value={speed}>
              {t("times", { speed })}
            </option>
          ))}
        </select>
      </label>
      <label className="replay-choice">
        <span>{t("span")}</span>
        <select value={span} onChange={(event) => onSpan(event.target.value as Span)}>
          {(Object.keys(SPANS) as Span[]).map((each) => (
            <option key={each} value={each}>
              {t("spanOf", { span: each })}
            </option>
          ))}
        </select>
      </label>
      <TimeField now_ms={now_ms} onGo={onGo} />
      <button type="button" className="button" onClick={onExport}>
        {t("export")}…
      </button>
      <p className="replay-said" role="status">
        {state.problem ?? said ?? (state.waiting ? t("waiting") : "")}
      </p>
    </div>
  );
}
