/** What the server names by a code, as a key of the message files. Pure; what has no key is said in its own words. */
import type { CalibrationState, Instruction, Step, ViewState } from "../../api/schema.gen";
import type { Key } from "../../i18n/index.svelte";

const INSTRUCTIONS = [
  "show-board",
  "tilt-top",
  "tilt-bottom",
  "tilt-left",
  "tilt-right",
  "move-top-left",
  "move-top",
  "move-top-right",
  "move-left",
  "move-middle",
  "move-right",
  "move-bottom-left",
  "move-bottom",
  "move-bottom-right",
  "move-nearer",
  "move-further",
  "another-way",
  "hold-board",
  "show-lasers",
  "place-board",
  "place-board-again",
  "clear-table",
  "device-away",
  "done",
] as const;

export type Pose = (typeof INSTRUCTIONS)[number] | "wait";

/** What to do, by its code; undefined for one that this page does not know. */
export function poseOf(instruction: Instruction): Pose | undefined {
  if (instruction.code === "wait") return "wait";
  return INSTRUCTIONS.find((each) => each === instruction.code);
}

/** The key of what to do now: of the code, or of what the scanner does by itself meanwhile. */
export function instructionKey(state: CalibrationState): Key | undefined {
  const pose = poseOf(state.instruction);
  if (pose !== "wait") return pose && `calibrate.do-${pose}`;
  if (state.step === "board" || state.step === "proof") {
    return isSearching(state) ? "calibrate.doing-search" : `calibrate.doing-${state.step}`;
  }
  return `calibrate.doing-${state.step}`;
}

/** Whether the table still turns to and fro to find the board. */
function isSearching(state: CalibrationState): boolean {
  return state.step === "board" && state.done === 0;
}

/** Steps as people count them: computing and proving are one. */
export function shownSteps(state: Pick<CalibrationState, "steps">): Step[] {
  return state.steps.filter((step) => step !== "proving" && step !== "done");
}

/** Which of the shown steps is on; their number when all are over. */
export function stepNumber(state: Pick<CalibrationState, "steps" | "step">): number {
  const steps = shownSteps(state);
  if (state.step === "done") return steps.length;
  return steps.indexOf(state.step === "proving" ? "solving" : state.step);
}

/** Steps that can be done again by themselves. */
export function redoable(state: Pick<CalibrationState, "steps" | "step">): Step[] {
  const steps = shownSteps(state);
  return steps.filter((step, index) => index <= stepNumber(state) && step !== "solving");
}

const REASONS: Record<string, Key> = {
  "struck out by hand": "calibrate.reasonByHand",
  "to be taken again": "calibrate.reasonAgain",
};

/** Why a view is left out, where it is one of the usual reasons. */
export function reasonKey(view: Pick<ViewState, "reason">): Key | undefined {
  return REASONS[view.reason];
}

const FINDINGS = ["expected", "surface", "size", "axis", "wobble", "turning", "lasers"] as const;
export type FindingName = (typeof FINDINGS)[number];

export function findingName(name: string): FindingName | undefined {
  return FINDINGS.find((each) => each === name);
}

const METHODS = ["joint", "paper", "camera only", "opencv", "horus", "fabscanpi"] as const;

/** How a calibration was found, where it is one of the usual ways. */
export function methodKey(method: string): Key | undefined {
  const known = METHODS.find((each) => method.toLowerCase().startsWith(each));
  return known && `calibrate.method-${known}`;
}
