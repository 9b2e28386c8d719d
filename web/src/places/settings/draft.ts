/** A bench that is being chosen, and what still lacks of it. Pure. */
import type { ChoiceIn, PresetOut } from "../../api/schema.gen";

export type Board = ChoiceIn["board"];
export type Camera = ChoiceIn["camera"];
export type Colour = "red" | "green" | "blue" | "any";

export interface DraftLaser {
  name: string;
  channel: number;
  colour: Colour;
}

export interface Draft {
  /** Of a preset, or `own`. */
  preset: string;
  name: string;
  board: Board;
  port: string;
  baud: number;
  camera: Camera;
  device: string;
  direction: "ccw" | "cw";
  rotation: 0 | 90 | 180 | 270;
  mirror: boolean;
  /** None: as usual for the board. */
  lasers: DraftLaser[];
}

export const BOARDS: readonly Board[] = [
  "horus",
  "fabscan",
  "fabscan100",
  "grbl",
  "marlin",
  "sardauscan",
  "manual",
  "simulated",
];
export const CAMERAS: readonly Camera[] = ["uvc", "picamera", "url", "simulated"];

export const emptyDraft: Draft = {
  preset: "",
  name: "",
  board: "grbl",
  port: "",
  baud: 0,
  camera: "uvc",
  device: "",
  direction: "ccw",
  rotation: 0,
  mirror: false,
  lasers: [],
};

export function withPreset(draft: Draft, preset: PresetOut): Draft {
  return { ...draft, preset: preset.name, board: preset.board, camera: preset.camera, lasers: [] };
}

export const needsPort = (board: Board) => board !== "manual" && board !== "simulated";
export const needsDevice = (camera: Camera) => camera === "uvc" || camera === "url";

/** What has to be chosen before it can be saved; empty when nothing. */
export function lacks(draft: Draft): "preset" | "port" | "device" | "" {
  if (!draft.preset) return "preset";
  if (needsDevice(draft.camera) && !draft.device.trim()) return "device";
  return needsPort(draft.board) && !draft.port ? "port" : "";
}

export function choiceOf(draft: Draft, usualName: string): ChoiceIn {
  return {
    name: draft.name.trim() || usualName,
    board: draft.board,
    camera: draft.camera,
    direction: draft.direction,
    rotation: draft.rotation,
    mirror: draft.mirror,
    lasers: draft.lasers,
    ...(needsPort(draft.board) ? { port: draft.port } : {}),
    ...(needsPort(draft.board) && draft.baud ? { baud: draft.baud } : {}),
    ...(needsDevice(draft.camera) ? { device: draft.device.trim() } : {}),
  };
}

/** After the wrong one lit: the two exchange their outputs. */
export function exchanged(lasers: readonly DraftLaser[], meant: string, lit: string): DraftLaser[] {
  const channel = (name: string) => lasers.find((each) => each.name === name)?.channel;
  return lasers.map((each) => {
    const other = each.name === meant ? channel(lit) : each.name === lit ? channel(meant) : undefined;
    return other === undefined ? each : { ...each, channel: other };
  });
}
