/** What a person chose for calibrating; outlasts a visit and a reload, kept in this browser. */
import type { BoardOut, CalibrateIn } from "../../api/schema.gen";

export type Board = BoardOut["board"];
export type BoardKind = Board["kind"];
export type Kind = NonNullable<CalibrateIn["kind"]>;

interface Choices {
  paper: "a4" | "letter";
  /** What the printed ruler of 100 mm measures. */
  rulerMm: number;
  /** In place of the bench's own. */
  board: Board | null;
  vibration: boolean;
  /** On the simulated bench: all goes by itself. */
  byItself: boolean;
}

const KEY = "turnscan.calibrate";
const usual: Choices = {
  paper: "a4",
  rulerMm: 100,
  board: null,
  vibration: true,
  byItself: true,
};

function read(): Choices {
  try {
    return { ...usual, ...(JSON.parse(localStorage.getItem(KEY) ?? "{}") as Partial<Choices>) };
  } catch {
    return usual;
  }
}

let chosen = $state.raw<Choices>(read());

export const choices = {
  get now(): Choices {
    return chosen;
  },
};

export function choose(changes: Partial<Choices>): void {
  chosen = { ...chosen, ...changes };
  try {
    localStorage.setItem(KEY, JSON.stringify(chosen));
  } catch {
    // A browser that keeps nothing: the choice lasts as long as the page.
  }
}
