import type { ReactElement } from "react";
import { Parts } from "../shared/ui/Symbol";
import { claimRing, measuredDiamond } from "../shared/design/symbols";
import { deskTexts as t } from "./texts";

function Mark({ children }: { children: ReactElement }): ReactElement {
  return (
    <svg width="16" height="16" viewBox="0 0 20 20" aria-hidden="true">
      {children}
    </svg>
  );
}

/** What the marks on the map mean, and the spacing of its grid. */
export function Legend({ grid_m }: { grid_m: number | undefined }): ReactElement {
  return (
    <ul className="float legend" aria-label={t("legend")}>
      <li>
        <Mark>
          <>
            <Parts parts={claimRing("ink2")} />
          </>
        </Mark>
        {t("says")}
      </li>
      <li>
        <Mark>
          <>
            <Parts parts={measuredDiamond("ink2", true)} />
          </>
        </Mark>
        {t("measured")}
      </li>
      <li>
        <Mark>
          <circle cx="10" cy="10" r="8" fill="none" stroke="var(--ink2)" strokeWidth="1.6" strokeDasharray="4 3" />
        </Mark>
        {t("buffer")}
      </li>
      <li>
        <Mark>
          <ellipse cx="10" cy="10" rx="9" ry="4.4" fill="none" stroke="var(--ink2)" strokeWidth="1.6" />
        </Mark>
        99 %
      </li>
      {grid_m !== undefined && (
        <li className="num" data-testid="grid">
          <Mark>
            <path d="M3 3v14M10 3v14M17 3v14M3 3h14M3 10h14M3 17h14" stroke="var(--ink3)" fill="none" />
          </Mark>
          {grid_m < 1000 ? `${grid_m} m` : `${grid_m / 1000} km`}
        </li>
      )}
    </ul>
  );
}
