/**
 * Live pictures over a WebSocket: one is sent for each that was shown, so a slow page sees fewer, never old ones.
 * The messages are described at the head of `app/live/picture.py`.
 */
import { API, NOT_LOGGED_IN, socketAddress } from "./addresses";
import { enterAgain } from "./entry";

export type LiveKind = "raw" | "mask" | "overlay" | "stripe";

export interface LiveNumbers {
  points: number;
  saturated: number;
  focus: number;
  histogram: number[];
}

export interface LiveFacts {
  frame: number;
  exposed_s: number;
  /** Width and height of the camera's own picture, pixels. */
  size: [number, number];
  is_stale: boolean;
  problem: string;
  numbers: LiveNumbers | null;
  parts?: number;
  stripes?: [laser: string, orientation: "vertical" | "horizontal", points: number][];
  mask_size?: [number, number];
  /** With the stripe: what belongs where, in pixels of the camera's own picture. */
  marks?: LiveMarks;
}

type Spot = [x: number, y: number];

export interface LiveMarks {
  outlines: Spot[][];
  /** Corners of the calibration board, as far as they were found. */
  board: [number: number, ...Spot][];
  /** The four corners of each marker on the table. */
  markers: [number: number, corners: Spot[]][];
}

/** A stripe in pieces without a gap; positions alternate x, y in pixels of the camera's picture. */
export interface StripeLine {
  laser: string;
  pieces: { positions: Float32Array; saturated: Uint8Array }[];
}

export type LiveMessage =
  | { what: "picture"; facts: LiveFacts; jpeg: Blob }
  | { what: "stripe"; facts: LiveFacts; stripes: StripeLine[] }
  | { what: "mask"; facts: LiveFacts; bits: Uint8Array<ArrayBuffer> };

const VERSION = 1;
const STRIPE = 3;
const PACKED_MASK = 4;
const HEAD_BYTES = 8;
const SATURATED = 1;
const BEGINS = 2;

/** Takes a message apart; throws where it is of another version. */
export function unpack(message: ArrayBuffer): LiveMessage {
  const head = new DataView(message);
  if (head.getUint8(1) !== VERSION) throw new Error("is no live message of version 1");
  const ends = HEAD_BYTES + head.getUint32(4, true);
  const text = new TextDecoder().decode(new Uint8Array(message, HEAD_BYTES, ends - HEAD_BYTES));
  const facts = JSON.parse(text) as LiveFacts;
  const code = head.getUint8(0);
  if (code === STRIPE)
    return { what: "stripe", facts, stripes: stripesOf(facts, new Uint16Array(message, ends)) };
  if (code === PACKED_MASK) return { what: "mask", facts, bits: new Uint8Array(message, ends) };
  return { what: "picture", facts, jpeg: new Blob([new Uint8Array(message, ends)], { type: "image/jpeg" }) };
}

function stripesOf(facts: LiveFacts, triples: Uint16Array): StripeLine[] {
  const parts = facts.parts ?? 1;
  let at = 0;
  return (facts.stripes ?? []).map(([laser, orientation, points]) => {
    const pieces: { xy: number[]; clipped: number[] }[] = [];
    for (let index = 0; index < points; index++, at += 3) {
      const line = triples[at] ?? 0;
      const across = (triples[at + 1] ?? 0) / parts;
      const flags = triples[at + 2] ?? 0;
      if (index === 0 || flags & BEGINS) pieces.push({ xy: [], clipped: [] });
      const piece = pieces[pieces.length - 1]!;
      piece.xy.push(...(orientation === "vertical" ? [across, line] : [line, across]));
      piece.clipped.push(flags & SATURATED);
    }
    return {
      laser,
      pieces: pieces.map(({ xy, clipped }) => ({
        positions: Float32Array.from(xy),
        saturated: Uint8Array.from(clipped),
      })),
    };
  });
}

/** Unpacks the bits of a mask into one byte a pixel, 255 where lit. */
export async function litPixels(bits: Uint8Array<ArrayBuffer>, size: [number, number]): Promise<Uint8Array> {
  const stream = new Blob([bits]).stream().pipeThrough(new DecompressionStream("deflate"));
  const packed = new Uint8Array(await new Response(stream).arrayBuffer());
  const [width, height] = size;
  const stride = Math.ceil(width / 8);
  const lit = new Uint8Array(width * height);
  for (let row = 0; row < height; row++) {
    for (let column = 0; column < width; column++) {
      const byte = packed[row * stride + (column >> 3)] ?? 0;
      if (byte & (128 >> (column & 7))) lit[row * width + column] = 255;
    }
  }
  return lit;
}

export interface LiveOptions {
  kind: LiveKind;
  /** Scales pictures down to so many pixels across; 0 leaves them. */
  width?: number;
  /** Draws the message; the next one is asked for when this has ended. */
  show(message: LiveMessage): Promise<void> | void;
  onLost?(): void;
}

const WAIT_MS = 1000;

/** Watch until the returned function is called; a hidden page watches nothing. */
export function watch(options: LiveOptions): () => void {
  let socket: WebSocket | undefined;
  let timer: ReturnType<typeof setTimeout> | undefined;
  let isOver = false;

  function open() {
    timer = undefined;
    if (socket || document.visibilityState !== "visible") return;
    // The page has words of its own.
    const query = new URLSearchParams({ captions: "false", packed: String(options.kind === "mask") });
    if (options.width) query.set("width", String(options.width));
    const mine = (socket = new WebSocket(socketAddress(`${API}/live/${options.kind}?${query}`)));
    mine.binaryType = "arraybuffer";
    mine.onopen = () => mine.send("next");
    mine.onmessage = async (event) => {
      await options.show(unpack(event.data as ArrayBuffer));
      if (socket === mine && mine.readyState === WebSocket.OPEN) mine.send("next");
    };
    mine.onclose = (event) => {
      if (socket !== mine) return;
      socket = undefined;
      if (event.code === NOT_LOGGED_IN) return void enterAgain(() => !isOver && open());
      if (isOver || document.visibilityState !== "visible") return;
      options.onLost?.();
      timer = setTimeout(open, WAIT_MS);
    };
  }

  function close() {
    clearTimeout(timer);
    const mine = socket;
    socket = undefined;
    // One that is broken off before it was open is an error to the browser's console.
    if (mine?.readyState === WebSocket.CONNECTING) mine.onopen = () => mine.close();
    else mine?.close();
  }

  const onVisibility = () => (document.visibilityState === "visible" ? open() : close());
  document.addEventListener("visibilitychange", onVisibility);
  open();
  return () => {
    isOver = true;
    document.removeEventListener("visibilitychange", onVisibility);
    close();
  };
}
