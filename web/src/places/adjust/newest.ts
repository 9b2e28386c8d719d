/** For a hand that moves faster than the scanner: sends one after the other, and of those that wait the newest. */
export function newestWins<T>(send: (value: T) => Promise<unknown>): (value: T) => Promise<void> {
  let waiting: { value: T } | null = null;
  let isSending = false;
  return async (value) => {
    waiting = { value };
    if (isSending) return;
    isSending = true;
    try {
      while (waiting) {
        const next: T = waiting.value;
        waiting = null;
        await send(next);
      }
    } finally {
      isSending = false;
    }
  };
}
