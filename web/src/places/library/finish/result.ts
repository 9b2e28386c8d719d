/** What a surface that was made is good for. */
import type { MeshOut } from "../../../api/schema.gen";

export type MeshState = "printable" | "doubtful" | "unprintable" | "open" | "unknown";

export function stateOf(mesh: MeshOut): MeshState {
  if (!mesh.made) return "unknown";
  const { printing, doubts } = mesh.made;
  if (!printing) return "open";
  const states = printing.findings.map((finding) => finding.state);
  if (states.includes("bad")) return "unprintable";
  return states.includes("doubt") || doubts.length ? "doubtful" : "printable";
}

const FORMS = ["stl", "3mf", "obj", "glb", "ply"] as const;
/** An OBJ with its material and picture, in the place of the OBJ alone. */
const TEXTURED = "obj-zip";
export type Form = (typeof FORMS)[number] | typeof TEXTURED;
/** Bytes of a binary STL: its head, and each triangle. */
const STL_HEAD = 84;
const STL_TRIANGLE = 50;

/** Every form in which a surface can be taken home; null where nobody counted how large it will be. */
export function formsOf(mesh: MeshOut): { name: Form; bytes: number | null }[] {
  const sizes: Record<string, number> = {
    stl: STL_HEAD + STL_TRIANGLE * mesh.triangles,
    ply: mesh.size_bytes,
    ...mesh.made?.sizes,
  };
  return FORMS.map((each) => {
    const name = each === "obj" && mesh.has_texture ? TEXTURED : each;
    return { name, bytes: sizes[name] ?? null };
  });
}
