/** The wishes outlast a visit to another place, and a reload. */
import { preferences, prefer, type Quality } from "../../preferences.svelte";
import { usualWishes, type Wishes } from "./plan";

const KEY = "turnscan.scan";

function read(): Wishes {
  let kept: Partial<Wishes> = {};
  try {
    kept = JSON.parse(localStorage.getItem(KEY) ?? "{}") as Partial<Wishes>;
  } catch {
    // Begins as usual.
  }
  return { ...usualWishes, ...kept, title: "", quality: preferences.now.quality };
}

export const wishes: Wishes = $state(read());

export function keepWishes(): void {
  const rest = { ...wishes, title: "" };
  if (wishes.quality !== preferences.now.quality) prefer({ quality: wishes.quality satisfies Quality });
  try {
    localStorage.setItem(KEY, JSON.stringify(rest));
  } catch {
    // A browser that keeps nothing.
  }
}

export function forgetWishes(): void {
  Object.assign(wishes, usualWishes);
}
