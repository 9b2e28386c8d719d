/** A short tone and a tremble when a view was taken: the eyes are on the board, not on the page. */
let audio: AudioContext | undefined;

/** A browser lets a page sound only after a press: call this in the handler of one. */
export function mayOpenAudio(): void {
  if (!("AudioContext" in window)) return;
  audio ??= new AudioContext();
  if (audio.state === "suspended") void audio.resume();
}

export type Tone = "taken" | "asked" | "done";
const NOTES_HZ: Record<Tone, readonly number[]> = { taken: [880], asked: [660, 660], done: [660, 880, 1100] };
const NOTE_S = 0.12;
const LOUD = 0.12;

export function sound(tone: Tone): void {
  if (audio?.state !== "running") return;
  NOTES_HZ[tone].forEach((hz, index) => note(audio!, hz, audio!.currentTime + index * 1.4 * NOTE_S));
}

function note(context: AudioContext, hz: number, begins: number): void {
  const swing = context.createOscillator();
  const gain = context.createGain();
  swing.frequency.value = hz;
  // A tone that is cut off clicks.
  gain.gain.setValueAtTime(0, begins);
  gain.gain.linearRampToValueAtTime(LOUD, begins + 0.01);
  gain.gain.linearRampToValueAtTime(0, begins + NOTE_S);
  swing.connect(gain).connect(context.destination);
  swing.start(begins);
  swing.stop(begins + NOTE_S);
}

export const canVibrate = "vibrate" in navigator;

export function vibrate(tone: Tone): void {
  // Before the first press a browser refuses, and says so.
  if (canVibrate && navigator.userActivation?.hasBeenActive)
    navigator.vibrate(tone === "taken" ? 60 : [80, 60, 80]);
}
