import type { ReactElement, ReactNode } from "react";
import { mapTexts as t } from "./texts";

type Properties = { title: string; kind?: string; onClose: () => void; children: ReactNode };

/** What was pressed on the map, beside the list: with a title and a way to put it away. */
export function MapCard({ title, kind = "", onClose, children }: Properties): ReactElement {
  return (
    <section className={`float map-card ${kind}`} aria-label={title}>
      <header>
        <h2>{title}</h2>
        <button type="button" className="icon-button" aria-label={t("close")} title={t("close")} onClick={onClose}>
          <svg viewBox="0 0 20 20" aria-hidden="true">
            <path d="M5 5l10 10M15 5L5 15" />
          </svg>
        </button>
      </header>
      {children}
    </section>
  );
}
