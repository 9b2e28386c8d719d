/** What the sheets of this place share: the server's live settings, the camera's controls, what is shown. */
import { api, asked } from "../../api/client";
import { watch, type LiveFacts, type LiveNumbers } from "../../api/live";
import type { ControlName, ControlOut, LiveIn, LiveOut, Use } from "../../api/schema.gen";
import { attempt } from "../../notices.svelte";
import { newestWins } from "./newest";

export type Sheet = "light" | "stripe" | "table";
export type Sight = "raw" | "overlay" | "mask" | "all";
type Value = number | "auto";

let settings = $state.raw<LiveOut | null>(null);
let controls = $state.raw<readonly ControlOut[] | null>(null);
let numbers = $state.raw<LiveNumbers | null>(null);
let stripes = $state.raw<LiveFacts["stripes"]>();
let sharpest = $state(0);

/** What is looked at and for which pictures the camera is set; it outlasts a visit. */
export const shown = $state({
  sheet: "light" as Sheet,
  sight: "overlay" as Sight,
  maskShare: 0.8,
  use: "laser" as Use,
  isDrawing: false,
});

export const adjusting = {
  get settings(): LiveOut | null {
    return settings;
  },
  /** null until the camera has told. */
  get controls(): readonly ControlOut[] | null {
    return controls;
  },
  get numbers(): LiveNumbers | null {
    return numbers;
  },
  /** Of each laser that is looked for; undefined until there was a picture. */
  get stripes(): LiveFacts["stripes"] {
    return stripes;
  },
  /** The best focus since it was forgotten. */
  get sharpest(): number {
    return sharpest;
  },
  forgetSharpest(): void {
    sharpest = 0;
  },
};

export async function readSettings(): Promise<void> {
  settings = (await asked(api.GET("/api/v1/live/settings"))) as LiveOut;
}

/** What the camera has, or nothing while it is away: the bench says why. */
export async function readControls(): Promise<void> {
  try {
    controls = await asked(api.GET("/api/v1/bench/camera/controls"));
  } catch {
    controls = null;
  }
}

let unsent: LiveIn = {};

const sendSettings = newestWins<void>(() => {
  const body = unsent;
  unsent = {};
  return attempt(async () => {
    const answer = (await asked(api.PATCH("/api/v1/live/settings", { body }))) as LiveOut;
    // What the hand has done meanwhile is newer.
    settings = { ...answer, ...(unsent as Partial<LiveOut>) };
  });
});

/** From the next picture on, for everybody who looks. */
export function change(wanted: LiveIn): void {
  unsent = { ...unsent, ...wanted };
  if (settings) settings = { ...settings, ...(wanted as Partial<LiveOut>) };
  void sendSettings();
}

type Values = Partial<Record<ControlName, Value>>;
let unset: { use: Use; values: Values } | null = null;

const sendControls = newestWins<void>(() => {
  const wanted = unset;
  unset = null;
  if (!wanted) return Promise.resolve();
  const body = { use: wanted.use, values: wanted.values as Record<string, Value> };
  return attempt(async () => (controls = await asked(api.PATCH("/api/v1/bench/camera/controls", { body }))));
});

function wantControls(use: Use, values: Values): Promise<void> {
  unset = { use, values: unset?.use === use ? { ...unset.values, ...values } : values };
  return sendControls();
}

/** Set now, and kept for the pictures that are being set up. */
export function setControl(name: ControlName, value: Value): Promise<void> {
  return wantControls(shown.use, { [name]: value });
}

/** The camera as it is for these pictures, as far as somebody has set it for them. */
export function showUse(use: Use): void {
  const kept = (controls ?? []).filter((each) => each.present && each.uses?.[use] !== undefined);
  if (!kept.length) return;
  void wantControls(use, Object.fromEntries(kept.map((each) => [each.name, each.uses![use]!])));
}

/** Follow the numbers of the picture until the returned function is called. */
export function followNumbers(): () => void {
  return watch({
    kind: "stripe",
    show({ facts }) {
      numbers = facts.numbers;
      stripes = facts.numbers ? facts.stripes : undefined;
      sharpest = Math.max(sharpest, facts.numbers?.focus ?? 0);
    },
    onLost() {
      numbers = null;
      stripes = undefined;
    },
  });
}
