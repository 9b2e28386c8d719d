export { default as adjust } from "./adjust.json";
export { default as calibrate } from "./calibrate.json";
export { default as kit } from "./kit.json";
export { default as library } from "./library.json";
export { default as scan } from "./scan.json";
export { default as settings } from "./settings.json";
export { default as shell } from "./shell.json";
export { default as ui } from "./ui.json";
