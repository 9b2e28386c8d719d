/** What a person has seen and put away in this browser: ends of calibrations, and interrupted ones. */
const KEY = "turnscan.calibrate.forgotten";
const MOST = 60;

function read(): readonly string[] {
  try {
    return JSON.parse(localStorage.getItem(KEY) ?? "[]") as string[];
  } catch {
    return [];
  }
}

let names = $state.raw(read());

export const forgotten = {
  has(name: string): boolean {
    return names.includes(name);
  },
};

/** The name of a job or a session. */
export function forget(name: string): void {
  if (names.includes(name)) return;
  names = [...names, name].slice(-MOST);
  try {
    localStorage.setItem(KEY, JSON.stringify(names));
  } catch {
    // A browser that keeps nothing.
  }
}
