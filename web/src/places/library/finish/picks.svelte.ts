/** The same three places of a thing, shown on two scans: first all on the one, then all on the other. */
import { api, asked } from "../../../api/client";
import { showInView } from "../../../cloud.svelte";
import type { Place } from "../../../ui/frame";

export const WANTED = 3;
export type Point = [number, number, number];

export class Picks {
  /** On this scan, and on the other. */
  places = $state.raw<readonly [readonly Point[], readonly Point[]]>([[], []]);
  isBusy = $state(false);

  constructor(
    readonly scans: readonly [string, string],
    readonly clouds: readonly [string, string],
  ) {}

  /** Which scan is to be pressed now; -1 when all is known. */
  get side(): 0 | 1 | -1 {
    return this.places[0].length < WANTED ? 0 : this.places[1].length < WANTED ? 1 : -1;
  }

  /** The number of the place that is to be pressed now. */
  get number(): number {
    return this.side === -1 ? WANTED : this.places[this.side].length + 1;
  }

  /** Forgets all, and shows the first scan. */
  async begin(): Promise<void> {
    this.places = [[], []];
    await this.#show(0);
  }

  /** Takes the place that was pressed. A refusal is passed on. */
  async take(tab: string, place: Place): Promise<void> {
    const side = this.side;
    if (side === -1 || this.isBusy) return;
    this.isBusy = true;
    try {
      const before = [...this.places[side]];
      const { point } = await asked(api.POST("/api/v1/view/pick", { body: { tab, ...place, before } }));
      const taken = [...before, point as Point];
      this.places = side === 0 ? [taken, this.places[1]] : [this.places[0], taken];
      if (this.side === 1 && side === 0) await this.#show(1);
    } finally {
      this.isBusy = false;
    }
  }

  /** As the join takes them. */
  get pairs() {
    const [there, here] = this.places;
    return here.map((point, at) => ({ cloud: 1, here: point, there: there[at]! }));
  }

  #show(side: 0 | 1): Promise<void> {
    return showInView(this.scans[side], this.clouds[side]);
  }
}
