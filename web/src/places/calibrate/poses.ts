/** Where a board is drawn to show what to do with it. Pure; in a picture of 200 x 140. */
import type { Pose } from "./wording";

export type Corners = readonly [Point, Point, Point, Point];
export type Point = readonly [x: number, y: number];

const WIDE = 200;
const HIGH = 140;

export function upright(middle: Point, wide: number): Corners {
  const [x, y] = middle;
  const [a, b] = [wide / 2, wide / 3];
  return [
    [x - a, y - b],
    [x + a, y - b],
    [x + a, y + b],
    [x - a, y + b],
  ];
}

/** A board of which one side is further away: that side is shorter. */
export function tilted(side: "top" | "bottom" | "left" | "right"): Corners {
  const [left, right, top, bottom] = [44, 156, 32, 108];
  const [away, near] = [16, 8];
  switch (side) {
    case "top":
      return [
        [left + away, top + 12],
        [right - away, top + 12],
        [right + near, bottom],
        [left - near, bottom],
      ];
    case "bottom":
      return [
        [left - near, top],
        [right + near, top],
        [right - away, bottom - 12],
        [left + away, bottom - 12],
      ];
    case "left":
      return [
        [left + 18, top + 12],
        [right, top - near],
        [right, bottom + near],
        [left + 18, bottom - 12],
      ];
    case "right":
      return [
        [left, top - near],
        [right - 18, top + 12],
        [right - 18, bottom - 12],
        [left, bottom + near],
      ];
  }
}

/** The dark squares of a board of 6 x 4 with these corners. */
export function squares(corners: Corners): string {
  const [columns, rows] = [6, 4];
  const paths: string[] = [];
  for (let row = 0; row < rows; row++) {
    for (let column = row % 2; column < columns; column += 2) {
      const at = (c: number, r: number) => between(corners, c / columns, r / rows);
      const around = [at(column, row), at(column + 1, row), at(column + 1, row + 1), at(column, row + 1)];
      paths.push(`M${around.map((point) => point.map((each) => each.toFixed(1)).join(" ")).join("L")}z`);
    }
  }
  return paths.join("");
}

export function outline(corners: readonly Point[]): string {
  return corners.map((point) => point.join(",")).join(" ");
}

function between([a, b, c, d]: Corners, u: number, v: number): Point {
  const mix = (at: 0 | 1) => (1 - v) * ((1 - u) * a[at] + u * b[at]) + v * ((1 - u) * d[at] + u * c[at]);
  return [mix(0), mix(1)];
}

/** The middle of the ninth of the picture that a board is to be moved to; undefined for other poses. */
export function ninth(pose: Pose): Point | undefined {
  if (!pose.startsWith("move-") || pose === "move-nearer" || pose === "move-further") return undefined;
  const x = pose.endsWith("left") ? 52 : pose.endsWith("right") ? WIDE - 52 : WIDE / 2;
  const y = pose.includes("top") ? 38 : pose.includes("bottom") ? HIGH - 38 : HIGH / 2;
  return [x, y];
}
