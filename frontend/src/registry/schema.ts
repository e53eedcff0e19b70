/** The part of JSON Schema that the ledger's records use, so that a form is checked by the contract's own bounds. */
export type Schema = {
  type?: "object" | "array" | "string" | "integer" | "boolean";
  properties?: Readonly<Record<string, Schema>>;
  required?: readonly string[];
  items?: Schema;
  minItems?: number;
  maxItems?: number;
  minimum?: number;
  maximum?: number;
  minLength?: number;
  maxLength?: number;
  pattern?: string;
  enum?: readonly string[];
};

/** What is wrong with one field. `limit` is the bound that it crosses. */
export type Fault = { path: string; rule: "required" | "type" | "low" | "high" | "short" | "long" | "pattern" | "choice" | "few" | "many" | "unknown"; limit?: number };

function kindFits(type: Schema["type"], value: unknown): boolean {
  switch (type) {
    case "object":
      return typeof value === "object" && value !== null && !Array.isArray(value);
    case "array":
      return Array.isArray(value);
    case "integer":
      return Number.isSafeInteger(value);
    case "string":
      return typeof value === "string";
    case "boolean":
      return typeof value === "boolean";
    case undefined:
      return true;
  }
}

function textFaults(schema: Schema, value: string, path: string): Fault[] {
  // The contract counts characters, not UTF-16 units.
  const { length } = Array.from(value);
  if (length < (schema.minLength ?? 0)) return [{ path, rule: length === 0 ? "required" : "short", limit: schema.minLength ?? 0 }];
  if (length > (schema.maxLength ?? Infinity)) return [{ path, rule: "long", limit: schema.maxLength ?? 0 }];
  if (schema.enum !== undefined && !schema.enum.includes(value)) return [{ path, rule: "choice" }];
  if (schema.pattern !== undefined && !new RegExp(schema.pattern, "u").test(value)) return [{ path, rule: "pattern" }];
  return [];
}

/** Everything that is wrong with a value; none where the contract will find nothing wrong with its form. */
export function faults(schema: Schema, value: unknown, path = ""): Fault[] {
  if (!kindFits(schema.type, value)) return [{ path, rule: "type" }];
  if (typeof value === "string") return textFaults(schema, value, path);
  if (typeof value === "number") {
    if (value < (schema.minimum ?? -Infinity)) return [{ path, rule: "low", limit: schema.minimum ?? 0 }];
    return value > (schema.maximum ?? Infinity) ? [{ path, rule: "high", limit: schema.maximum ?? 0 }] : [];
  }
  if (Array.isArray(value)) {
    if (value.length < (schema.minItems ?? 0)) return [{ path, rule: "few", limit: schema.minItems ?? 0 }];
    if (value.length > (schema.maxItems ?? Infinity)) return [{ path, rule: "many", limit: schema.maxItems ?? 0 }];
    return value.flatMap((each, i) => faults(schema.items ?? {}, each, `${path}[${i}]`));
  }
  if (typeof value !== "object" || value === null) return [];
  const prefix = path === "" ? "" : `${path}.`;
  const entries = Object.entries(value);
  const missing = (schema.required ?? []).filter((name) => !(name in value)).map((name): Fault => ({ path: prefix + name, rule: "required" }));
  return [
    ...missing,
    ...entries.flatMap(([name, each]): Fault[] => {
      const inner = schema.properties?.[name];
      return inner === undefined ? [{ path: prefix + name, rule: "unknown" }] : faults(inner, each, prefix + name);
    }),
  ];
}

/** The schema of one field, by its path. */
export function schemaAt(schema: Schema, path: string): Schema | undefined {
  return path.split(".").reduce<Schema | undefined>((at, name) => at?.properties?.[name], schema);
}
