import { useEffect, useState, type ReactElement, type ReactNode } from "react";
import { sharedTexts as t } from "../texts";

const SETTLE_MS = 250;

type SearchProperties = { label: string; value: string; hint?: string; onSearch: (value: string) => void };

/** A search box whose text goes into the address once the user pauses. */
export function SearchBox({ label, value, hint, onSearch }: SearchProperties): ReactElement {
  const [text, setText] = useState(value);
  const [sent, setSent] = useState(value);
  // The address has changed otherwise: all filters were cleared, or a link was followed.
  if (value !== sent) {
    setSent(value);
    setText(value);
  }
  useEffect(() => {
    if (text.trim() === value) return undefined;
    const timer = setTimeout(() => {
      setSent(text.trim());
      onSearch(text.trim());
    }, SETTLE_MS);
    return () => clearTimeout(timer);
  }, [text, value, onSearch]);
  return (
    <label>
      <span>{label}</span>
      <input type="search" value={text} maxLength={128} placeholder={hint} onChange={(event) => setText(event.target.value)} />
    </label>
  );
}

type ChoiceProperties = {
  label: string;
  value: string;
  options: readonly { value: string; name: string }[];
  onChange: (value: string) => void;
  /** What the choice of everything is called; null where one has to be chosen. */
  any?: string | null;
};

export function Choice({ label, value, options, onChange, any = t("all") }: ChoiceProperties): ReactElement {
  // What an address names may not be there (any more): it is still what is filtered by.
  const known = value === "" || options.some((option) => option.value === value);
  return (
    <label>
      <span>{label}</span>
      <select value={value} onChange={(event) => onChange(event.target.value)}>
        {any !== null && <option value="">{any}</option>}
        {!known && <option value={value}>{value}</option>}
        {options.map((option) => (
          <option key={option.value} value={option.value}>
            {option.name}
          </option>
        ))}
      </select>
    </label>
  );
}

type DaysProperties = { since: string; until: string; onChange: (change: { since: string } | { until: string }) => void };

/** From the first of two days to the end of the other. */
export function Days({ since, until, onChange }: DaysProperties): ReactElement {
  return (
    <>
      <label>
        <span>{t("fromDay")}</span>
        <input type="date" value={since} max={until === "" ? undefined : until} onChange={(event) => onChange({ since: event.target.value })} />
      </label>
      <label>
        <span>{t("untilDay")}</span>
        <input type="date" value={until} min={since === "" ? undefined : since} onChange={(event) => onChange({ until: event.target.value })} />
      </label>
    </>
  );
}

type BarProperties = {
  children: ReactNode;
  actions?: ReactNode;
  /** Shows all again; given where something is filtered by. */
  onClear?: (() => void) | undefined;
};

export function Bar({ children, actions, onClear }: BarProperties): ReactElement {
  return (
    <div className="filter-bar">
      <div className="filters" role="group" aria-label={t("filters")}>
        {children}
        {onClear !== undefined && (
          <button type="button" className="button" onClick={onClear}>
            {t("clearFilters")}
          </button>
        )}
      </div>
      {actions}
    </div>
  );
}
