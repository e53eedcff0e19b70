import en from "@messages/en/console/tour-offer.json";
import fi from "@messages/fi/console/tour-offer.json";
import { Suspense, lazy, type ReactElement } from "react";
import { texts } from "../shared/i18n/texts";
import { declineTour, startTour, STOPS, useTour } from "../shared/tourStops";

const TourCard = lazy(() => import("./TourCard").then(({ TourCard: Card }) => ({ default: Card })));
const t = texts({ en, fi });

/** Offers the tour to who has not seen it; in the header, where it is in nobody's way. */
export function TourOffer(): ReactElement | null {
  const { offered } = useTour();
  if (!offered) return null;
  return (
    <span className="chip tour-offer">
      <button type="button" onClick={startTour}>
        {t("offer")}
      </button>
      <button type="button" aria-label={t("decline")} title={t("decline")} onClick={declineTour}>
        ×
      </button>
    </span>
  );
}

/** One stop after the other, once somebody takes the tour. */
export function Tour(): ReactElement | null {
  const { at } = useTour();
  const stop = at === undefined ? undefined : STOPS[at];
  if (at === undefined || stop === undefined) return null;
  return (
    <Suspense fallback={null}>
      <TourCard at={at} stop={stop} />
    </Suspense>
  );
}
