import type { ReactElement, ReactNode } from "react";

/** A wide or long table: a region that scrolls must be reachable by keyboard. */
export function Scroll({ name, children, long = false }: { name: string; children: ReactNode; long?: boolean }): ReactElement {
  return (
    // eslint-disable-next-line jsx-a11y/no-noninteractive-tabindex
    <div className={long ? "scroll zones-findings" : "scroll"} role="region" aria-label={name} tabIndex={0}>
      {children}
    </div>
  );
}
