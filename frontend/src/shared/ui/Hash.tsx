import { useEffect, useState, type ReactElement } from "react";
import { shortHash } from "../format";
import { sharedTexts as t } from "../texts";

/** A hash in short; pressing it copies the whole. */
export function Hash({ value, label }: { value: string; label: string }): ReactElement {
  const [copied, setCopied] = useState(false);
  useEffect(() => {
    if (!copied) return undefined;
    const timer = setTimeout(() => setCopied(false), 1500);
    return () => clearTimeout(timer);
  }, [copied]);
  const copy = (): void => {
    navigator.clipboard.writeText(value).then(
      () => setCopied(true),
      () => setCopied(false),
    );
  };
  return (
    <button type="button" className="copy mono" title={`${label} ${value}`} onClick={copy}>
      <span className="visually-hidden">{t("copy", { label, value })}</span>
      <span aria-live="polite">{copied ? t("copied") : shortHash(value)}</span>
    </button>
  );
}
