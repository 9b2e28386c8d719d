/** What was said to the board, and what it answered; until the page is closed. */
const KEY = "turnscan.console";
const MOST = 100;

export interface Exchange {
  line: string;
  answer: readonly string[];
  isRefusal: boolean;
}

export const said = $state({ exchanges: [] as Exchange[], understood: false });

export function remember(exchange: Exchange): void {
  said.exchanges = [...said.exchanges, exchange].slice(-MOST);
  const lines = [...history().filter((each) => each !== exchange.line), exchange.line].slice(-MOST);
  try {
    sessionStorage.setItem(KEY, JSON.stringify(lines));
  } catch {
    // A browser that keeps nothing.
  }
}

/** Lines that were sent from this tab, the last one last. */
export function history(): string[] {
  try {
    return JSON.parse(sessionStorage.getItem(KEY) ?? "[]") as string[];
  } catch {
    return [];
  }
}
