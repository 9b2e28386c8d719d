/** Sentences by key, in the person's language. One file per part of the page: `en/scan.json` holds `scan.*`. */
import { preferences } from "../preferences.svelte";
import * as en from "./en";
import type { Forms, Key } from "./keys";

export type { Key } from "./keys";
export type Tongue = "en" | "de";
type Messages = Record<string, Record<string, string | Forms>>;
export type Values = Record<string, string | number>;

const load: Record<Exclude<Tongue, "en">, () => Promise<Messages>> = { de: () => import("./de") };
let loaded = $state.raw<Partial<Record<Tongue, Messages>>>({ en });

/** The language that is meant, whether or not its sentences are here yet. */
export function wantedTongue(): Tongue {
  const chosen = preferences.now.language;
  if (chosen !== "auto") return chosen;
  return navigator.languages.some((each, index) => index === 0 && each.toLowerCase().startsWith("de"))
    ? "de"
    : "en";
}

export const language = {
  /** The language that is shown. */
  get now(): Tongue {
    const wanted = wantedTongue();
    return loaded[wanted] ? wanted : "en";
  },
  /** For numbers and dates; of English the spelling that the browser is set to. */
  get locale(): string {
    const own = navigator.languages.find((each) => each.startsWith(this.now));
    return own ?? this.now;
  },
};

/** Fetches the sentences of a language; English is always there. */
export async function learn(tongue: Tongue): Promise<void> {
  if (loaded[tongue] || tongue === "en") return;
  const messages = await load[tongue]();
  loaded = { ...loaded, [tongue]: messages };
}

/** The sentence, its `{names}` filled in; where it has forms, `count` chooses among them. */
export function t(key: Key, values: Values = {}): string {
  const [part = "", name = ""] = key.split(".", 2);
  const tongue = language.now;
  const message = loaded[tongue]?.[part]?.[name] ?? (en as Messages)[part]?.[name] ?? key;
  return fill(formOf(message, values, tongue), values);
}

function formOf(message: string | Forms, values: Values, tongue: Tongue): string {
  if (typeof message === "string") return message;
  const rule = new Intl.PluralRules(tongue).select(Number(values.count));
  return rule === "one" ? message.one : message.other;
}

function fill(text: string, values: Values): string {
  return text.replace(/\{(\w+)\}/g, (whole, name: string) => {
    const value = values[name];
    return value === undefined ? whole : typeof value === "number" ? count(value) : value;
  });
}

function count(value: number): string {
  return new Intl.NumberFormat(language.locale).format(value);
}
