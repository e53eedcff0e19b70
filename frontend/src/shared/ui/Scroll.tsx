import type { ReactElement, ReactNode } from "react";

type Properties = { label: string; className?: string; busy?: boolean; children: ReactNode };

/** What may be wider than its place scrolls sideways, by pointer and by keys. */
export function Scroll({ label, className = "scroll", busy = false, children }: Properties): ReactElement {
  return (
    // eslint-disable-next-line jsx-a11y/no-noninteractive-tabindex -- whoever has no pointer must be able to scroll it, too (WCAG 2.1.1)
    <div className={className} role="region" aria-label={label} aria-busy={busy} tabIndex={0}>
      {children}
    </div>
  );
}
