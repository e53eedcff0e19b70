// @vitest-environment happy-dom
import { describe, expect, it } from "vitest";
import { FORMS, initial, type FormName } from "./forms";
import { faults, schemaAt, type Schema } from "./schema";
import { differences, keepable, parsed, put, typedOf, typedTime, type Kind } from "./values";
import { valueWord } from "./words";

const SCHEMA: Schema = {
  type: "object",
  required: ["id", "actions"],
  properties: {
    id: { type: "string", minLength: 1, maxLength: 4, pattern: "^(?:[a-z]+)$" },
    actions: { type: "array", minItems: 1, maxItems: 2, items: { type: "string", enum: ["land", "dock"] } },
    policy: { type: "object", properties: { buffer_mm: { type: "integer", minimum: 100, maximum: 1000 } } },
    sure: { type: "boolean" },
  },
};

describe("when a policy needs a true broadcast", () => {
  it("is a choice of the form, in words", () => {
    expect(FORMS.policy.fields.find(({ path }) => path === "policy.broadcast_required")?.kind).toBe("choice");
    expect(["never", "if_contradicted", "always"].map((each) => valueWord("policy.broadcast_required", each))).toEqual(["never", "where contradicted", "always"]);
    expect(parsed("choice", typedOf("choice", "if_contradicted"))).toEqual({ value: "if_contradicted" });
  });
});

describe("a form's argument", () => {
  it("is checked by the contract's bounds", () => {
    expect(faults(SCHEMA, { id: "ab", actions: ["land"], policy: { buffer_mm: 100 }, sure: true })).toEqual([]);
    const rules = (value: unknown): string[] => faults(SCHEMA, value).map(({ path, rule }) => `${path} ${rule}`);
    expect(rules({})).toEqual(["id required", "actions required"]);
    expect(rules({ id: "", actions: [] })).toEqual(["id required", "actions few"]);
    expect(rules({ id: "abcde", actions: ["fly"] })).toEqual(["id long", "actions[0] choice"]);
    expect(rules({ id: "A1", actions: ["land", "dock", "land"] })).toEqual(["id pattern", "actions many"]);
    expect(rules({ id: "a", actions: ["land"], policy: { buffer_mm: 99 }, more: 1 })).toEqual(["policy.buffer_mm low", "more unknown"]);
    expect(rules({ id: "a", actions: ["land"], policy: { buffer_mm: 1.5 }, sure: "yes" })).toEqual(["policy.buffer_mm type", "sure type"]);
    expect(faults({ type: "string", maxLength: 2 }, "🛸🛸")).toEqual([]);
    expect(rules(null)).toEqual([" type"]);
  });

  it("has its schema by path", () => {
    expect(schemaAt(SCHEMA, "policy.buffer_mm")?.maximum).toBe(1000);
    expect(schemaAt(SCHEMA, "policy.nothing")).toBeUndefined();
  });

  it.each([
    ["metres", "1.5", 1500],
    ["metres", "0,1", 100],
    ["metres", "0.0005", "wrong"],
    ["share", "99", 990_000],
    ["share", "99.9999", 999_999],
    ["degrees", "60.4518", 604_518_000],
    ["degrees", "−22.1234567", -221_234_567],
    ["seconds", "60", 60_000],
    ["integer", "10", 10],
    ["integer", "1e3", "wrong"],
    ["integer", "", "nothing"],
    ["text", "  x ", "x"],
    ["flag", false, false],
    ["actions", [], "nothing"],
    ["time", "soon", "wrong"],
  ] as const)("reads %s %s", (kind, typed, value) => {
    const found = parsed(kind, typed);
    expect(typeof found === "object" ? found.value : found).toEqual(value);
  });

  it("takes a whole registration number without its secret, and keeps none in a draft", () => {
    const read = (typed: string): unknown => parsed("registration", typed);
    expect(read(" FIN87astrdge12k8-xyz ")).toEqual({ value: "FIN87astrdge12k8" });
    expect(read("fin87ASTRDGE12K8-XYZ")).toEqual({ value: "FIN87astrdge12k8" });
    expect(read("FIN87astrdge12k8")).toEqual({ value: "FIN87astrdge12k8" });
    expect(read("GBR-OP-P5MG6X")).toEqual({ value: "GBR-OP-P5MG6X" });
    for (const wrong of ["FIN87astrdge12k8-xya", "FIN87astrdge12k8-x", "FIN87astrdge12k8xyz"]) expect(read(wrong)).toBe("wrong");
    expect(keepable("registration", "FIN87astrdge12k8-xy")).toBe("FIN87astrdge12k8");
  });

  it("shows what it reads", () => {
    const values: [Kind, unknown][] = [["metres", 1500], ["metres", 100], ["share", 990_000], ["share", 10_000], ["degrees", 604_518_000], ["integer", 160], ["integer", 0], ["seconds", 60_000]];
    for (const [kind, value] of values) expect(parsed(kind, typedOf(kind, value))).toEqual({ value });
    const t_ms = new Date(2026, 10, 21, 14, 5).getTime();
    expect(parsed("time", typedTime(t_ms))).toEqual({ value: t_ms });
  });

  it("is put together by path", () => {
    expect(put(put({ pad_id: "*" }, "policy.a", 1), "policy.b", true)).toEqual({ pad_id: "*", policy: { a: 1, b: true } });
  });

  it("begins with something that can be sent", () => {
    const now_ms = new Date(2026, 10, 21, 14, 5).getTime();
    for (const name of Object.keys(FORMS) as FormName[])
      for (const [path, typed] of Object.entries(initial(name, now_ms))) {
        const kind = FORMS[name].fields.find((field) => field.path === path)?.kind ?? "text";
        expect(typeof parsed(kind, typed), `${name} ${path}`).toBe("object");
      }
    expect(initial("maintenance", now_ms)["performed_ms"]).toBe("2026-11-21T14:05");
  });
});

describe("two versions", () => {
  it("differ field by field", () => {
    const before = { a: 1, b: { c: 2, d: [1, 2] }, gone: true };
    const after = { a: 1, b: { c: 3, d: [1, 2] }, new: "x" };
    expect(differences(before, after)).toEqual([
      { path: "b.c", before: 2, after: 3 },
      { path: "gone", before: true, after: undefined },
      { path: "new", before: undefined, after: "x" },
    ]);
    expect(differences(undefined, { a: 1 })).toEqual([{ path: "", before: undefined, after: { a: 1 } }]);
  });
});
