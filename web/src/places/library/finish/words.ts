/** What steps and their settings are called; what a newer server has and the page does not know keeps its own name. */
import type { StepKindOut } from "../../../api/schema.gen";
import * as en from "../../../i18n/en";
import { t, type Key } from "../../../i18n/index.svelte";
import { kindOf, type StepDocument } from "./plan";

function known(name: string): Key | null {
  return name in en.finish ? (`finish.${name}` as Key) : null;
}

export function stepName(document: StepDocument): string {
  const key = known(`step-${kindOf(document)}`);
  return key ? t(key) : kindOf(document);
}

export function stepHelp(kind: StepKindOut): string {
  const key = known(`help-${kind.kind}`);
  return key ? t(key) : kind.words;
}

export function settingName(kind: string, name: string): string {
  const key = known(`set-${own(kind, name)}`);
  return key ? t(key) : name;
}

export function settingHelp(kind: string, name: string): string {
  const key = known(`tell-${own(kind, name)}`);
  return key ? t(key) : "";
}

export function choiceName(value: string): string {
  const key = known(`is-${value}`);
  return key ? t(key) : value;
}

/** One name means two things: a quality, and a number of points. */
function own(kind: string, name: string): string {
  return kind === "radius-outliers" && name === "least" ? "least-others" : name;
}
