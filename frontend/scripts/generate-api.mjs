// Writes src/shared/api/schema.d.ts, the types of the backend's interface: before every build, lint and type check, and
// only where a source of the backend is another than the last time. The OpenAPI document is that of
// `wonderland backend openapi`, or where there is no Python (Dockerfile) in the file that OPENAPI names.
import { execFileSync } from "node:child_process";
import { createHash } from "node:crypto";
import { existsSync, mkdirSync, readdirSync, readFileSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const frontend = join(dirname(fileURLToPath(import.meta.url)), "..");
const root = join(frontend, "..");
const types = join(frontend, "src/shared/api/schema.d.ts");
const stamp = join(frontend, "node_modules/.cache/openapi-sources");
/** What describes no interface, though it may hold Python or JSON. */
const ELSEWHERE = ["frontend", "tests", "docs", "scripts", "node_modules", "__pycache__"];

/**
 * Whatever may change the document: all Python and messages beside the console, and the versions of the libraries.
 * @returns {Generator<string>}
 */
function* sources(directory = root) {
  for (const entry of readdirSync(directory, { withFileTypes: true }).sort((a, b) => (a.name < b.name ? -1 : 1))) {
    const path = join(directory, entry.name);
    if (entry.isDirectory()) {
      if (!entry.name.startsWith(".") && !ELSEWHERE.includes(entry.name)) yield* sources(path);
    } else if (/\.(py|json)$|^dev\.txt$/.test(entry.name)) yield path;
  }
}

function fingerprint() {
  const hash = createHash("sha256").update(readFileSync(fileURLToPath(import.meta.url)));
  for (const path of sources()) hash.update(path.slice(root.length)).update(readFileSync(path));
  return hash.digest("hex");
}

function document() {
  if (process.env.OPENAPI !== undefined) return readFileSync(process.env.OPENAPI, "utf8");
  const local = join(root, ".venv/bin/wonderland");
  const program = process.env.WONDERLAND ?? (existsSync(local) ? local : "wonderland");
  return execFileSync(program, ["backend", "openapi"], { encoding: "utf8", maxBuffer: 64 << 20 });
}

const now = fingerprint();
if (!existsSync(types) || !existsSync(stamp) || readFileSync(stamp, "utf8") !== now) {
  const text = document();
  const hash = createHash("sha256").update(text.trimEnd()).digest("hex");
  const first = `// Generated from the OpenAPI document with SHA-256 ${hash}. Do not edit.\n`;
  if (!existsSync(types) || !readFileSync(types, "utf8").startsWith(first)) {
    const { default: openapiTS, astToString } = await import("openapi-typescript");
    writeFileSync(types, `${first}\n${astToString(await openapiTS(JSON.parse(text)))}`);
  }
  mkdirSync(dirname(stamp), { recursive: true });
  writeFileSync(stamp, now);
}
