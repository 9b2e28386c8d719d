import { readdirSync, readFileSync } from "node:fs";
import { parse } from "svelte/compiler";
import { expect, test } from "vitest";
import * as de from "../src/i18n/de";
import * as en from "../src/i18n/en";

type Messages = Record<string, Record<string, unknown>>;

/** Every key with the names that its sentence leaves open. */
function shapes(messages: Messages): string[] {
  return Object.entries(messages)
    .flatMap(([part, entries]) =>
      Object.entries(entries).map(([name, message]) => {
        const forms =
          typeof message === "string"
            ? ""
            : Object.keys(message as object)
                .sort()
                .join();
        const open = [...new Set(JSON.stringify(message).match(/\{\w+\}/g) ?? [])].sort().join();
        return `${part}.${name} ${forms} ${open}`;
      }),
    )
    .sort();
}

test("both languages say the same things, with the same numbers in them", () => {
  expect(shapes(de as unknown as Messages)).toEqual(shapes(en as unknown as Messages));
});

test("no sentence is empty", () => {
  for (const messages of [en, de] as unknown as Messages[]) {
    for (const entries of Object.values(messages)) {
      for (const message of Object.values(entries)) expect(JSON.stringify(message)).not.toMatch(/""/);
    }
  }
});

const components = readdirSync("src", { recursive: true, encoding: "utf8" }).filter((path) =>
  path.endsWith(".svelte"),
);
const SPOKEN = new Set([
  "title",
  "alt",
  "aria-label",
  "placeholder",
  "label",
  "hint",
  "help",
  "sentence",
  "text",
  "summary",
]);
// Names of themselves are the same in every language.
const NAMES = new Set(["Turnscan", "English", "Deutsch"]);

interface Node {
  type: string;
  name?: string;
  data?: string;
  value?: unknown;
}

function bareWords(source: string): string[] {
  const found: string[] = [];
  function keep(text: string | undefined) {
    const words = (text ?? "").replace(/[–—]/g, " ").trim();
    if (/\p{L}{2}/u.test(words) && !NAMES.has(words)) found.push(words);
  }
  function visit(node: unknown) {
    if (Array.isArray(node)) return node.forEach(visit);
    if (!node || typeof node !== "object") return;
    const { type, name, data, value } = node as Node;
    if (type === "Text") return keep(data);
    if (type === "Attribute") {
      // Of other attributes the text is for the machine.
      if (!SPOKEN.has(name ?? "")) return;
      for (const part of Array.isArray(value) ? (value as Node[]) : [])
        if (part.type === "Text") keep(part.data);
      return;
    }
    if (type === "StyleDirective" || type === "ClassDirective") return;
    for (const [key, child] of Object.entries(node)) if (key !== "parent") visit(child);
  }
  visit(parse(source, { modern: true }).fragment);
  return found.filter((words) => !words.startsWith("Turnscan"));
}

test.each(components)("%s says nothing that is not in the message files", (path) => {
  const source = readFileSync(`src/${path}`, "utf8").replace(/– Turnscan/g, "");
  expect(bareWords(source)).toEqual([]);
});
