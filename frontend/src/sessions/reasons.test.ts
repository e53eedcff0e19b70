import { IntlMessageFormat } from "intl-messageformat";
import { afterEach, expect, test } from "vitest";
import en from "@messages/en/reasons.json";
import fi from "@messages/fi/reasons.json";
import { setReading } from "../shared/i18n/locale";
import { reasonText } from "./reasons";

const outside = { code: "outside_buffer", facts: { error_mm: 4_196, buffer_mm: 1_000, significance_milli: 98_712 } };

afterEach(() => setReading({ locale: "en", lengths: "metric" }));

test("a reason has its figures in every language, and in the user's units", () => {
  expect(reasonText(outside)).toBe("Measured 4.20\u00a0m from the claim, outside 1.00\u00a0m by 98.7 σ.");
  setReading({ locale: "fi" });
  expect(reasonText(outside)).toBe("Mitattu 4,20\u00a0m päähän ilmoituksesta, 1,00\u00a0m puskurin ulkopuolelle, 98,7 σ.");
  setReading({ locale: "en", lengths: "feet" });
  expect(reasonText(outside)).toContain("ft from the claim");
});

test("one range is one range, and a code of a newer contract is said as it is", () => {
  expect(reasonText({ code: "bursts", facts: { ranges: 1 } })).toBe("1 range was left out as a burst of error.");
  expect(reasonText({ code: "something_newer", facts: { a_mm: 1 } })).toBe("something_newer");
});

test("every message can be read as ICU", () => {
  for (const [locale, messages] of Object.entries({ en, fi })) for (const message of Object.values(messages)) expect(() => new IntlMessageFormat(message, locale)).not.toThrow();
});
