/** Paths to places: `/library/mug` is the place `library` with the rest `mug`. */
import { tick } from "svelte";

export const PLACES = ["scan", "adjust", "calibrate", "library", "settings"] as const;
export type PlaceName = (typeof PLACES)[number] | "kit" | "lost";

export interface Route {
  place: PlaceName;
  /** What follows the place in the path, decoded. */
  rest: string[];
  query: URLSearchParams;
}

const HOME = "/scan";

export function parse(url: URL): Route {
  const [place = "", ...rest] = url.pathname.split("/").filter(Boolean).map(decodeURIComponent);
  // First set-up is a part of the settings with an address of its own.
  if (place === "setup") return { place: "settings", rest: ["setup", ...rest], query: url.searchParams };
  const isKnown = (PLACES as readonly string[]).includes(place) || (place === "kit" && import.meta.env.DEV);
  return { place: isKnown ? (place as PlaceName) : "lost", rest, query: url.searchParams };
}

function here(): Route {
  if (location.pathname === "/") history.replaceState(null, "", HOME);
  return parse(new URL(location.href));
}

let current = $state.raw<Route>(here());

export const route = {
  get now(): Route {
    return current;
  },
};

/** Goes there; the heading of the new place gets the focus, so that a screen reader tells where one is. */
export async function go(path: string, { replace = false } = {}): Promise<void> {
  if (replace) history.replaceState(null, "", path);
  else history.pushState(null, "", path);
  const before = current.place;
  current = here();
  if (current.place === before) return;
  await tick();
  scrollTo(0, 0);
  document.querySelector<HTMLElement>("main h1")?.focus({ preventScroll: true });
}

/** Links within the page change the place without loading; returns what ends that. */
export function followLinks(): () => void {
  function onClick(event: MouseEvent) {
    const link = (event.target as Element | null)?.closest?.("a[href]");
    if (!(link instanceof HTMLAnchorElement) || event.defaultPrevented || event.button !== 0) return;
    if (event.metaKey || event.ctrlKey || event.shiftKey || event.altKey) return;
    if (link.target || link.hasAttribute("download") || link.origin !== location.origin) return;
    if (link.hash || parse(new URL(link.href)).place === "lost") return;
    event.preventDefault();
    void go(link.pathname + link.search);
  }
  const onBack = () => (current = here());
  document.addEventListener("click", onClick);
  window.addEventListener("popstate", onBack);
  return () => {
    document.removeEventListener("click", onClick);
    window.removeEventListener("popstate", onBack);
  };
}
