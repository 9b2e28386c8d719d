import svelte from "eslint-plugin-svelte";
import ts from "typescript-eslint";

export default ts.config(
  { ignores: ["node_modules", "dist", "src/api/schema.gen.ts"] },
  ...ts.configs.recommended,
  ...svelte.configs.recommended,
  {
    files: ["**/*.svelte", "**/*.svelte.ts"],
    languageOptions: { parserOptions: { parser: ts.parser } },
  },
  {
    rules: {
      // The page has a router of its own, and no base path.
      "svelte/no-navigation-without-resolve": "off",
      "no-restricted-globals": ["error", { name: "fetch", message: "Ask through api/client.ts." }],
      "no-console": "error",
    },
  },
);
