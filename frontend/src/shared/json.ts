const LINE = 110;

/** JSON laid out for reading: what fits stands on one line, and lists of numbers fill theirs. */
export function laidOut(value: unknown, indent = ""): string {
  const flat = JSON.stringify(value);
  if (typeof value !== "object" || value === null || indent.length + flat.length <= LINE) return flat;
  const inner = `${indent}  `;
  if (!Array.isArray(value)) {
    const fields = Object.entries(value).map(([name, each]) => `${inner}${JSON.stringify(name)}: ${laidOut(each, inner)}`);
    return `{\n${fields.join(",\n")}\n${indent}}`;
  }
  const items: unknown[] = value;
  if (!items.every((each) => typeof each === "number")) {
    return `[\n${items.map((each) => inner + laidOut(each, inner)).join(",\n")}\n${indent}]`;
  }
  const lines: string[] = [];
  for (const each of items) {
    const last = lines.at(-1);
    if (last !== undefined && last.length < LINE - 12) lines[lines.length - 1] = `${last}, ${each}`;
    else lines.push(inner + String(each));
  }
  return `[\n${lines.join(",\n")}\n${indent}]`;
}
