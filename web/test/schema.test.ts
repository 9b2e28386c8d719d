// @vitest-environment node
import { execFileSync } from "node:child_process";
import { mkdtempSync, readFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { expect, test } from "vitest";

test("the types are those of the API's description", { timeout: 60_000 }, () => {
  const { scripts } = JSON.parse(readFileSync("package.json", "utf8")) as { scripts: { types: string } };
  const made = join(mkdtempSync(join(tmpdir(), "types-")), "schema.ts");
  const words = scripts.types.replace("src/api/schema.gen.ts", made).split(" ");
  execFileSync(`node_modules/.bin/${words[0]}`, words.slice(1), { stdio: "ignore" });
  expect(readFileSync("src/api/schema.gen.ts", "utf8"), "run `make api`").toBe(readFileSync(made, "utf8"));
});
