/** What a person chose for this browser; kept here, never on the server. */
export type Theme = "auto" | "dark" | "light";
export type Language = "auto" | "en" | "de";
export type Unit = "mm" | "inch";
export type Quality = "draft" | "normal" | "fine";

export interface Preferences {
  theme: Theme;
  language: Language;
  unit: Unit;
  quality: Quality;
  /** Tell when a long job has ended, where the browser may. */
  notify: boolean;
  /** A tone when a long job has ended or a view of the board was taken. */
  sounds: boolean;
}

const KEY = "turnscan.preferences";
const usual: Preferences = {
  theme: "auto",
  language: "auto",
  unit: "mm",
  quality: "normal",
  notify: false,
  sounds: true,
};

function read(): Preferences {
  try {
    return { ...usual, ...(JSON.parse(localStorage.getItem(KEY) ?? "{}") as Partial<Preferences>) };
  } catch {
    return usual;
  }
}

let chosen = $state.raw<Preferences>(read());
const darkness = matchMedia("(prefers-color-scheme: dark)");
let systemIsDark = $state(darkness.matches);
darkness.addEventListener("change", () => (systemIsDark = darkness.matches));

export const preferences = {
  get now(): Preferences {
    return chosen;
  },
  /** What `auto` comes to. */
  get isDark(): boolean {
    return chosen.theme === "auto" ? systemIsDark : chosen.theme === "dark";
  },
};

/** Whether a browser can tell something beside the page, and was not asked yet; over http in a network it cannot. */
export function mayAskForNotices(): boolean {
  return "Notification" in window && window.isSecureContext && Notification.permission === "default";
}

/** Asks the person, where that is still open; in the handler of a press. Keeps what comes of it. */
export async function allowNotices(): Promise<boolean> {
  const can = "Notification" in window && window.isSecureContext;
  const notify = can && (await Notification.requestPermission()) === "granted";
  prefer({ notify });
  return notify;
}

export function prefer(changes: Partial<Preferences>): void {
  chosen = { ...chosen, ...changes };
  try {
    localStorage.setItem(KEY, JSON.stringify(chosen));
  } catch {
    // A browser that keeps nothing: the choice lasts as long as the page.
  }
}
