/** A value that is changed by hand: every change can be taken back, and taken back again. */

export interface History<T> {
  readonly past: readonly T[];
  readonly now: T;
  readonly future: readonly T[];
  /** What the newest change was of; more of the same, such as typing on, is one change. */
  readonly of: string;
}

const MOST = 100;

export function begun<T>(now: T): History<T> {
  return { past: [], now, future: [], of: "" };
}

/** With another value; `of` names what was changed, where several changes of it shall be one. */
export function changed<T>(history: History<T>, now: T, of = ""): History<T> {
  const isMore = of !== "" && of === history.of;
  const past = isMore ? history.past : [...history.past, history.now].slice(-MOST);
  return { past, now, future: [], of };
}

export function undone<T>(history: History<T>): History<T> {
  const before = history.past.at(-1);
  if (before === undefined) return history;
  const future = [history.now, ...history.future];
  return { past: history.past.slice(0, -1), now: before, future, of: "" };
}

export function redone<T>(history: History<T>): History<T> {
  const after = history.future[0];
  if (after === undefined) return history;
  return { past: [...history.past, history.now], now: after, future: history.future.slice(1), of: "" };
}
