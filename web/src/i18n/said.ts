/** Sentences of the server in another language: by their code and values, or by their words. Pure. */
export interface Sentences {
  /** By code: the sentence, and what to do. */
  findings: Record<string, [sentence: string, wayOut: string]>;
  problems: Record<string, [sentence: string, wayOut: string]>;
  /** What the server says in words only, `{names}` standing for whatever it puts there. */
  phrases: [english: string, other: string][];
}

export type Values = Record<string, unknown>;

/**
 * The first phrase whose words these are; null where there is none. What it leaves open is looked up as well,
 * within quotation marks too. Of `where: what` the place stays as it is.
 */
export function phrased(
  words: string,
  phrases: Sentences["phrases"],
  rewritten: (numbers: string) => string = String,
): string | null {
  for (const [english, other] of phrases) {
    const found = patternOf(english).exec(words);
    if (!found) continue;
    const values = Object.entries(found.groups ?? {});
    return filled(
      other,
      Object.fromEntries(values.map(([name, value]) => [name, opened(value, phrases, rewritten)])),
    );
  }
  return sentenceBySentence(words, phrases, rewritten) ?? placed(words, phrases, rewritten);
}

function opened(
  value: string,
  phrases: Sentences["phrases"],
  rewritten: (numbers: string) => string,
): string {
  const quoted = /^(['"])(.*)\1$/s.exec(value)?.[2];
  const said = phrased(quoted ?? value, phrases, rewritten);
  return said ?? (quoted === undefined ? rewritten(value) : value);
}

/** Of a device or a file. */
function placed(
  words: string,
  phrases: Sentences["phrases"],
  rewritten: (numbers: string) => string,
): string | null {
  for (const { index } of words.matchAll(/: /g)) {
    const what = phrased(words.slice(index + 2), phrases, rewritten);
    if (what !== null) return words.slice(0, index + 2) + what;
  }
  return null;
}

const NUMBER = /\d{1,3}(?:,\d{3})+(?:\.\d+)?|\d+(?:\.\d+)?/;
const NUMBERS = new RegExp(`^-?(?:${NUMBER.source})(?: x (?:${NUMBER.source}))*(?: ?%)?$`);

/** Numbers as the server writes them, written anew; what is anything else, such as a version, stays. */
export function renumbered(words: string, locale: string): string {
  if (!NUMBERS.test(words)) return words;
  return words.replace(new RegExp(NUMBER.source, "g"), (number) => {
    const digits = number.split(".")[1]?.length ?? 0;
    return new Intl.NumberFormat(locale, {
      minimumFractionDigits: digits,
      maximumFractionDigits: digits,
      // Without it, it may be a port or a year.
      useGrouping: number.includes(","),
    }).format(Number(number.replaceAll(",", "")));
  });
}

function sentenceBySentence(
  words: string,
  phrases: Sentences["phrases"],
  rewritten: (numbers: string) => string,
): string | null {
  const sentences = words.split(/(?<=\.) (?=\p{Lu})/u);
  if (sentences.length < 2) return null;
  const said = sentences.map((sentence) => phrased(sentence, phrases, rewritten));
  return said.every((each) => each !== null) ? said.join(" ") : null;
}

/** Names that the values do not have stay open, so that one sees what is missing. */
export function filled(text: string, values: Values, written: (value: number) => string = String): string {
  return text.replace(/\{(\w+)\}/g, (whole, name: string) => {
    const value = values[name];
    if (value === undefined || value === null) return whole;
    return typeof value === "number" ? written(value) : String(value);
  });
}

const patterns = new Map<string, RegExp>();

function patternOf(english: string): RegExp {
  let pattern = patterns.get(english);
  if (!pattern) {
    const parts = english.split(/(\{\w+\})/).map((part) => {
      const name = /^\{(\w+)\}$/.exec(part)?.[1];
      return name ? `(?<${name}>.+?)` : part.replace(/[.*+?^${}()|[\]\\]/g, "\\$&");
    });
    pattern = new RegExp(`^${parts.join("")}$`, "s");
    patterns.set(english, pattern);
  }
  return pattern;
}
