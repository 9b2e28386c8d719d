/** Tries the plan on a thinned copy of the cloud, and has the 3D view show what is wanted; one thing at a time. */
import { api, asked } from "../../../api/client";
import type { CleaningOut } from "../../../api/schema.gen";
import { cloud as cloudView, readCloud, type View } from "../../../cloud.svelte";
import { wordsOf } from "../../../notices.svelte";
import type { StepDocument } from "./plan";

export type Look = "before" | "going" | "after" | "surface";

export interface Wish {
  scan: string;
  cloud: string;
  steps: readonly StepDocument[];
  look: Look;
  /** Shown as `surface`; empty where there is none. */
  mesh: string;
}

/** What differs in what is drawn. */
const drawnOf = (wish: Wish) =>
  JSON.stringify([
    wish.cloud,
    wish.look,
    wish.look === "surface" ? wish.mesh : wish.look === "before" ? "" : wish.steps,
  ]);
const triedOf = (wish: Wish) => JSON.stringify([wish.cloud, wish.steps]);

export class Trial {
  isBusy = $state(false);
  /** What the steps came to; null until they were tried. */
  found = $state.raw<CleaningOut | null>(null);
  problem = $state.raw<ReturnType<typeof wordsOf> | null>(null);
  /** The 3D view belongs to a scan that goes on. */
  isHidden = $state(false);
  #wanted: Wish | null = null;
  #drawn = "";
  #tried = "";
  /** What the colours said before they told what goes. */
  #colour: View["colour"] | null = null;

  /** Has it so, when what goes on is over; only the newest wish counts. */
  async wish(wish: Wish): Promise<void> {
    this.#wanted = wish;
    if (this.isBusy) return;
    this.isBusy = true;
    while (this.#wanted) {
      const next: Wish = this.#wanted;
      this.#wanted = null;
      try {
        await this.#fulfil(next);
        this.problem = null;
      } catch (error) {
        this.problem = wordsOf(error);
      }
    }
    this.isBusy = false;
  }

  /** Somebody else showed something: it is drawn again with the next wish. */
  forgetDrawn(): void {
    this.#drawn = "";
  }

  /** The colours say again what they said before. */
  async putBack(): Promise<void> {
    const colour = this.#colour;
    this.#colour = null;
    if (colour) await asked(api.PATCH("/api/v1/view", { body: { colour } }));
  }

  async #fulfil(wish: Wish): Promise<void> {
    const { scan, cloud } = wish;
    const isDrawn = drawnOf(wish) === this.#drawn;
    if (!isDrawn && wish.look === "going") this.#colour ??= cloudView.now?.colour ?? null;
    const shows = !isDrawn && (wish.look === "going" || wish.look === "after");
    if (shows || triedOf(wish) !== this.#tried) {
      this.#tried = "";
      const body = { scan, cloud, steps: [...wish.steps], shows, marks: wish.look === "going" };
      this.found = await asked(api.POST("/api/v1/surface/preview", { body }));
      this.#tried = triedOf(wish);
      if (shows) this.isHidden = !this.found.shown;
    }
    if (isDrawn) return;
    if (wish.look === "before") {
      const body = { scan, cloud, steps: [], shows: true, marks: false };
      this.isHidden = !(await asked(api.POST("/api/v1/surface/preview", { body }))).shown;
    } else if (wish.look === "surface" && wish.mesh) {
      const params = { path: { name: scan, mesh: wish.mesh } };
      await asked(api.POST("/api/v1/scans/{name}/meshes/{mesh}/show", { params }));
      this.isHidden = false;
    }
    this.#drawn = drawnOf(wish);
    if (wish.look !== "going") await this.putBack();
    await readCloud();
  }
}
