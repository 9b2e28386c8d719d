/** Boards as people set them, as the printer is asked for them, and how large their squares came out. Pure. */
import { API } from "../../api/addresses";
import type { Board, BoardKind } from "./choices.svelte";

/** The printed ruler is so long where the printer is right. */
export const RULER_MM = 100;
export const RULER_LEAST_MM = 50;
export const RULER_MOST_MM = 200;
// Beyond which somebody rather measured wrongly, or printed "fit to page".
const UNUSUAL_SHARE = 0.03;

export function spacingOf(board: Board): number {
  return "square_mm" in board ? Number(board.square_mm) : Number(board.spacing_mm);
}

/** What a square of the board measures on paper. */
export function measuredMm(board: Board, rulerMm: number): number {
  return (spacingOf(board) * rulerMm) / RULER_MM;
}

export function isUnusual(rulerMm: number): boolean {
  return Math.abs(rulerMm / RULER_MM - 1) > UNUSUAL_SHARE;
}

/** A board of a kind with so many columns and rows; markers fill three quarters of their square. */
export function boardOf(kind: BoardKind, columns: number, rows: number, spacingMm: number): Board {
  if (kind === "chessboard") return { kind, columns, rows, square_mm: spacingMm };
  if (kind === "charuco") {
    const marker_mm = 0.75 * spacingMm;
    return { kind, columns, rows, square_mm: spacingMm, marker_mm, dictionary: "DICT_4X4_50" };
  }
  return { kind, columns, rows, spacing_mm: spacingMm };
}

/** Where the page to print lies. */
export function printAddress(board: Board, paper: "a4" | "letter", form: "pdf" | "svg" = "pdf"): string {
  const query = new URLSearchParams({
    kind: board.kind,
    columns: String(board.columns),
    rows: String(board.rows),
    spacing_mm: String(spacingOf(board)),
    paper,
  });
  if (board.kind === "charuco") {
    query.set("marker_mm", String(board.marker_mm));
    query.set("dictionary", String(board.dictionary));
  }
  return `${API}/boards/print.${form}?${query}`;
}
