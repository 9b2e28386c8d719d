import { expect, test } from "vitest";
import {
  judgeLight,
  judgeStripe,
  placeOf,
  usualRegion,
  valueAt,
  withCorner,
  withOneMore,
  withoutCorner,
} from "../src/places/adjust/judge";
import { newestWins } from "../src/places/adjust/newest";

function lit(bin: number, share = 1): number[] {
  return Array.from({ length: 64 }, (_, at) => (at === bin ? share : (1 - share) / 63));
}

test("a dark room is right for a laser and wrong for colours", () => {
  expect(judgeLight(lit(2), "laser")).toBe("good");
  expect(judgeLight(lit(2), "texture")).toBe("dark");
  expect(judgeLight(lit(30), "board")).toBe("good");
  expect(judgeLight(lit(40), "laser")).toBe("bright");
  expect(judgeLight(lit(63, 0.3), "laser")).toBe("clipped");
  expect(judgeLight([], "laser")).toBe("none");
});

test("two rows in a hundred may be clipped", () => {
  expect(judgeStripe(0, 0)).toBe("none");
  expect(judgeStripe(500, 9)).toBe("good");
  expect(judgeStripe(500, 10)).toBe("look");
  expect(judgeStripe(500, 400)).toBe("bad");
});

test("the slider of an exposure moves in factors, from end to end", () => {
  expect(valueAt(0, 50, 33_333)).toBe(50);
  expect(valueAt(1, 50, 33_333)).toBe(33_333);
  for (const value of [60, 800, 8000, 20_000]) {
    expect(valueAt(placeOf(value, 50, 33_333), 50, 33_333) / value).toBeCloseTo(1, 1);
  }
  expect(placeOf(5, 50, 40)).toBe(0);
});

test("corners stay in the picture, can be added, and never become fewer than three", () => {
  expect(withCorner(usualRegion, 0, [-1, 2])[0]).toEqual([0, 1]);
  expect(withOneMore(usualRegion, 3).at(-1)).toEqual([0.2, 0.5]);
  const three = withoutCorner(usualRegion, 1);
  expect(three).toHaveLength(3);
  expect(withoutCorner(three, 0)).toHaveLength(3);
});

test("of what is wanted while something is being sent only the newest is sent", async () => {
  const sent: number[] = [];
  const doors: (() => void)[] = [];
  const send = newestWins((value: number) => {
    sent.push(value);
    return new Promise<void>((open) => doors.push(open));
  });
  const first = send(1);
  void send(2);
  void send(3);
  expect(sent).toEqual([1]);
  doors[0]!();
  await Promise.resolve();
  await Promise.resolve();
  expect(sent).toEqual([1, 3]);
  doors[1]!();
  await first;
});
