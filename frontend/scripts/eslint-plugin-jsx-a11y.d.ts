/** The plugin brings no types of its own; eslint.config.js reads its strict rules only. */
declare module "eslint-plugin-jsx-a11y" {
  import type { Linter, ESLint } from "eslint";

  const plugin: ESLint.Plugin & { configs: { strict: { rules: Linter.RulesRecord } } };
  export default plugin;
}
