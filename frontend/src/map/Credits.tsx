import { lazy, Suspense, useState, type ReactElement } from "react";
import { useLive } from "../shared/live/useLive";
import type { Topic } from "../shared/live/store";
import type { Failing } from "./failures";
import type { BaseMap } from "./place";
import { mapTexts as t } from "./texts";

const TOPICS: readonly Topic[] = ["status"];
const MissingList = lazy(async () => import("./MissingList"));

/** Whose map this is: always in sight. What of it is missing, with where that is set, folds into the same line. */
export function Credits({ base, elsewhere, failing }: { base: BaseMap; elsewhere: boolean; failing: readonly Failing[] }): ReactElement | null {
  const demo = useLive(TOPICS, (store) => store.status?.server.demo === true);
  const [open, setOpen] = useState(false);
  const missing = base.missing.length + (elsewhere ? 1 : 0) + failing.length;
  const pieces = [base.archive, base.terrain, base.imagery].flatMap((each) => each?.attribution ?? []);
  if (pieces.length === 0 && missing === 0) return null;
  return (
    <div className="map-credits" data-testid="credits">
      {missing > 0 && open && (
        <Suspense fallback={null}>
          <MissingList base={base} elsewhere={elsewhere} failing={failing} />
        </Suspense>
      )}
      <p>
        {missing > 0 && (
          <>
            <span role="status">{t("missingCount", { count: missing })}</span>
            <button type="button" className="link" aria-expanded={open} aria-controls={open ? "map-missing" : undefined} onClick={() => setOpen(!open)}>
              {t(open ? "hideMissing" : "showMissing")}
            </button>
          </>
        )}
        {pieces.map(({ text, href }, i) =>
          href === "" ? (
            <span key={i}>{text}</span>
          ) : (
            <a key={i} href={href} target="_blank" rel="noreferrer">
              {text}
            </a>
          ),
        )}
        {demo && pieces.length > 0 && <span>{t("fictional")}</span>}
      </p>
    </div>
  );
}
