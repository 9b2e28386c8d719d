import { mount } from "svelte";
import App from "./App.svelte";
import { learn, wantedTongue } from "./i18n/index.svelte";
import "./style.css";

// The first sentence is in the person's own language already.
await learn(wantedTongue()).catch(() => {});
const target = document.getElementById("app");
if (target) mount(App, { target });
