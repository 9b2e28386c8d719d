import type { Snippet } from "svelte";

/** What every setting takes for the words around it. */
export interface FieldProps {
  label: string;
  hint?: string;
  wrong?: string;
  /** What the setting does, in a sentence or two. */
  help?: string;
  /** A picture of it, drawn on 96 by 60 units in outline; see `HelpTip`. */
  picture?: Snippet;
}
