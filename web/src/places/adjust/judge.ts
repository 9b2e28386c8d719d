/** What the numbers of a live picture mean, and scales for the hand. Pure. */
import type { Use } from "../../api/schema.gen";

export type Verdict = "none" | "good" | "dark" | "bright" | "clipped";

const WHITE_BINS = 2;
const LASER_MOST_WHITE = 0.02;
const LASER_MOST_LIGHT = 0.45;
const SCENE_MOST_WHITE = 0.05;
const SCENE_LEAST_LIGHT = 0.16;

/** Mean brightness of a histogram, 0 to 1. */
export function brightness(histogram: readonly number[]): number {
  return histogram.reduce((sum, share, bin) => sum + (share * (bin + 0.5)) / histogram.length, 0);
}

/** For lasers the room should be dark; for texture and board it should be lit, but hardly anything white. */
export function judgeLight(histogram: readonly number[], use: Use): Verdict {
  if (!histogram.length) return "none";
  const white = histogram.slice(-WHITE_BINS).reduce((sum, share) => sum + share, 0);
  const light = brightness(histogram);
  if (use === "laser")
    return white > LASER_MOST_WHITE ? "clipped" : light > LASER_MOST_LIGHT ? "bright" : "good";
  return white > SCENE_MOST_WHITE ? "clipped" : light < SCENE_LEAST_LIGHT ? "dark" : "good";
}

export type StripeVerdict = "none" | "good" | "look" | "bad";
/** As the search for an exposure has it. */
export const MOST_CLIPPED = 0.02;
const FAR_TOO_MUCH = 0.15;

export function judgeStripe(points: number, saturated: number): StripeVerdict {
  if (!points) return "none";
  const share = saturated / points;
  return share < MOST_CLIPPED ? "good" : share < FAR_TOO_MUCH ? "look" : "bad";
}

/** Equal steps of the hand are equal factors: a place from 0 to 1 on a scale from lowest to highest. */
export function placeOf(value: number, lowest: number, highest: number): number {
  const from = Math.max(lowest, 1);
  if (highest <= from) return 0;
  return Math.min(1, Math.max(0, Math.log(value / from) / Math.log(highest / from)));
}

export function valueAt(place: number, lowest: number, highest: number): number {
  if (place >= 1) return highest;
  const from = Math.max(lowest, 1);
  const value = from * (highest / from) ** place;
  const rough = 10 ** Math.max(0, Math.floor(Math.log10(value)) - 2);
  return Math.min(highest, Math.max(lowest, Math.round(value / rough) * rough));
}

export type Corner = [u: number, v: number];
export const usualRegion: readonly Corner[] = [
  [0.2, 0.1],
  [0.8, 0.1],
  [0.8, 0.9],
  [0.2, 0.9],
];
export const FEWEST_CORNERS = 3;

const inside = (share: number) => Math.min(1, Math.max(0, Math.round(share * 1e4) / 1e4));

export function withCorner(corners: readonly Corner[], at: number, [u, v]: Corner): Corner[] {
  return corners.map((corner, index) => (index === at ? [inside(u), inside(v)] : corner));
}

/** One more, halfway between a corner and the next. */
export function withOneMore(corners: readonly Corner[], after: number): Corner[] {
  const [a, b] = [corners[after]!, corners[(after + 1) % corners.length]!];
  const middle: Corner = [inside((a[0] + b[0]) / 2), inside((a[1] + b[1]) / 2)];
  return [...corners.slice(0, after + 1), middle, ...corners.slice(after + 1)];
}

export function withoutCorner(corners: readonly Corner[], at: number): Corner[] {
  return corners.length > FEWEST_CORNERS ? corners.filter((_, index) => index !== at) : [...corners];
}
