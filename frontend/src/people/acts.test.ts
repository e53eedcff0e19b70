import { afterEach, describe, expect, it } from "vitest";
import { LOCALES, setReading } from "../shared/i18n/locale";
import { ACTS, actOf, actsByName } from "./acts";
import { auditTexts } from "./texts";

afterEach(() => setReading({ locale: "en" }));

describe("acts in the audit log", () => {
  it.each(LOCALES)("have each a name of its own (%s)", (locale) => {
    setReading({ locale });
    const names = ACTS.map((act) => auditTexts("name", { act, plain: "" }));
    expect(ACTS.filter((_, i) => names[i] === "")).toEqual([]);
    expect(new Set(names).size).toBe(ACTS.length);
    expect(actsByName()).toHaveLength(ACTS.length);
  });

  it("are known by their own names only", () => {
    expect(actOf("RegisterPad")).toBe("RegisterPad");
    expect(actOf("drop_table")).toBeUndefined();
  });
});
