/** What is wanted of a scan, from a quality or from every setting by itself. */
import type { ScanIn } from "../../api/schema.gen";
import type { Quality } from "../../preferences.svelte";

export interface Wishes {
  title: string;
  quality: Quality;
  mode: "step" | "continuous";
  /** Set by hand; 0 takes those of the quality. */
  steps: number;
  secondsPerTurn: number;
  turnDeg: number;
  /** Those that are left out. */
  without: readonly string[];
  withDark: boolean;
}

export const qualities: Record<Quality, { steps: number; secondsPerTurn: number }> = {
  draft: { steps: 60, secondsPerTurn: 15 },
  normal: { steps: 200, secondsPerTurn: 30 },
  fine: { steps: 400, secondsPerTurn: 60 },
};

export const usualWishes: Omit<Wishes, "title" | "quality"> = {
  mode: "step",
  steps: 0,
  secondsPerTurn: 0,
  turnDeg: 360,
  without: [],
  withDark: true,
};

export function stepsOf(wishes: Wishes): number {
  return wishes.steps || qualities[wishes.quality].steps;
}

export function secondsOf(wishes: Wishes): number {
  return wishes.secondsPerTurn || qualities[wishes.quality].secondsPerTurn;
}

/** Whether anything but title and quality is not as usual. */
export function isUsual(wishes: Wishes): boolean {
  const keys = Object.keys(usualWishes) as (keyof typeof usualWishes)[];
  return keys.every((key) => String(wishes[key]) === String(usualWishes[key]));
}

/** The order as the server takes it. */
export function orderOf(wishes: Wishes, lasers: readonly string[]): ScanIn {
  return {
    title: wishes.title.trim() || "Scan",
    mode: wishes.mode,
    steps: stepsOf(wishes),
    seconds_per_turn: secondsOf(wishes),
    turn_deg: wishes.turnDeg,
    lasers: lasers.filter((laser) => !wishes.without.includes(laser)),
    with_dark: wishes.withDark,
  };
}

/** "Mug", "Mug 2", "Mug 3": a title that is not taken yet. */
export function freeTitle(wanted: string, taken: readonly string[]): string {
  const stem = wanted.replace(/ \d+$/, "");
  for (let count = 1; ; count++) {
    const title = count === 1 ? stem : `${stem} ${count}`;
    if (!taken.includes(title)) return title;
  }
}
