import { useEffect, useState, type ReactElement } from "react";
import type { VerdictSummary } from "../shared/api/records";
import { count } from "../shared/format";
import type { LiveStore } from "../shared/live/store";
import { useLiveStore } from "../shared/live/useLive";
import { liveTexts as t } from "./texts";

/** Verdicts are told together this long after the first of them: somebody listens to every word. */
export const GATHER_MS = 4_000;
/** More than this at once are told as a number, and only the refuted by name. */
const FEW = 3;

/** New verdicts in a sentence or a few. */
export function announcement(verdicts: readonly VerdictSummary[], padName: (pad_id: string) => string): string {
  if (verdicts.length <= FEW) {
    return verdicts.map(({ uav_id, outcome, pad_id }) => t("announce", { who: uav_id, outcome, pad: padName(pad_id) })).join(" ");
  }
  const of = (outcome: VerdictSummary["outcome"]): VerdictSummary[] => verdicts.filter((verdict) => verdict.outcome === outcome);
  const refuted = of("refuted");
  const sums = t("announceMany", {
    total: count(verdicts.length),
    verified: count(of("verified").length),
    inconclusive: count(of("inconclusive").length),
    refuted: count(refuted.length),
  });
  const who = refuted.slice(0, FEW).map(({ uav_id }) => uav_id);
  return who.length === 0 ? sums : `${sums} ${t("announceWho", { who: who.join(", ") })}`;
}

/** Gathers the verdicts that come, and tells them together; those that were there before are no news. */
function listen(store: LiveStore, say: (text: string) => void): () => void {
  let newest_ms = store.verdictsByTime()[0]?.decided_ms ?? store.serverNow_ms();
  let timer: ReturnType<typeof setTimeout> | undefined;
  const tell = (): void => {
    timer = undefined;
    const fresh = store.verdictsByTime().filter(({ decided_ms }) => decided_ms > newest_ms);
    newest_ms = fresh[0]?.decided_ms ?? newest_ms;
    if (fresh.length > 0) say(announcement([...fresh].reverse(), (pad_id) => store.pads.get(pad_id)?.name ?? pad_id));
  };
  const end = store.subscribe(["verdicts"], () => {
    // The page's own first picture is no news.
    if (!store.ready) newest_ms = store.verdictsByTime()[0]?.decided_ms ?? newest_ms;
    else timer ??= setTimeout(tell, GATHER_MS);
  });
  return () => {
    clearTimeout(timer);
    end();
  };
}

/** Tells screen readers of verdicts, politely. */
export function Announcer(): ReactElement {
  const store = useLiveStore();
  const [said, setSaid] = useState("");
  useEffect(() => listen(store, setSaid), [store]);
  return (
    <p className="visually-hidden" role="status" aria-live="polite" data-testid="announcer">
      {said}
    </p>
  );
}
