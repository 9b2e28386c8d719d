/** The calibrations and sessions that the server keeps, as they were read last; no news tell of them. */
import { api, asked } from "../../api/client";
import type { BoardOut } from "../../api/schema.gen";
import type { Calibration, Session } from "./types";

let calibrations = $state.raw<readonly Calibration[] | null>(null);
let removed = $state.raw<readonly Calibration[]>([]);
let sessions = $state.raw<readonly Session[]>([]);
let board = $state.raw<BoardOut | null>(null);

export const kept = {
  /** Newest first; null until they were read. */
  get calibrations(): readonly Calibration[] | null {
    return calibrations;
  },
  /** In the bin. */
  get removed(): readonly Calibration[] {
    return removed;
  },
  get current(): Calibration | undefined {
    return calibrations?.find((each) => each.is_current);
  },
  /** Begun and not ended, newest first. */
  get unfinished(): readonly Session[] {
    return sessions.filter((each) => !each.calibration && !each.problem && each.pictures > 0);
  },
  get board(): BoardOut | null {
    return board;
  },
};

export async function readKept(): Promise<void> {
  const [all, bin, begun] = await Promise.all([
    asked(api.GET("/api/v1/calibrations")),
    asked(api.GET("/api/v1/calibrations", { params: { query: { removed: true } } })),
    asked(api.GET("/api/v1/calibrate/sessions")),
  ]);
  calibrations = all;
  removed = bin;
  sessions = begun;
}

export async function readBoard(): Promise<void> {
  board = await asked(api.GET("/api/v1/boards/board.json"));
}
