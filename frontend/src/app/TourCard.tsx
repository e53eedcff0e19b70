import { useEffect, useRef, type ReactElement } from "react";
import { useKeys } from "../shared/ui/useKeys";
import { go, type Place } from "../shared/address/location";
import type { VerdictSummary } from "../shared/api/records";
import type { LiveStore } from "../shared/live/store";
import { useLiveStore } from "../shared/live/useLive";
import { goToStop, STOPS, type Stop } from "../shared/tourStops";
import { tourTexts as t } from "./tourTexts";

const HERE = "tour-here";

/** On the map, who lied last; the page as it is where nobody did. */
function liarOr(place: Place, store: LiveStore): Place {
  const liar = [...store.verdicts.values()].filter(({ outcome }) => outcome === "refuted").reduce<VerdictSummary | undefined>((last, each) => (last === undefined || each.decided_ms > last.decided_ms ? each : last), undefined);
  return liar === undefined || place.room !== "live" ? place : { ...place, drone: liar.uav_id };
}

/** One stop: what one sees there, and why. The page stays usable all the while. */
export function TourCard({ at, stop }: { at: number; stop: Stop }): ReactElement {
  const card = useRef<HTMLElement>(null);
  useKeys({ Escape: () => goToStop(-1) });
  const store = useLiveStore();
  useEffect(() => {
    go(stop.name === "map" ? liarOr(stop.place, store) : stop.place);
    card.current?.focus();
    // The room may have to be loaded first.
    const timer = setTimeout(() => document.querySelector(stop.selector)?.classList.add(HERE), 300);
    return () => {
      clearTimeout(timer);
      for (const each of document.querySelectorAll(`.${HERE}`)) each.classList.remove(HERE);
    };
  }, [stop, store]);
  const last = at === STOPS.length - 1;
  return (
    <section ref={card} className="float tour" tabIndex={-1} aria-labelledby="tour-title">
      <h2 id="tour-title">{t(`${stop.name}Title`)}</h2>
      <p>{t(stop.name)}</p>
      <footer>
        <span className="quiet num">{t("of", { stop: at + 1, all: STOPS.length })}</span>
        {at > 0 && (
          <button type="button" className="button" onClick={() => goToStop(at - 1)}>
            {t("back")}
          </button>
        )}
        {!last && (
          <button type="button" className="button" onClick={() => goToStop(-1)}>
            {t("end")}
          </button>
        )}
        <button type="button" className="button primary" onClick={() => goToStop(at + 1)}>
          {last ? t("done") : t("next")}
        </button>
      </footer>
    </section>
  );
}
