import { useEffect, useState, type ReactElement, type ReactNode } from "react";
import { sharedTexts } from "../shared/texts";
import { registryTexts as t } from "./texts";

const SETTLE_MS = 250;

/** A search box whose text goes into the address once the user pauses. */
export function SearchBox({ value, hint, onSearch }: { value: string; hint: string; onSearch: (value: string) => void }): ReactElement {
  const [text, setText] = useState(value);
  useEffect(() => {
    if (text.trim() === value) return undefined;
    const timer = setTimeout(() => onSearch(text.trim()), SETTLE_MS);
    return () => clearTimeout(timer);
  }, [text, value, onSearch]);
  return (
    <label>
      {t("search")}
      <input type="search" value={text} maxLength={128} placeholder={hint} onChange={(event) => setText(event.target.value)} />
    </label>
  );
}

type ChoiceProperties = { label: string; value: string; options: readonly { value: string; name: string }[]; onChange: (value: string) => void; every?: boolean };

export function Choice({ label, value, options, onChange, every = true }: ChoiceProperties): ReactElement {
  return (
    <label>
      {label}
      <select value={value} onChange={(event) => onChange(event.target.value)}>
        {every && <option value="">{sharedTexts("all")}</option>}
        {options.map((option) => (
          <option key={option.value} value={option.value}>
            {option.name}
          </option>
        ))}
      </select>
    </label>
  );
}

export function Bar({ children, actions }: { children: ReactNode; actions?: ReactNode }): ReactElement {
  return (
    <div className="registry-bar">
      <div className="registry-filters">{children}</div>
      {actions}
    </div>
  );
}
