import type { ReactElement } from "react";
import { liveTexts as t } from "./texts";

type Properties = { onZoom: (levels: number) => void; onAll: () => void };

export function ZoomControls({ onZoom, onAll }: Properties): ReactElement {
  return (
    <div className="float zoom" role="group" aria-label={t("map")}>
      <button type="button" className="icon-button" title={`${t("closer")} (+)`} aria-label={t("closer")} onClick={() => onZoom(1)}>
        <svg viewBox="0 0 20 20" aria-hidden="true">
          <path d="M10 4v12M4 10h12" />
        </svg>
      </button>
      <button type="button" className="icon-button" title={`${t("further")} (−)`} aria-label={t("further")} onClick={() => onZoom(-1)}>
        <svg viewBox="0 0 20 20" aria-hidden="true">
          <path d="M4 10h12" />
        </svg>
      </button>
      <button type="button" className="icon-button" title={`${t("allPads")} (0)`} aria-label={t("allPads")} onClick={onAll}>
        <svg viewBox="0 0 20 20" aria-hidden="true">
          <path d="M3 7V3h4M13 3h4v4M17 13v4h-4M7 17H3v-4" />
        </svg>
      </button>
    </div>
  );
}
