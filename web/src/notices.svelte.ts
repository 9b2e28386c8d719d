/** What is told at the edge of the page, and the one question that may stand open. */
import { OFFLINE, Refusal } from "./api/client";
import { t } from "./i18n/index.svelte";
import { toldProblem } from "./i18n/server.svelte";

export interface Notice {
  id: number;
  tone: "info" | "success" | "warning" | "danger";
  sentence: string;
  hint?: string;
  /** As the server says it, in English. */
  isForeign?: boolean;
  /** The server's own sentence, in English, where `sentence` is more general. */
  detail?: string;
  action?: { label: string; run: () => void };
}

const SHOWN_MS = 6000;
const SHOWN_WITH_ACTION_MS = 10_000;
/** Longer than the offer to take something back stands. */
export const UNDO_MS = SHOWN_WITH_ACTION_MS + 1000;
const MOST = 4;

let shown = $state.raw<readonly Notice[]>([]);
let spoken = $state("");
let question = $state.raw<Question | null>(null);
let last = 0;

export const notices = {
  get shown(): readonly Notice[] {
    return shown;
  },
  /** For the live region: what a screen reader says next. */
  get spoken(): string {
    return spoken;
  },
  get question(): Question | null {
    return question;
  },
};

/** Shows a notice; it goes by itself, unless something is wrong. */
export function tell(notice: Omit<Notice, "id">): number {
  const id = ++last;
  // What is said again takes the place of what was said.
  const others = shown.filter((each) => each.sentence !== notice.sentence || each.action);
  shown = [...others.slice(1 - MOST), { ...notice, id }];
  if (notice.tone !== "danger") {
    setTimeout(() => dismiss(id), notice.action ? SHOWN_WITH_ACTION_MS : SHOWN_MS);
  }
  return id;
}

export function dismiss(id: number): void {
  shown = shown.filter((each) => each.id !== id);
}

/** Says something to a screen reader only. */
export function announce(words: string): void {
  spoken = "";
  queueMicrotask(() => (spoken = words));
}

/** After something that can be taken back: says it, and offers to. */
export function tellUndo(sentence: string, undo: () => Promise<unknown>): void {
  tell({ tone: "info", sentence, action: { label: t("shell.undo"), run: () => void attempt(undo) } });
}

/** What a refusal or any other error comes to, in words. */
export function wordsOf(error: unknown): Pick<Notice, "sentence" | "hint" | "isForeign" | "detail"> {
  if (error instanceof Refusal) {
    if (error.code === OFFLINE) return { sentence: t("shell.offline"), hint: t("shell.offlineHint") };
    return toldProblem({ code: error.code, message: error.sentence, hint: error.hint });
  }
  return { sentence: t("shell.surprise"), hint: String(error) };
}

/** Does the work; what goes wrong is told as a notice. Returns whether all went well. */
export async function attempt(work: () => Promise<unknown>): Promise<boolean> {
  try {
    await work();
    return true;
  } catch (error) {
    tell({ tone: "danger", ...wordsOf(error) });
    return false;
  }
}

export interface Question {
  title: string;
  text: string;
  yes: string;
  isDangerous?: boolean;
  answer(isYes: boolean): void;
}

/** Asks before something that cannot be taken back: `if (await confirm({...})) ...`. */
export function confirm(asked: Omit<Question, "answer">): Promise<boolean> {
  question?.answer(false);
  return new Promise((resolve) => {
    question = {
      ...asked,
      answer(isYes) {
        question = null;
        resolve(isYes);
      },
    };
  });
}
