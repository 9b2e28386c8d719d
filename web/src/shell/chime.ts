/** Two soft tones, for a job that has ended. */
const NOTES_HZ = [660, 880];
const NOTE_S = 0.16;
const LOUDNESS = 0.1;
let audio: AudioContext | undefined;

/** A browser lets a page sound only after somebody has pressed something in it. */
export function allowChime(): () => void {
  const open = () => {
    audio ??= new AudioContext();
    void audio.resume();
  };
  document.addEventListener("pointerdown", open, { once: true });
  return () => document.removeEventListener("pointerdown", open);
}

export function chime(): void {
  if (audio?.state !== "running") return;
  const begins = audio.currentTime;
  NOTES_HZ.forEach((hz, at) => {
    const [tone, volume] = [audio!.createOscillator(), audio!.createGain()];
    const from = begins + at * NOTE_S;
    tone.frequency.value = hz;
    volume.gain.setValueAtTime(0, from);
    volume.gain.linearRampToValueAtTime(LOUDNESS, from + 0.02);
    volume.gain.linearRampToValueAtTime(0, from + NOTE_S);
    tone.connect(volume).connect(audio!.destination);
    tone.start(from);
    tone.stop(from + NOTE_S);
  });
}
