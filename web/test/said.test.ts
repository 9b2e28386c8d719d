import { expect, test } from "vitest";
import { filled, phrased, renumbered, type Sentences } from "../src/i18n/said";
import german from "../src/i18n/server/de.json";

const { phrases, findings, problems } = german as unknown as Sentences;

test("a sentence without a code is known by its words, whatever numbers are in it", () => {
  expect(phrased("Turn the table to 97.5 degrees, then confirm.", phrases)).toBe(
    "Dreh den Teller auf 97.5° und bestätige dann.",
  );
  expect(phrased("Nobody has heard of this.", phrases)).toBeNull();
});

test("what a sentence leaves open is said in German too, where it is known", () => {
  expect(phrased("Switch laser 2 off, then confirm.", phrases)).toBe(
    "Schalte Laser 2 aus und bestätige dann.",
  );
  expect(phrased("the bench, which 'Mug' has", phrases)).toBe("den Scanner, mit: 'Mug'");
  const drift =
    "Laser 'left' sees the table 0.41 mm lower than laser 'right' does: laser 'left' has moved since the calibration. Fix laser 'left' in place and calibrate again.";
  expect(phrased(drift, phrases)).toBe(
    "Laser 'left' sieht den Teller 0.41 mm tiefer als Laser 'right': Laser 'left' hat sich seit der Kalibrierung bewegt. Mach fest, was sich bewegt hat (Laser 'left'), und kalibriere neu.",
  );
});

test("of what a device or a file has to say, its name stays as it is", () => {
  expect(phrased("Grbl on /dev/ttyUSB0: did not answer 'a picture' within 2.5 s", phrases)).toBe(
    "Grbl on /dev/ttyUSB0: hat auf ein Bild 2.5 s lang nicht geantwortet",
  );
  expect(phrased("uvc: has gone and did not come back (uvc: sends no more pictures)", phrases)).toBe(
    "uvc: ist weg und kam nicht wieder (uvc: schickt keine Bilder mehr)",
  );
  expect(phrased("grbl: /dev/ttyUSB0 cannot be opened ([Errno 5] Input)", phrases)).toBe(
    "grbl: /dev/ttyUSB0 lässt sich nicht öffnen ([Errno 5] Input)",
  );
  expect(phrased("grbl: something entirely new", phrases)).toBeNull();
});

test("what is not known stays, even beside what is", () => {
  expect(phrased("Something entirely new.", phrases)).toBeNull();
  expect(phrased("Fix the camera in place and calibrate again. And another thing.", phrases)).toBeNull();
});

test("every open name of a phrase's German is one of its English", () => {
  const names = (text: string) => new Set(text.match(/\{\w+\}/g) ?? []);
  for (const [english, other] of phrases)
    for (const name of names(other)) expect([...names(english)], english).toContain(name);
});

test("numbers are written as the language does", () => {
  expect(filled("{a} mm", { a: 1.5 }, (value) => String(value).replace(".", ","))).toBe("1,5 mm");
  expect(filled("{a} mm", {})).toBe("{a} mm");
  const german = (words: string) => renumbered(words, "de");
  expect(german("12,345.5")).toBe("12.345,5");
  expect(phrased("It is 36.8 x 40.0 x 1,200.5 mm.", phrases, german)).toBe(
    "Es misst 36,8 x 40,0 x 1.200,5 mm.",
  );
  for (const name of ["8000", "1.2.3", "v2.1", "2026-11-22"]) expect(german(name)).toBe(name);
});

test("each code has a sentence, and what to do or nothing", () => {
  for (const part of [findings, problems])
    for (const said of Object.values(part)) {
      expect(said).toHaveLength(2);
      expect(said[0]).not.toBe("");
    }
});
