import { useEffect, useRef, useState, type ReactElement } from "react";
import { ApiError, useApi } from "../shared/api/api";
import { count } from "../shared/format";
import { checkChain, type Progress } from "./chain";
import { ledgerTexts as t } from "./texts";

const PAGE = 500;
type State = { phase: "idle" | "running" | "ended" | "stopped"; progress?: Progress; failure?: string };

function words({ phase, progress, failure }: State): { text: string; tone: "ok" | "bad" | "quiet" } | undefined {
  if (failure !== undefined) return { text: t("chainFailed", { why: failure }), tone: "bad" };
  if (progress === undefined) return undefined;
  if (progress.broken !== undefined) {
    const { number, link } = progress.broken;
    return { text: t("chainBroken", { block: count(number), link: link.replaceAll("-", "") }), tone: "bad" };
  }
  const values = { checked: count(progress.checked), total: count(progress.total) };
  if (phase === "running") return { text: t("checking", values), tone: "quiet" };
  return phase === "ended" ? { text: t("chainHolds", values), tone: "ok" } : { text: t("chainStopped", values), tone: "quiet" };
}

/** The button that recomputes every header's hash here, and what came of it. */
export function ChainCheck(): ReactElement {
  const api = useApi();
  const [state, setState] = useState<State>({ phase: "idle" });
  const running = useRef<AbortController | undefined>(undefined);
  useEffect(() => () => running.current?.abort(), []);

  const start = (): void => {
    const abort = new AbortController();
    running.current = abort;
    setState({ phase: "running", progress: { checked: 0, total: 0 } });
    checkChain(
      (cursor) => api.blocks({ limit: PAGE, ...(cursor !== undefined && { cursor }) }),
      (progress) => {
        if (!abort.signal.aborted) setState({ phase: "running", progress });
      },
      abort.signal,
    ).then(
      (progress) => setState({ phase: progress.checked === progress.total || progress.broken ? "ended" : "stopped", progress }),
      (problem: unknown) => {
        if (!(problem instanceof ApiError)) throw problem;
        setState({ phase: "ended", failure: problem.message });
      },
    );
  };

  const said = words(state);
  return (
    <div className="chain-check">
      {state.phase === "running" ? (
        <button type="button" className="button" onClick={() => running.current?.abort()}>
          {t("stop")}
        </button>
      ) : (
        <button type="button" className="button" onClick={start}>
          {t("checkChain")}
        </button>
      )}
      {said !== undefined && (
        <p role="status" className={`num ${said.tone === "quiet" ? "quiet" : said.tone === "ok" ? "look-verified" : "look-refuted"}`}>
          {said.text}
        </p>
      )}
      {state.phase === "running" && state.progress !== undefined && state.progress.total > 0 && (
        <progress value={state.progress.checked} max={state.progress.total} aria-label={t("checkChain")} />
      )}
    </div>
  );
}
