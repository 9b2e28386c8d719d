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
  /** A tone when a long job has ended. */
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

export function prefer(changes: Partial<Preferences>): void {
  chosen = { ...chosen, ...changes };
  try {
    localStorage.setItem(KEY, JSON.stringify(chosen));
  } catch {
    // A browser that keeps nothing: the choice lasts as long as the page.
  }
}
