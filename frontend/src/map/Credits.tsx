import type { ReactElement } from "react";
import { useLive } from "../shared/live/useLive";
import type { Topic } from "../shared/live/store";
import type { BaseMap } from "./place";
import { mapTexts as t } from "./texts";

const TOPICS: readonly Topic[] = ["status"];

/** Whose map this is: always in sight. And what of it is missing, with where that is set. */
export function Credits({ base }: { base: BaseMap }): ReactElement | null {
  const demo = useLive(TOPICS, (store) => store.status?.server.demo === true);
  const pieces = [base.archive, base.terrain, base.imagery].flatMap((each) => each?.attribution ?? []);
  if (pieces.length === 0 && base.missing.length === 0) return null;
  return (
    <div className="map-credits" data-testid="credits">
      {base.missing.map(({ what, why, setting }) => (
        <p key={what} role="status">
          {t("mapMissing", { what, why })} <code>{setting}</code>
        </p>
      ))}
      {pieces.length > 0 && (
        <p>
          {pieces.map(({ text, href }, i) =>
            href === "" ? (
              <span key={i}>{text}</span>
            ) : (
              <a key={i} href={href} target="_blank" rel="noreferrer">
                {text}
              </a>
            ),
          )}
          {demo && <span>{t("fictional")}</span>}
        </p>
      )}
    </div>
  );
}
