import { deflateSync } from "node:zlib";
import { afterEach, expect, test, vi } from "vitest";
import { litPixels, unpack, watch } from "../src/api/live";

afterEach(() => vi.unstubAllGlobals());

/** As `app/live/picture.py` packs it. */
function message(code: number, facts: object, body: Uint8Array): ArrayBuffer {
  let text = JSON.stringify(facts);
  text += " ".repeat((8 - (text.length % 8)) % 8);
  const bytes = new Uint8Array(8 + text.length + body.length);
  const head = new DataView(bytes.buffer);
  head.setUint8(0, code);
  head.setUint8(1, 1);
  head.setUint32(4, text.length, true);
  bytes.set(new TextEncoder().encode(text), 8);
  bytes.set(body, 8 + text.length);
  return bytes.buffer;
}

test("a stripe comes in pieces, across in parts of a pixel", () => {
  const triples = new Uint16Array([10, 320, 2, 11, 336, 1, 40, 160, 2]);
  const facts = { size: [640, 480], parts: 16, stripes: [["left", "vertical", 3]] };
  const got = unpack(message(3, facts, new Uint8Array(triples.buffer)));
  if (got.what !== "stripe") throw new Error("is no stripe");
  expect(got.stripes[0]?.pieces.map((piece) => [...piece.positions])).toEqual([
    [20, 10, 21, 11],
    [10, 40],
  ]);
  expect([...(got.stripes[0]?.pieces[0]?.saturated ?? [])]).toEqual([0, 1]);
});

test("a mask's rows are filled up to whole bytes", async () => {
  const packed = deflateSync(Uint8Array.from([0b10000000, 0b01000000, 0b00000001, 0b11000000]));
  const got = unpack(message(4, { size: [10, 2], mask_size: [10, 2] }, packed));
  if (got.what !== "mask") throw new Error("is no mask");
  const lit = await litPixels(got.bits, [10, 2]);
  expect([...lit].flatMap((value, at) => (value ? [at] : []))).toEqual([0, 9, 17, 18, 19]);
});

test("a message of another version is refused", () => {
  const bytes = new Uint8Array(message(0, {}, new Uint8Array()));
  bytes[1] = 2;
  expect(() => unpack(bytes.buffer)).toThrow();
});

test("whoever leaves before the line is there does not break it off, which the console would complain of", () => {
  const made: { readyState: number; onopen?: () => void; close: ReturnType<typeof vi.fn> }[] = [];
  class Line {
    static CONNECTING = 0;
    readyState = 0;
    onopen?: () => void;
    close = vi.fn();
    constructor() {
      made.push(this);
    }
  }
  vi.stubGlobal("WebSocket", Line);
  vi.stubGlobal("location", { protocol: "http:", host: "here" });
  const page = { visibilityState: "visible", addEventListener: vi.fn(), removeEventListener: vi.fn() };
  vi.stubGlobal("document", page);
  watch({ kind: "raw", show: () => {} })();
  expect(made[0]?.close).not.toHaveBeenCalled();
  made[0]?.onopen?.();
  expect(made[0]?.close).toHaveBeenCalled();
});
