/** How the shelf was left; it outlasts a visit to a scan. */
import { SvelteSet } from "svelte/reactivity";
import type { Order } from "./shelf";

export const shelf = $state<{ words: string; order: Order }>({ words: "", order: "newest" });

/** Names of the scans that are chosen, for what is done with several. */
export const chosen = new SvelteSet<string>();
