/** The page inside the frame of the 3D view: it comes from the same place, so that it can be read. */

/** How far a finger may slip between press and release, in pixels, and still mean that one place. */
const SLIP = 5;

export interface Place {
  /** 0..1 from the left. */
  across: number;
  /** 0..1 from the top. */
  down: number;
}

/** Tells of presses that are no drag; the view still turns by dragging. Returns what ends it. */
export function listenForPresses(frame: HTMLIFrameElement, onPress: (place: Place) => void): () => void {
  const page = frame.contentWindow;
  if (!page) return () => {};
  let began: { x: number; y: number } | null = null;
  function onDown(event: PointerEvent) {
    began = event.isPrimary && event.button === 0 ? { x: event.clientX, y: event.clientY } : null;
  }
  function onUp(event: PointerEvent) {
    if (!began || !page || !event.isPrimary) return;
    const slipped = Math.hypot(event.clientX - began.x, event.clientY - began.y);
    began = null;
    if (slipped > SLIP) return;
    onPress({ across: event.clientX / page.innerWidth, down: event.clientY / page.innerHeight });
  }
  page.addEventListener("pointerdown", onDown, true);
  page.addEventListener("pointerup", onUp, true);
  return () => {
    page.removeEventListener("pointerdown", onDown, true);
    page.removeEventListener("pointerup", onUp, true);
  };
}

const FRAMES_TRIED = 30;

/** What the view shows now, before the ground that it stands on; null where it has not drawn yet. */
export async function pictureOf(frame: HTMLIFrameElement, isDark: boolean): Promise<Blob | null> {
  for (let tried = 0; tried < FRAMES_TRIED; tried++) {
    const picture = await nextFrame(frame, isDark);
    if (picture) return new Promise((done) => picture.toBlob(done, "image/png"));
  }
  return null;
}

function nextFrame(frame: HTMLIFrameElement, isDark: boolean): Promise<HTMLCanvasElement | null> {
  return new Promise((done) => {
    const page = frame.contentWindow;
    const all = [...(frame.contentDocument?.querySelectorAll("canvas") ?? [])];
    // Beside the scene there are small ones, such as the axes in a corner.
    const drawn = all.sort((a, b) => b.width * b.height - a.width * a.height)[0];
    if (!page || !drawn?.width) return done(null);
    // The canvas holds its picture until the frame is over: after the view has drawn, and not later.
    page.requestAnimationFrame(() => {
      const copy = document.createElement("canvas");
      copy.width = drawn.width;
      copy.height = drawn.height;
      const pen = copy.getContext("2d");
      if (!pen) return done(null);
      pen.drawImage(drawn, 0, 0);
      if (isEmpty(pen)) return done(null);
      pen.globalCompositeOperation = "destination-over";
      pen.fillStyle = ground(pen, isDark);
      pen.fillRect(0, 0, copy.width, copy.height);
      done(copy);
    });
  });
}

function isEmpty(pen: CanvasRenderingContext2D): boolean {
  const { width, height } = pen.canvas;
  const { data } = pen.getImageData(0, 0, width, height);
  for (let at = 3; at < data.length; at += 4) if (data[at]) return false;
  return true;
}

/** As `--stage` in style.css. */
function ground(pen: CanvasRenderingContext2D, isDark: boolean): CanvasGradient {
  const { width, height } = pen.canvas;
  const reach = Math.hypot(width / 2, 0.62 * height);
  const colours = pen.createRadialGradient(width / 2, 0.38 * height, 0, width / 2, 0.38 * height, reach);
  colours.addColorStop(0, isDark ? "#2b303a" : "#ffffff");
  colours.addColorStop(0.78, isDark ? "#111318" : "#d4d9e1");
  return colours;
}

/** Lets the browser save it under that name. */
export function save(file: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(file);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}
