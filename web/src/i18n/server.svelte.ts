/** What the server says in English, in the person's language, as far as the page knows how. */
import type { Problem } from "../api/schema.gen";
import { language, learn, type Tongue } from "./index.svelte";
import { filled, phrased, renumbered, type Sentences, type Values } from "./said";

/** For a Notice: `detail` is the server's own sentence, where the other is more general. */
export interface Said {
  sentence: string;
  hint: string;
  isForeign: boolean;
  detail?: string;
}

let german = $state.raw<Sentences | null>(null);

/** With the page's own sentences of that language. */
export async function learnAll(tongue: Tongue): Promise<void> {
  const [sentences] = await Promise.all([
    tongue === "de" && !german ? import("./server/de.json") : null,
    learn(tongue),
  ]);
  if (sentences) german = sentences.default as unknown as Sentences;
}

const known = () => (language.now === "de" ? german : null);
const written = (value: number) =>
  new Intl.NumberFormat(language.locale, { maximumFractionDigits: Math.abs(value) < 10 ? 3 : 1 }).format(
    value,
  );

/** By its words; null where they are not known. */
const worded = (words: string, { phrases }: Sentences) =>
  phrased(words, phrases, (numbers) => renumbered(numbers, language.locale));

/** A sentence that has no code. */
export function told(sentence: string, hint = ""): Said {
  const sentences = known();
  const said = sentences && worded(sentence, sentences);
  if (said == null) return { sentence, hint, isForeign: language.now !== "en" };
  return { sentence: said, hint: (hint && worded(hint, sentences!)) || hint, isForeign: false };
}

/** What went wrong: in its own words where they are known, or more generally by its code. */
export function toldProblem(problem: { code: string; message: string; hint?: string }): Said {
  const { code, message, hint = "" } = problem;
  const sentences = known();
  const said = sentences?.problems[code];
  const exact = sentences && worded(message, sentences);
  if (exact) {
    const wayOut = (hint && worded(hint, sentences)) || said?.[1];
    if (wayOut !== undefined) return { sentence: exact, hint: wayOut, isForeign: false };
  }
  if (!said) return { sentence: message, hint, isForeign: language.now !== "en" };
  const detail = [/[.!?]$/.test(message) ? message : `${message}.`, hint].filter(Boolean).join(" ");
  return { sentence: said[0], hint: said[1], isForeign: false, detail };
}

export const codeOf = (problem: Problem) => problem.type.replace("turnscan:", "");

interface Finding {
  check: string;
  code?: string;
  sentence: string;
  advice: string;
  numbers: Values;
  values?: Values;
}

/** What the doctor found, by its code. */
export function toldFinding(finding: Finding): Said {
  const { code = "", sentence, advice, check, numbers, values } = finding;
  const sentences = known();
  const said = sentences?.findings[code];
  if (!sentences || !said) return { sentence, hint: advice, isForeign: language.now !== "en" };
  const all = { laser: check.split(".").slice(2).join("."), ...numbers, ...values };
  const wayOut = said[1] ? filled(said[1], all, written) : (worded(advice, sentences) ?? advice);
  const isFailure = code === "checkup.failed";
  return {
    sentence: filled(said[0], all, written),
    hint: wayOut,
    isForeign: false,
    ...(isFailure ? { detail: `${sentence} ${advice}` } : {}),
  };
}
