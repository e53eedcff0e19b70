import type { ReactElement } from "react";
import { mapTexts } from "../map/texts";
import { deskTexts as t } from "./texts";

type Properties = { following: boolean; onFollow: (() => void) | undefined; onShow: () => void; onClose: () => void };

/** What one can do with what is selected. */
export function PanelTools({ following, onFollow, onShow, onClose }: Properties): ReactElement {
  return (
    <span className="tools">
      {onFollow !== undefined && (
        <button
          type="button"
          className="icon-button"
          aria-pressed={following}
          title={`${t(following ? "unfollow" : "follow")} (c)`}
          aria-label={t("follow")}
          onClick={onFollow}
        >
          <svg viewBox="0 0 20 20" aria-hidden="true">
            <path d="M3 7V3h4M13 3h4v4M17 13v4h-4M7 17H3v-4M10 7.2l2.6 5.6L10 11.6l-2.6 1.2z" />
          </svg>
        </button>
      )}
      <button type="button" className="icon-button" title={`${t("showOnMap")} (f)`} aria-label={t("showOnMap")} onClick={onShow}>
        <svg viewBox="0 0 20 20" aria-hidden="true">
          <circle cx="10" cy="10" r="5" />
          <path d="M10 1.5v4M10 14.5v4M1.5 10h4M14.5 10h4" />
        </svg>
      </button>
      <button type="button" className="icon-button" title={`${mapTexts("close")} (Esc)`} aria-label={mapTexts("close")} onClick={onClose}>
        <svg viewBox="0 0 20 20" aria-hidden="true">
          <path d="M5 5l10 10M15 5L5 15" />
        </svg>
      </button>
    </span>
  );
}

/** The handle by which a sheet of a phone is folded. */
export function SheetHandle({ open, onToggle, name }: { open: boolean; onToggle: () => void; name: "list" | "proof" }): ReactElement {
  return (
    <button type="button" className="sheet-handle" aria-expanded={open} aria-label={t(open ? "fold" : "unfold", { what: name })} onClick={onToggle}>
      <span />
    </button>
  );
}
