/** Numbers, lengths, times and sizes as people write them, in the language and unit that were chosen. */
import { language, t } from "./i18n/index.svelte";
import { preferences, type Unit } from "./preferences.svelte";

const MM_PER_INCH = 25.4;

export function number(value: number, digits = 0): string {
  // Nothing is not less than nothing.
  const signDisplay = "negative" as const;
  const options = { minimumFractionDigits: digits, maximumFractionDigits: digits, signDisplay };
  return new Intl.NumberFormat(language.locale, options).format(value);
}

/** Few digits of a great number: 1.2M points. */
export function roughly(value: number): string {
  return new Intl.NumberFormat(language.locale, { notation: "compact", maximumSignificantDigits: 3 }).format(
    value,
  );
}

export function percent(share: number): string {
  return new Intl.NumberFormat(language.locale, { style: "percent", maximumFractionDigits: 0 }).format(share);
}

/** Millimetres in the unit that was chosen, with its sign. */
export function length(mm: number, digits = 2): string {
  return preferences.now.unit === "inch"
    ? `${number(mm / MM_PER_INCH, digits + 1)} in`
    : `${number(mm, digits)} mm`;
}

export function fromMm(mm: number, unit: Unit = preferences.now.unit): number {
  return unit === "inch" ? mm / MM_PER_INCH : mm;
}

export function toMm(value: number, unit: Unit = preferences.now.unit): number {
  return unit === "inch" ? value * MM_PER_INCH : value;
}

export function degrees(value: number, digits = 1): string {
  return `${number(value, digits)}°`;
}

const STEPS = ["B", "kB", "MB", "GB", "TB"] as const;

export function size(bytes: number): string {
  let value = bytes;
  let step = 0;
  while (value >= 1000 && step < STEPS.length - 1) {
    value /= 1000;
    step++;
  }
  return `${number(value, step > 0 && value < 10 ? 1 : 0)} ${STEPS[step]}`;
}

/** How long something takes, no more exact than anybody can know it. */
export function duration(seconds: number): string {
  if (seconds < 5) return t("ui.fewSeconds");
  if (seconds < 60)
    return t("ui.seconds", { count: seconds < 20 ? Math.round(seconds) : 5 * Math.round(seconds / 5) });
  const minutes = Math.round(seconds / 60);
  if (minutes < 60) return t("ui.minutes", { count: minutes });
  return t("ui.hours", { hours: Math.floor(minutes / 60), minutes: minutes % 60 });
}

export function moment(iso: string): string {
  const when = new Date(iso);
  const isToday = when.toDateString() === new Date().toDateString();
  const options: Intl.DateTimeFormatOptions = isToday
    ? { timeStyle: "short" }
    : { dateStyle: "medium", timeStyle: "short" };
  return new Intl.DateTimeFormat(language.locale, options).format(when);
}
