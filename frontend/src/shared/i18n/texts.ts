/**
 * Texts in every language, from the catalogue that the backend has too (`@messages`). A message is ICU MessageFormat;
 * `<b>…</b>` marks what stands out. A language that lacks a message does not compile.
 */
import { IntlMessageFormat } from "intl-messageformat";
import { reading, type Locale } from "./locale";

/** A part of a sentence; what matters most stands out. */
export type Phrase = string | { strong: string };
export type Values = Readonly<Record<string, string | number>>;
type Messages<Key extends string> = Readonly<Record<Key, string>>;

export type Texts<Key extends string> = {
  (key: Key, values?: Values): string;
  /** With its emphasis. */
  rich: (key: Key, values?: Values) => Phrase[];
  readonly all: Readonly<Record<Locale, Messages<Key>>>;
};

const emphasis = { b: (parts: unknown[]): Phrase => ({ strong: parts.join("") }) };

/** The messages of one domain. Raises (in development) where a message is no ICU message or lacks a value. */
export function texts<const English extends Readonly<Record<string, string>>>(all: {
  en: English;
  fi: Messages<Extract<keyof English, string>>;
}): Texts<Extract<keyof English, string>> {
  type Key = Extract<keyof English, string>;
  const catalogues = all as Record<Locale, Messages<Key>>;
  const parsed = new Map<string, IntlMessageFormat>();
  const message = (key: Key): IntlMessageFormat => {
    const { locale } = reading();
    const name = `${locale}:${key}`;
    let found = parsed.get(name);
    if (found === undefined) {
      found = new IntlMessageFormat(catalogues[locale][key], locale);
      parsed.set(name, found);
    }
    return found;
  };
  const rich = (key: Key, values: Values = {}): Phrase[] => {
    const result = message(key).format<Phrase>({ ...values, ...emphasis });
    return Array.isArray(result) ? result : [result];
  };
  const plain = (key: Key, values: Values = {}): string =>
    rich(key, values)
      .map((part) => (typeof part === "string" ? part : part.strong))
      .join("");
  return Object.assign(plain, { rich, all: catalogues });
}
