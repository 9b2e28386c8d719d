/** What is wanted of a scan, from a quality or from every setting by itself. */
import type { LiveOut, ScanIn, TableOut } from "../../api/schema.gen";
import type { Quality } from "../../preferences.svelte";

export type Colours = "none" | "dark" | "texture";
/** How the table comes to turn. */
export type Way = "step" | "continuous" | "hand";

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
  together: boolean;
  withDark: boolean;
  colours: Colours;
  /** None for the one exposure that the camera has for the laser. */
  exposuresMs: readonly number[];
  /** The line is found as it is under Adjust. */
  asAdjusted: boolean;
  /** About the axis and above the table; otherwise as the calibration suggests. */
  hasLimits: boolean;
  radiusMm: number;
  aboveMm: number;
  belowMm: number;
}

interface Pace {
  steps: number;
  secondsPerTurn: number;
  /** Where a person turns the table. */
  stopsByHand: number;
}

export const qualities: Record<Quality, Pace> = {
  draft: { steps: 60, secondsPerTurn: 15, stopsByHand: 12 },
  normal: { steps: 200, secondsPerTurn: 30, stopsByHand: 24 },
  fine: { steps: 400, secondsPerTurn: 60, stopsByHand: 36 },
};

export const usualWishes: Omit<Wishes, "title" | "quality"> = {
  mode: "step",
  steps: 0,
  secondsPerTurn: 0,
  turnDeg: 360,
  without: [],
  together: false,
  withDark: true,
  colours: "dark",
  exposuresMs: [],
  asAdjusted: true,
  hasLimits: false,
  radiusMm: 100,
  aboveMm: 0,
  belowMm: 200,
};

export const MOST_EXPOSURES = 4;
// Texture is smooth from one of its pictures to the next.
const TEXTURE_EVERY = 4;

/** What a table can do; before it is known, what most can. */
export function waysOf(
  table: Pick<TableOut, "driver" | "turns_by_itself" | "can_turn_steadily"> | null,
): Way[] {
  if (!table) return ["step", "continuous"];
  if (table.driver === "manual") return table.turns_by_itself ? ["continuous"] : ["hand"];
  return table.can_turn_steadily ? ["step", "continuous"] : ["step"];
}

export function wayOf(wishes: Wishes, ways: readonly Way[]): Way {
  return ways.includes(wishes.mode) ? wishes.mode : ways[0]!;
}

export function stepsOf(wishes: Wishes, way: Way = "step"): number {
  const { steps, stopsByHand } = qualities[wishes.quality];
  return wishes.steps || (way === "hand" ? stopsByHand : steps);
}

export function secondsOf(wishes: Wishes): number {
  return wishes.secondsPerTurn || qualities[wishes.quality].secondsPerTurn;
}

/** Whether anything but title and quality is not as usual. */
export function isUsual(wishes: Wishes): boolean {
  const keys = Object.keys(usualWishes) as (keyof typeof usualWishes)[];
  return keys.every((key) => String(wishes[key]) === String(usualWishes[key]));
}

type Adjusted = Pick<LiveOut, "detector" | "threshold" | "channel" | "polygon">;

/** The order as the server takes it. */
export function orderOf(
  wishes: Wishes,
  lasers: readonly string[],
  way: Way = wishes.mode,
  adjusted: Adjusted | null = null,
): ScanIn {
  const inSteps = way !== "continuous";
  const used = lasers.filter((laser) => !wishes.without.includes(laser));
  return {
    title: wishes.title.trim() || "Scan",
    mode: inSteps ? "step" : "continuous",
    steps: stepsOf(wishes, way),
    seconds_per_turn: secondsOf(wishes),
    turn_deg: wishes.turnDeg,
    lasers: used,
    together: wishes.together && used.length > 1,
    with_dark: wishes.withDark,
    with_colour: wishes.colours !== "none",
    texture_every: inSteps && wishes.colours === "texture" ? TEXTURE_EVERY : 0,
    exposures_us: inSteps ? [...new Set(wishes.exposuresMs)].map((ms) => 1000 * ms) : [],
    ...(wishes.hasLimits
      ? { radius_mm: wishes.radiusMm, above_mm: wishes.aboveMm, below_mm: wishes.belowMm }
      : {}),
    ...(adjusted?.polygon.length ? { polygon: adjusted.polygon as [number, number][] } : {}),
    ...(adjusted && wishes.asAdjusted ? findingOf(adjusted) : {}),
  };
}

function findingOf({ detector, threshold, channel }: Adjusted): Partial<ScanIn> {
  // A scan compares with its own pictures without laser, and looks for each laser in its colour.
  const own = !channel || channel === "difference";
  return {
    detector,
    threshold: threshold ?? null,
    channel: own ? null : (channel as ScanIn["channel"]),
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
