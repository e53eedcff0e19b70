// @ts-check
import { readdirSync } from "node:fs";
import { join } from "node:path";
import { createNodeResolver, importX } from "eslint-plugin-import-x";
import jsxA11y from "eslint-plugin-jsx-a11y";
import reactHooks from "eslint-plugin-react-hooks";
import globals from "globals";
import tseslint from "typescript-eslint";

/**
 * The floors of `src/`, the lowest first: what is in a folder imports from that folder and from the floors below, from
 * no floor above and from no neighbour. `main.tsx` stands on top of all.
 */
const FLOORS = [
  ["shared"],
  ["map"],
  ["networked", "people", "plans", "zones"],
  ["sessions"],
  ["alerts", "desk"],
  ["ledger", "live-map", "registry", "replay", "settings", "statistics", "verdicts"],
  ["app"],
];

const homeless = readdirSync(join(import.meta.dirname, "src"), { withFileTypes: true }).filter((each) => each.isDirectory() && !FLOORS.flat().includes(each.name));
if (homeless.length > 0) throw new Error(`on no floor (FLOORS in eslint.config.js): ${homeless.map(({ name }) => name).join(", ")}`);

/** For each folder everything that it may not import. */
const zones = FLOORS.flat().map((folder) => ({
  target: `src/${folder}`,
  from: "src",
  except: [folder, ...FLOORS.slice(0, FLOORS.findIndex((floor) => floor.includes(folder))).flat()],
  message: `src/${folder} imports from itself and from the floors below (FLOORS in eslint.config.js).`,
}));

export default tseslint.config(
  { ignores: ["dist", "dist-fake", "node_modules", "src/shared/api/schema.d.ts"] },
  ...tseslint.configs.strictTypeChecked,
  ...tseslint.configs.stylisticTypeChecked,
  {
    languageOptions: {
      globals: { ...globals.browser },
      parserOptions: { project: ["./tsconfig.app.json", "./tsconfig.node.json"], tsconfigRootDir: import.meta.dirname },
    },
    rules: {
      "@typescript-eslint/no-unused-vars": ["error", { varsIgnorePattern: "^_", argsIgnorePattern: "^_", ignoreRestSiblings: true }],
      "@typescript-eslint/consistent-type-definitions": ["error", "type"],
      "@typescript-eslint/consistent-type-imports": "error",
      "@typescript-eslint/restrict-template-expressions": ["error", { allowNumber: true }],
      "@typescript-eslint/no-confusing-void-expression": ["error", { ignoreArrowShorthand: true }],
      "@typescript-eslint/switch-exhaustiveness-check": "error",
      eqeqeq: "error",
      "no-console": "error",
    },
  },
  {
    files: ["src/**/*.tsx"],
    plugins: { "react-hooks": reactHooks, "jsx-a11y": jsxA11y },
    rules: { ...reactHooks.configs.recommended.rules, ...jsxA11y.configs.strict.rules },
  },
  {
    files: ["src/**/*.{ts,tsx}"],
    plugins: { "import-x": importX },
    settings: { "import-x/resolver-next": [createNodeResolver({ extensions: [".ts", ".tsx", ".d.ts"] })] },
    rules: { "import-x/no-restricted-paths": ["error", { basePath: import.meta.dirname, zones }] },
  },
  {
    files: ["scripts/**/*.mjs", "eslint.config.js"],
    ...tseslint.configs.disableTypeChecked,
    languageOptions: { globals: { ...globals.node } },
  },
);
