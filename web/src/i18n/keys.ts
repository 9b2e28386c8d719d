import type * as en from "./en";

/** A sentence for one thing and for several. */
export interface Forms {
  one: string;
  other: string;
}

type Parts = typeof en;

/** Every key there is: `part.name`. */
export type Key = { [Part in keyof Parts]: `${Part & string}.${keyof Parts[Part] & string}` }[keyof Parts];
